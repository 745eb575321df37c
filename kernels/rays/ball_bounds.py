"""Lamps that are balls, as bounds of subtrees: what passes by a ball need not look for its triangles.

A shadow ray to such a lamp ends a little before the ball that holds its mesh (kernels.lights.balls), and yet within the
boxes of many of its nodes and leaves, since boxes stand out from a ball: looking into those in vain is most of what the
ray costs. Here a child of a node all of whose triangles are of one ball is bounded by that ball, too.

Like boxes, balls only skip what cannot hold a hit. The exact test (triangle.py) finds hits between 0 and t_max at
points that are in the triangle but for 2^-22 of its size, and what it clamps them to is off by less than the pad. Of a
triangle that it sees from its side it tells where the ray comes to an edge, which may be beside the ray by a few 2^-28
of the distance (EDGE_ON). So a ray whose way stays out of the ball, grown by GROW and DISTANT, meets none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.rays.lanes import child_code, lowest_bit, vec8i

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

GROW = 1.0 + 2.0**-18
"""What radii are multiplied with."""

DISTANT = wp.constant(wp.float64(2.0**-23))
"""Share of the distance from the ray's origin to the ball's centre, along the three axes, that is added to the radius.

Less than a shadow ray to the ball ends before it (kernels.lights.balls.ROUNDINGS)."""

_ZERO = wp.constant(wp.float64(0.0))


@dataclass(frozen=True, eq=False)
class Balls:
    """Meshes that are balls.

    Attributes:
        emitter: the glowing mesh that each is, shape [B].
        center: float32, shape [B, 3].
    """

    emitter: NDArray[np.int32]
    center: NDArray[np.float32]


NO_BALLS = Balls(np.zeros(0, np.int32), np.zeros((0, 3), np.float32))


@wp.struct
class BallBounds:
    """Which children of a tree's nodes are in balls; all without items where there are none.

    Attributes:
        mask: of each node, a bit for each child that is; none for nodes that are in a ball themselves, shape [nodes].
        ball: the ball of each child, -1 for none, shape [nodes].
        center: of each ball, shape [B].
        radius: of each ball, grown, shape [B].
    """

    mask: wp.array[wp.int32]
    ball: wp.array[vec8i]
    center: wp.array[wp.vec3]
    radius: wp.array[wp.float64]


def bound(
    children: NDArray[np.int32],
    rows: NDArray[np.integer[Any]],
    positions: NDArray[np.float32],
    emitter: NDArray[np.int32],
    balls: Balls,
    device: str,
) -> BallBounds:
    """The bounds of a tree.

    Args:
        children: codes (bvh.Bvh), shape [nodes, 8].
        rows: the triangles in the order of the leaves, shape [T].
        positions: corners of triangles, shape [T, 3, 3].
        emitter: the glowing mesh that each of them belongs to, -1 for none, shape [T].
    """
    number = np.full(max(emitter.max(initial=-1), balls.emitter.max(initial=-1)) + 2, -1, np.int32)
    number[balls.emitter] = np.arange(len(balls.emitter))
    ball = number[emitter[rows]]  # the last is that of -1
    inside = np.flatnonzero(ball >= 0)
    held = _held(children, ball) if len(inside) else np.zeros((0, 8), np.int32)
    arms = positions[rows[inside]].astype(np.float64) - balls.center[ball[inside]].astype(np.float64)[:, None]
    radius2 = np.zeros(len(balls.emitter))
    np.maximum.at(radius2, ball[inside], (arms**2).sum(axis=2).max(axis=1, initial=0.0))
    bounds = BallBounds()
    mask = ((held >= 0) << np.arange(8)).sum(axis=1, dtype=np.int32)
    bounds.mask = wp.array(mask, dtype=wp.int32, device=device)
    bounds.ball = wp.array(held, dtype=vec8i, device=device)
    bounds.center = wp.array(balls.center, dtype=wp.vec3, device=device)
    bounds.radius = wp.array(np.sqrt(radius2) * GROW, dtype=wp.float64, device=device)
    return bounds


def no_bounds(device: str) -> BallBounds:
    """Of a tree that holds no balls."""
    none = np.zeros(0, np.int32)
    return bound(np.zeros((0, 8), np.int32), none, np.zeros((0, 3, 3), np.float32), none, NO_BALLS, device)


def _held(children: NDArray[np.int32], ball: NDArray[np.int32]) -> NDArray[np.int32]:
    """BallBounds.ball of all nodes. What is below a child lies side by side in the order of the leaves.

    A node's first child is the first of them (bvh_build).
    """
    first, end = np.zeros(children.shape, np.int64), np.zeros(children.shape, np.int64)
    levels = _levels(children)
    for level in reversed(levels):
        below = children[level]
        leaf, inner = (-below - 1) >> 3, np.maximum(below, 0)
        first[level] = np.where(below < 0, leaf, np.where(below > 0, first[inner, 0], 0))
        end[level] = np.where(below < 0, -below - 7 * leaf, np.where(below > 0, end[inner].max(axis=2), 0))
    change = np.concatenate([[0], np.cumsum(ball[1:] != ball[:-1])])
    there = end > first
    last = np.where(there, end - 1, 0)
    held = np.where(there & (change[first] == change[last]), ball[first], -1)
    asked = np.ones(len(children), np.bool_)
    for level in levels:
        below = children[level]
        asked[below[(below > 0) & ((held[level] >= 0) | ~asked[level][:, None])]] = False
    held[~asked] = -1
    return held.astype(np.int32)


def _levels(children: NDArray[np.int32]) -> list[NDArray[np.int32]]:
    """The numbers of the nodes, level by level."""
    levels = [np.zeros(min(1, len(children)), np.int32)]
    while len(levels[-1]):
        below = children[levels[-1]]
        levels.append(below[below > 0])
    return levels[:-1]


@wp.func
def passes_by(bounds: wp.ref[BallBounds], ball: wp.int32, origin: wp.vec3, direction: wp.vec3, t_max: float) -> bool:
    """Whether a ray stays out of a ball up to t_max."""
    arm = wp.vec3d(origin) - wp.vec3d(bounds.center[ball])
    way = wp.vec3d(direction)
    along = wp.dot(arm, way)
    limit = bounds.radius[ball] + DISTANT * (wp.abs(arm[0]) + wp.abs(arm[1]) + wp.abs(arm[2]))
    t = wp.float64(t_max)
    speed2 = wp.dot(way, way)
    if along + t * speed2 > _ZERO:  # the nearest point is not the end
        t = wp.max(-along, _ZERO) / speed2
    there = arm + way * t
    return wp.dot(there, there) > limit * limit


@wp.func
def without_balls(
    bounds: wp.ref[BallBounds], node: int, mask: int, origin: wp.vec3, direction: wp.vec3, t_max: float
) -> int:
    """The children of a node, of those in `mask`, that a ray does not pass by as balls."""
    left = mask
    among = mask & bounds.mask[node]
    while among != 0:
        lane = lowest_bit(among)
        among = among & (among - 1)
        if passes_by(bounds, child_code(bounds.ball, node, lane), origin, direction, t_max):
            left = left & ~(1 << lane)
    return left
