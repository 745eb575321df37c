"""Rooms that are lit from next door: behind a wall, with nearly all lamps in the other, by a door, and a corridor."""

from __future__ import annotations

from dataclasses import replace

from furnaces import quad, scene, view
from window_room import ALBEDO, shell

from wdpm.scenes.model.lights import DirectionalLight, Light, PointLight
from wdpm.scenes.model.scene import Mesh, Scene

OTHERS = 6


def rooms(more: tuple[Light, ...] = (), size: tuple[int, int] = (48, 32)) -> Scene:
    """A box with a wall at z = -0.5. Before it a lamp of radiance 4, behind it six lamps ten times as strong."""
    camera = replace(view((0.0, 0.2, 1.9), (0.0, -0.1, -0.5), 80, up=(0, 1, 0)), width=size[0], height=size[1])
    wall = [quad((-1, -1, -0.5), (2, 0, 0), (0, 2, 0)), quad((-1, -1, -0.51), (0, 2, 0), (2, 0, 0))]
    made = scene([*shell(), *wall, *_lamps()], camera, ALBEDO)
    return replace(made, lights=more)


def by_a_door(size: tuple[int, int] = (48, 32)) -> Scene:
    """A box with a wall at z = -0.5 and a door at its left end. All light comes by it, from a lamp at the right."""
    return _behind(_with_door(-0.5, -0.9, 0.3), (0.6, -0.9), size)


def round_two_bends(size: tuple[int, int] = (48, 32), wide: float = 0.15) -> Scene:
    """The same with two walls: by a narrow door at the left end of the one and at the right end of the other."""
    return _behind(_with_door(0.7, 0.95 - wide, wide) + _with_door(-0.7, -0.95, wide), (0.7, -0.9), size)


def _behind(walls: list[Mesh], lamp: tuple[float, float], size: tuple[int, int]) -> Scene:
    camera = replace(view((0.3, 0.2, 1.9), (0.2, -0.1, -0.5), 80, up=(0, 1, 0)), width=size[0], height=size[1])
    left = quad((-1, -1, -2), (0, 2, 0), (0, 0, 4))
    return scene([*shell(), left, *walls, _lamp(*lamp, 20.0)], camera, ALBEDO)


def _with_door(z: float, x: float, wide: float) -> list[Mesh]:
    """A wall from side to side at z, with a door from x on."""
    strips = (((-1, x), (-1, 1)), ((x + wide, 1), (-1, 1)), ((x, x + wide), (0.4, 1)))
    wall = []
    for (x0, x1), (y0, y1) in strips:
        across, up = (x1 - x0, 0, 0), (0, y1 - y0, 0)
        wall += [quad((x0, y0, z), across, up), quad((x0, y0, z - 0.05), up, across)]
    return wall


def _lamp(x: float, z: float, radiance: float) -> Mesh:
    """A lamp below the ceiling, facing down."""
    return quad((x, 0.98, z), (0.2, 0, 0), (0, 0, 0.2), emission=(radiance, radiance, radiance))


def _lamps() -> list[Mesh]:
    behind = [_lamp(-0.8 + 0.6 * (i % 3), -1.8 + 0.6 * (i // 3), 40.0) for i in range(OTHERS)]
    return [_lamp(-0.1, 0.6, 4.0), *behind]


POINT = PointLight("point", (0.5, 0.0, 1.0), (0.2, 0.2, 0.2))
SUN = DirectionalLight("sun", (-0.3, -0.9, 0.1), (30.0, 30.0, 30.0))
"""Above the closed ceiling and the wall to the right: it reaches nothing."""
SUN_IN_THE_WINDOW = DirectionalLight("sun", (0.8, -0.6, 0.3), (30.0, 30.0, 30.0))
"""Shines through the window of window_room's room."""

LENGTH = 5.0
"""Of either arm of the corridor."""


def corridor(size: tuple[int, int] = (48, 48)) -> Scene:
    """Hardly a photon comes to the end where the camera stands: the lamp is round the corner.

    One arm along x, from -LENGTH to 0, and one along z with the lamp, from -LENGTH to 0; 1 wide and 1.5 high.
    """
    camera = replace(view((-4.8, 0.9, 0.5), (0.0, 0.7, 0.48), 70, up=(0, 1, 0)), width=size[0], height=size[1])
    lamp = quad((0.3, 1.49, -3.0), (0.4, 0, 0), (0, 0, 0.8), emission=(20.0, 20.0, 20.0))
    return scene([*_seen_arm(), *_lit_arm(), lamp], camera, (0.7, 0.6, 0.5))


def _seen_arm() -> list[Mesh]:
    return [
        quad((-LENGTH, 0, 0), (0, 0, 1), (LENGTH + 1, 0, 0)),
        quad((-LENGTH, 1.5, 0), (LENGTH + 1, 0, 0), (0, 0, 1)),
        quad((-LENGTH, 0, 0), (LENGTH, 0, 0), (0, 1.5, 0)),
        quad((-LENGTH, 0, 1), (0, 1.5, 0), (LENGTH + 1, 0, 0)),
        quad((-LENGTH, 0, 0), (0, 1.5, 0), (0, 0, 1)),
    ]


def _lit_arm() -> list[Mesh]:
    return [
        quad((0, 0, -LENGTH), (0, 0, LENGTH), (1, 0, 0)),
        quad((0, 1.5, -LENGTH), (1, 0, 0), (0, 0, LENGTH)),
        quad((0, 0, -LENGTH), (0, 1.5, 0), (0, 0, LENGTH)),
        quad((1, 0, -LENGTH), (0, 0, LENGTH + 1), (0, 1.5, 0)),
        quad((0, 0, -LENGTH), (1, 0, 0), (0, 1.5, 0)),
    ]
