"""Walls beside photons that carry irradiance: some short rays along the surface feel for them.

Both the light that a gather brings in from behind a wall (in_sight.py) and what is read across one
(irradiance/at_photons.py) must know where walls are. Rays are lifted off the surface by as much as a gather lets
photons lie off it (FLATTENING), so a surface that bends does not meet itself, nor do roundings; what is lower than that
is no wall.

What is found is a function of the triangles within reach, bit for bit: the nearest hit depends on no tree
(rays/triangle.py). So a cell holds the triangles of a band about it as well (`farthest_wall`).
"""

from __future__ import annotations

import functools
import math

import warp as wp

from wdpm.kernels.constants import FLATTENING
from wdpm.kernels.features import Features
from wdpm.kernels.made_for import made_for
from wdpm.kernels.maths.directions import around
from wdpm.kernels.maths.elementary import sincos_of
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.instanced_triangles import front_of_all, row_of_all
from wdpm.kernels.rays.triangle import no_hit
from wdpm.kernels.rays.two_level import Trees, closest_function

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FEELERS = 8
"""Rays by which a place feels for walls, evenly about its normal. They are longer by 1 / cos(180° / 8), 1.08, than what
is to be known of: one of them at least meets a straight wall there, however it stands."""

LEAST_SHARE = math.cos(math.pi / FEELERS)
"""Of a ray's way to a straight wall, how near that is at least, if no other ray meets it sooner."""

NO_WALL = wp.constant(wp.vec3(0.0, 0.0, 1.0))

_FEELERS = wp.constant(FEELERS)
_LEAST_SHARE = wp.constant(wp.float32(LEAST_SHARE))
_LIFT = wp.constant(wp.float32(1.0 / FLATTENING))
_TURN = wp.constant(wp.float32(2.0 * math.pi / FEELERS))


def farthest_wall(reach: float) -> float:
    """How far off what rays meet may be, at most, if walls are to be known of so far [scene units]."""
    return reach / LEAST_SHARE + reach / FLATTENING


@functools.cache
def make_feel_for_walls(features: Features) -> wp.Kernel:
    """The kernel by which photons feel for the walls about them."""
    closest_hit = closest_function(features.instances)

    @made_for(features)
    def feel_for_walls(
        trees: Trees,
        surfaces: Surfaces,
        position: wp.array[wp.vec3],
        normal: wp.array[wp.vec3],
        radius: wp.array[wp.float32],
        reach: wp.float32,
        offset: wp.int32,
        room_out: wp.array[wp.float32],
        walls_out: wp.array[wp.vec3],
    ) -> None:
        """The walls about N photons, one thread each.

        Args:
            position, normal: of the photons, on the side where they landed.
            radius: of the gather there: so far walls are to be known of.
            reach: the same at least.
            room_out: how far the surface goes on before it meets a wall; no more than is to be known [scene units].
            walls_out: what each ray meets: (a, b, c), where a x + b y > c lies behind it, with x towards the first ray
                and y towards the third; NO_WALL of one that meets nothing [N * FEELERS].
        """
        i = offset + wp.tid()
        n = normal[i]
        across = around(n, wp.vec3(1.0, 0.0, 0.0))
        along = around(n, wp.vec3(0.0, 1.0, 0.0))
        room = wp.max(radius[i], reach)
        origin = position[i] + n * (_LIFT * room)
        length = room / _LEAST_SHARE
        for feeler in range(_FEELERS):
            turn = sincos_of(wp.float32(feeler) * _TURN)
            direction = across * turn[1] + along * turn[0]
            hit = no_hit()
            hit.t = length
            hit = closest_hit(trees, origin, direction, hit)
            wall = NO_WALL
            if hit.prim >= 0:
                room = wp.min(room, _LEAST_SHARE * hit.t)
                away = front_of_all(surfaces, row_of_all(surfaces, hit.prim))
                if wp.dot(away, direction) < 0.0:
                    away = -away
                a = wp.dot(away, across)
                b = wp.dot(away, along)
                wall = wp.vec3(a, b, (a * turn[1] + b * turn[0]) * hit.t)
            walls_out[_FEELERS * i + feeler] = wall
        room_out[i] = room

    return feel_for_walls
