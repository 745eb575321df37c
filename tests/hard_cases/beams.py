"""A narrow beam of photons onto a screen: a caustic map whose flux is known, and parallel views of a plane."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import cos, pi, radians
from unittest.mock import patch

import numpy as np
from numpy.typing import ArrayLike
from rooms import quad, scene

from wdpm.cluster.plan import photon_pilot
from wdpm.scenes.model.bsdfs import Bsdf, Conductor
from wdpm.scenes.model.lights import Light, SpotLight
from wdpm.scenes.model.scene import Camera, Material, Mesh, Scene, diffuse
from wdpm.scenes.model.transforms import look_at, scaling

ALBEDO = 0.5
INTENSITY = (3.0, 2.0, 1.0)
HALF_ANGLE = 1.0
"""Of the beam [degrees]."""

POWER = np.array(INTENSITY) * 2.0 * pi * (1.0 - cos(radians(HALF_ANGLE)))
"""Flux of the beam [W]."""

SCREEN_AREA = 4.0


def parallel(eye: ArrayLike, target: ArrayLike, half: float, size: int = 8, up: ArrayLike = (0.1, 1.0, 0.03)) -> Camera:
    """Parallel rays: a square image of 2 `half` by 2 `half`."""
    to_world = look_at(eye, target, up) @ scaling((half, half, 1.0))
    return Camera(to_world, 1.0, size, size, near_clip=1e-6, far_clip=1e4, orthographic=True)


def beam(origin: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)) -> SpotLight:
    """A spot light with a sharp edge."""
    return SpotLight("beam", look_at(origin, target, up), INTENSITY, HALF_ANGLE, HALF_ANGLE)


def screen(x: float) -> Mesh:
    """A square of area 4 at this x; it faces -x."""
    return quad((x, -1, -1), (0, 0, 2), (0, 2, 0), name="screen")


def on_screen(half: float = 0.5, size: int = 8) -> Camera:
    """Looks at the screen at x = 1."""
    return parallel((0.3, 0.0, 0.0), (1.0, 0.0, 0.0), half, size)


def mirrored_beam(
    camera: Camera, albedo: float = ALBEDO, mirror: Bsdf | None = None, lights: Sequence[Light] | None = None
) -> Scene:
    """A beam along z, a small mirror at the origin that turns it into x, and a screen at x = 1. All else is open."""
    turn = quad((-0.1, -0.1, -0.1), (0, 0.2, 0), (0.2, 0, 0.2), 1, name="mirror")  # faces (1, 0, -1)
    materials = [diffuse("screen", (albedo,) * 3), Material("mirror", mirror or Conductor())]
    chosen = [beam((0, 0, -1), (0, 0, 0))] if lights is None else lights
    return scene([screen(1.0), turn], camera, materials, chosen)


@contextmanager
def pilot_of(paths: int) -> Iterator[None]:
    """A pilot of fewer paths: each of them is very long."""
    with patch.object(photon_pilot, "PILOT_PATHS", paths):
        yield
