"""A room that the sky lights through a small window, nearly all of it hidden; and a hut that the sun looks into."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from furnaces import quad, scene, view

from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.lights import DirectionalLight, Environment
from wdpm.scenes.model.scene import Material, Mesh, Scene

ALBEDO = (0.6, 0.5, 0.4)


def sky(height: int = 17, width: int = 32) -> Environment:
    """Brighter overhead, with a sun that the window does not show."""
    rows = np.linspace(1.0, 0.2, height, dtype=np.float32)
    pixels = np.broadcast_to(rows[:, None, None], (height, width, 3)).copy()
    pixels[height // 5, width // 3] = 60.0
    return Environment("sky", pixels)


def constant_sky(radiance: float = 0.5) -> Environment:
    """The same from everywhere."""
    return Environment("sky", np.full((1, 1, 3), radiance, np.float32))


def room(around: Environment | None = None, size: tuple[int, int] = (48, 32)) -> Scene:
    """Seen from one end; the window, 0.5 x 0.5, is in the wall to the left."""
    camera = replace(view((0.0, 0.2, 1.9), (0.0, -0.1, -2.0), 80, up=(0, 1, 0)), width=size[0], height=size[1])
    made = scene([*shell(), *_wall_with_window()], camera, ALBEDO)
    return replace(made, lights=(around or sky(),))


def open_ground(around: Environment | None = None) -> Scene:
    """A floor under an open sky that shines alike from everywhere above it: there is nothing to be learnt."""
    pixels = np.zeros((33, 32, 3), np.float32)
    pixels[:16] = 1.0
    camera = replace(view((0.0, 2.0, 4.0), (0.0, 0.0, 0.0), 50, up=(0, 1, 0)), width=48, height=32)
    made = scene([quad((-50, 0, -50), (0, 0, 100), (100, 0, 0))], camera, ALBEDO)
    return replace(made, lights=(around or Environment("sky", pixels),))


def shell() -> list[Mesh]:
    """Floor, ceiling and three walls of a room 2 x 2 x 4."""
    return [
        quad((-1, -1, -2), (0, 0, 4), (2, 0, 0)),
        quad((-1, 1, -2), (2, 0, 0), (0, 0, 4)),
        quad((-1, -1, -2), (2, 0, 0), (0, 2, 0)),
        quad((-1, -1, 2), (0, 2, 0), (2, 0, 0)),
        quad((1, -1, -2), (0, 0, 4), (0, 2, 0)),
    ]


def _wall_with_window() -> list[Mesh]:
    """The wall at x = -1 around an opening: y from 0 to 0.5, z from -1 to -0.5."""
    strips = (((-1, 1), (-2, -1)), ((-1, 1), (-0.5, 2)), ((-1, 0), (-1, -0.5)), ((0.5, 1), (-1, -0.5)))
    return [quad((-1, y0, z0), (0, y1 - y0, 0), (0, 0, z1 - z0)) for (y0, y1), (z0, z1) in strips]


FIELD = 20.0
"""Half its width [m]; the hut's is 1."""

SUN = DirectionalLight("sun", (0.1, -0.5, -0.86), (10.0, 9.0, 8.0))


def _both(corner: tuple[float, ...], u: tuple[float, ...], v: tuple[float, ...]) -> list[Mesh]:
    """A thin wall, which faces both ways."""
    return [quad(corner, u, v), quad(corner, v, u)]


def hut_on_a_field(size: tuple[int, int] = (32, 24)) -> Scene:
    """Seen from within, away from the open front."""
    camera = replace(view((0.0, 0.9, 0.95), (0.0, 0.8, -1.0), 80, up=(0, 1, 0)), width=size[0], height=size[1])
    walls = [
        quad((-FIELD, -0.01, -FIELD), (0, 0, 2 * FIELD), (2 * FIELD, 0, 0)),
        quad((-1, 0, -1), (0, 0, 2), (2, 0, 0)),
        *_both((-1, 2, -1), (0, 0, 2), (2, 0, 0)),
        *_both((-1, 0, -1), (2, 0, 0), (0, 2, 0)),
        *_both((-1, 0, -1), (0, 0, 2), (0, 2, 0)),
        *_both((1, 0, -1), (0, 0, 2), (0, 2, 0)),
    ]
    return replace(scene(walls, camera, (0.5, 0.5, 0.5)), lights=(SUN,))


def hut_before_a_mirror(size: tuple[int, int] = (32, 24)) -> Scene:
    """The same on a field that is a mirror: of the sun on it, a two-hundredth part comes into the hut."""
    hut = hut_on_a_field(size)
    field, *others = hut.meshes
    mirror = Material("mirror", Conductor())
    return replace(
        hut, meshes=(replace(field, material=len(hut.materials)), *others), materials=(*hut.materials, mirror)
    )
