"""Lamps that are balls: closed meshes, fine and round, that shine evenly outwards.

A choice of a light need not look for one of their many triangles: seen from anywhere, a ball is a cone (kernels.lights.
balls). What a lamp is, is told by its triangles alone, whatever file they came from. Only sums, products, quotients,
square roots, comparisons and stable sorts are used, in a fixed order, so that every process finds the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.light_table import LightTable

ROUND = 2.0**-9
"""How far corners and planes of triangles may be from the ball's surface, in radii: 56 segments around are enough.

A ball has the area of its mesh, and so, as Cauchy's formula says of convex bodies, on the mean over all directions its
silhouette too: what a lamp sends anywhere differs by less than a thousandth, and in all by nothing.
"""

_FEWEST = 256  # triangles: none with fewer is as round as that
_HASH = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)


@dataclass(frozen=True, eq=False)
class Balls:
    """The lamps that are balls, in the order of their elements.

    Attributes:
        first, last: of the elements of each, int64, shape [B].
        center: float64, shape [B, 3].
        radius: of the ball with the mesh's area, float64, shape [B]; outside: of the one that holds all corners.
    """

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    center: NDArray[np.float64]
    radius: NDArray[np.float64]
    outside: NDArray[np.float64]


def balls_of(table: LightTable) -> Balls:
    """The balls among the lamps of a scene."""
    triangles = len(table.prim)
    starts = np.flatnonzero(np.diff(table.light[:triangles], prepend=-1))
    ends = np.append(starts[1:], triangles)[: len(starts)]
    once = np.bincount(table.light[starts]) == 1 if len(starts) else np.zeros(0, np.bool_)
    found = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        own = slice(start, end)
        even = once[table.light[start]] and table.emitter_texture[table.emitter[start]] < 0
        if end - start >= _FEWEST and even and (table.power[own] > 0).all():
            ball = _ball(table.corners[own])
            if ball is not None:
                found.append((start, end - 1, *ball))
    first, last, center, radius, outside = zip(*found, strict=True) if found else ((), (), (), (), ())
    return Balls(
        np.array(first, np.int64),
        np.array(last, np.int64),
        np.array(center, np.float64).reshape(-1, 3),
        np.array(radius, np.float64),
        np.array(outside, np.float64),
    )


def _ball(corners: NDArray[np.float32]) -> tuple[NDArray[np.float64], float, float] | None:
    """Centre, radius and outer radius of the ball that some triangles make; None if they make none."""
    p = corners.astype(np.float64)
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    twice = np.sqrt(_dot(normal, normal))
    area = _sum(twice) / 2.0
    middles = p[:, 0] + p[:, 1] + p[:, 2]
    center = np.array([_sum(twice * middles[:, axis]) for axis in range(3)]) / (6.0 * area)
    radius = math.sqrt(area / (4.0 * math.pi))
    arms = (p - center).reshape(-1, 3)
    far2 = _dot(arms, arms)
    outside = math.sqrt(float(far2.max()))
    planes = _dot(arms[::3], normal)  # heights of the centre under the planes, times twice the areas
    is_round = (
        outside <= (1.0 + ROUND) * radius
        and math.sqrt(float(far2.min())) >= (1.0 - ROUND) * radius
        and bool((planes >= (1.0 - ROUND) * radius * twice).all())
    )
    return (center, radius, outside) if is_round and _is_closed(corners) else None


def _is_closed(corners: NDArray[np.float32]) -> bool:
    """Whether each edge of some triangles runs once in each of its directions; ends are alike by their bits."""
    bits = (corners.reshape(-1, 3) + np.float32(0.0)).view(np.uint32).astype(np.uint64)  # -0 becomes 0
    x, y, z = bits.T
    vertex = np.unique(x * _HASH[0] + y * _HASH[1] + z * _HASH[2], return_inverse=True)[1].reshape(-1, 3)
    start, end = vertex.ravel(), np.roll(vertex, -1, axis=1).ravel()
    count = int(vertex.max()) + 1
    there, back = np.sort(start * count + end), np.sort(end * count + start)
    return bool((there == back).all() and (np.diff(there) > 0).all())


def _sum(values: NDArray[np.float64]) -> float:
    """In the order of the values."""
    return float(np.cumsum(values)[-1])


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Row by row, in a fixed order."""
    product: NDArray[np.float64] = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
    return product
