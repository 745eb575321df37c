"""What is seen through dark glass: Russian roulette ends weak reflections of gloss, not the only light there is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from furnaces import box, quad, rendered, scene, view

from wdpm.cluster.render_settings import Indirect, Integrator
from wdpm.scenes.model.bsdfs import Dielectric

SIDE = 16
TINT = (0.1, 0.1, 0.1)


def test_it_is_not_made_of_bright_and_black_pixels() -> None:
    """One sample of a pixel, through two interfaces: a hundredth of the light, but for what they reflect."""
    lamp = quad((-5, -5, -2), (10, 0, 0), (0, 10, 0), emission=(1.0, 1.0, 1.0))
    glass = scene([box((1, 1, 1)), lamp], view((0, 0, 4), (0, 0, 0), 10.0, SIDE), (0.5, 0.5, 0.5))
    dark = replace(glass.materials[0], bsdf=Dielectric(specular_transmittance=TINT))
    seen = rendered(
        replace(glass, materials=(dark, *glass.materials[1:])),
        integrator=Integrator.PHOTONS,
        indirect=Indirect.MAP,
        all_effects=True,
        photons=1000,
        spp=1,
    )
    light = seen.pixels.mean(axis=2)
    through = light[(light > 0.5 * 0.01) & (light < 1.5 * 0.01)]
    assert len(through) > 0.8 * SIDE * SIDE, np.percentile(light, (5, 50, 95))
