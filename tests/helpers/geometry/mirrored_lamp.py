"""A floor, a small bright lamp over it, and a wall of metal that mirrors the lamp onto the floor: a caustic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from furnaces import quad, scene, view

from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.scene import Camera, Material, Scene

ALBEDO = (0.6, 0.5, 0.4)
RADIANCE = 4000.0
SIDE = 0.04
WALL = -1.0
"""The mirror's x."""

LAMP = np.array([[-0.2, 1.0, 0.0], [-0.2, 1.0 + SIDE, 0.0], [-0.2, 1.0 + SIDE, SIDE], [-0.2, 1.0, SIDE]], np.float64)
"""It faces the mirror alone: the floor is lit by way of it."""

IMAGE = LAMP * (-1.0, 1.0, 1.0) + (2.0 * WALL, 0.0, 0.0)
"""The lamp behind the mirror."""


def mirrored(alpha: float = 0.0, camera: Camera | None = None, radiance: float = RADIANCE) -> Scene:
    """The scene, with as rough a wall."""
    seen = camera or replace(view((0.5, 1.5, 1.5), (0.2, 0.0, 0.0), 60, up=(0, 1, 0)), width=24, height=16)
    floor = quad((WALL, 0, -2), (0, 0, 4), (3, 0, 0))
    wall = quad((WALL, 0, -2), (0, 2, 0), (0, 0, 4), material=1)
    lamp = quad(LAMP[0], (0, 0, SIDE), (0, SIDE, 0), emission=(radiance, radiance, radiance))
    made = scene([floor, wall, lamp], seen, ALBEDO)
    return replace(made, materials=(*made.materials, Material("metal", Conductor(alpha_u=alpha, alpha_v=alpha))))
