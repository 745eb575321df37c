"""Materials that absorb nothing, and the sky that they are seen under: what white furnaces are made of."""

from __future__ import annotations

import numpy as np

from wdpm.scenes.model.bsdfs import (
    WHITE,
    Blend,
    Bsdf,
    Conductor,
    Dielectric,
    Diffuse,
    Distribution,
    Null,
    Plastic,
    Principled,
    ThinDielectric,
)
from wdpm.scenes.model.lights import Environment

SKY = Environment("sky", np.ones((1, 1, 3), np.float32))
CASES: dict[str, Bsdf] = {
    "diffuse": Diffuse(WHITE),
    "mirror": Conductor(),
    "glass": Dielectric(1.5),
    "glass inside out": Dielectric(1 / 1.5),
    "no glass": Dielectric(1.0),
    "pane": ThinDielectric(1.5),
    "nothing": Null(),
    "rough metal": Conductor(alpha_u=0.05, alpha_v=0.05),
    "rough metal, GGX": Conductor(alpha_u=0.03, alpha_v=0.01, distribution=Distribution.GGX),
    "rough glass": Dielectric(1.5, alpha_u=0.05, alpha_v=0.05),
    "plastic": Plastic(WHITE, eta=1.5, nonlinear=True),
    "blend": Blend(Diffuse(WHITE), Conductor(), 0.3),
    "white metal": Principled(WHITE, roughness=0.05, metallic=1.0),
}
