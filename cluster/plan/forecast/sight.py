"""Where a view looks: what the pixels of a coarse grid see first, and where light is gathered from there.

It tells with which slave a bucket or the candidates of irradiance records are best at home: the one that holds what
they see. Nothing of an image depends on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.plan.guide_pilot import pilot_scene
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.work.misses import no_hits, start_paths
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera.guide_pilot import walk_on
from wdpm.kernels.camera.rays import Rays
from wdpm.scenes.flat.flatten import FlatScene

SIDE = 64
"""Pixels of the grid along each side of an image, at most: the rays take some 5 ms."""

PASSAGES = 3
"""Surfaces that let camera rays through, behind which a pixel's place is looked for, less one."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What the pixels of a grid see.

    Attributes:
        position: of the first surface that lets no ray through, float32, shape [rows, columns, 3].
        seen: where there is one, shape [rows, columns].
        next_position, next_seen: the same for a ray that goes on from there, in any direction in proportion to its
            cosine.
    """

    position: NDArray[np.float32]
    seen: NDArray[np.bool_]
    next_position: NDArray[np.float32]
    next_seen: NDArray[np.bool_]


_NOTHING = np.empty((0, 0, 3), np.float32), np.empty((0, 0), np.bool_)

NO_SIGHT = Sight(*_NOTHING, *_NOTHING)
"""Where nobody looks, since there is but one cell."""


def sight_of(flat: FlatScene, cell: Cell, view: View) -> Sight:
    """Look through the pixels of a grid.

    Args:
        cell: the whole scene, whose replica has the view.
    """
    width, height = view.camera.width, view.camera.height
    shape = min(height, SIDE), min(width, SIDE)
    y, x = ((2 * np.arange(few) + 1) * many // (2 * few) for few, many in zip(shape, (height, width), strict=True))
    pixel = (y[:, None] * width + x).reshape(-1).astype(np.int32)
    count, launcher, scene = len(pixel), cell.replica.launcher, pilot_scene(flat, cell)
    arrays = {"slot": np.arange(count, dtype=np.int32), "pixel": pixel, "sample": np.zeros(count, np.int32)}
    rays = columns.upload(Rays, {**arrays, **no_hits(count, view)}, launcher.device)
    paths = start_paths(cell.replica, rays, count)
    places = np.zeros((2, count, 3), np.float32)
    found = np.zeros((2, count), np.bool_)
    for bounce in range(PASSAGES + 1):
        position, normal = (wp.empty(count, dtype=wp.vec3, device=launcher.device) for _ in range(2))
        launcher(
            walk_on,
            count,
            scene=scene,
            bounce=bounce,
            seed=wp.uint32(view.seed),
            origin=paths.origin,
            direction=paths.direction,
            position_out=position,
            normal_out=normal,
        )
        here, place = normal.numpy().any(axis=1), position.numpy()
        second = here & found[0] & ~found[1]
        first = here & ~found[0]
        for number, new in enumerate((first, second)):
            places[number][new] = place[new]
            found[number] |= new
    positions, seen = places.reshape(2, *shape, 3), found.reshape(2, *shape)
    return Sight(positions[0], seen[0], positions[1], seen[1])
