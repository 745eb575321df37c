"""A wall or another thing under an even sky, for cases of one material."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
from beams import parallel
from rooms import quad, scene

from wdpm.scenes.model.bsdfs import Bsdf
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Camera, Material, Mesh, Scene

SKY = Environment("sky", np.ones((1, 1, 3), np.float32))
NO_MAPS = {"photons": 0, "caustic_photons": 0}
"""Settings of cases whose light comes straight from the sky."""


def square(material: int = 1, half: float = 1.0) -> Mesh:
    """In the plane z = 0; it faces -z."""
    return quad((-half, -half, 0), (0, 2 * half, 0), (2 * half, 0, 0), material)


def under_sky(bsdf: Bsdf, thing: Mesh, camera: Camera) -> Scene:
    """A thing alone under a sky of radiance 1."""
    return scene([replace(thing, material=0)], camera, [Material("thing", bsdf)], [SKY])


def slanted(cosine: float, half: float = 0.05, size: int = 8) -> Camera:
    """Parallel rays that meet the plane z = 0 at this cosine."""
    eye = np.array([sqrt(1 - cosine * cosine), 0.0, -cosine])
    return parallel(2 * eye, (0, 0, 0), half, size, up=(0, 1, 0))
