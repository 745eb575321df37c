"""Spheres that hold all that is specular: where photons of the caustic pass are aimed (photon_targets).

Few and small: a binary tree of all triangles is built from the top, between connected pieces first; among all its cuts
into at most 64 parts, the one whose spheres have the least sum of squared radii, and so of solid angles from afar, is
found from the bottom up. Computed by the master alone.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wdpm.kernels.lights.pieces import pieces_of

MOST_TARGETS = 64
"""Most spheres: each costs a photon some 20 ns."""

GAIN = 0.8
"""A sphere gives way to smaller ones where their silhouettes are together less than this share of its own."""

_LEAVES = 128  # of the tree that the spheres are a cut of: with 256, spheres were the same in twenty scenes
_MOST_UNITS = 1 << 12  # of larger scenes, neighbours in the list of triangles stay together
_GROWTH = 1.0 + 1e-5  # of radii: float32's roundings leave no vertex outside
_REST = np.arange(MOST_TARGETS)[:, None] - 1 - np.arange(MOST_TARGETS)  # [most - 1, n - 1]: if n are the first child's,
_SOME_LEFT = _REST >= 0  # of `most` there are so many for the other child, counted from 0


@dataclass
class _Node:
    """Some of the units (triangles, or runs of them), and how well spheres do for them.

    Attributes:
        leaves: below it, itself if it is one.
        least: sum of squared radii of the best spheres, at most 1, 2, ... of them, shape [MOST_TARGETS].
        left: how many of them the first child has; 0 where one sphere for all is best.
    """

    rows: NDArray[np.intp]
    radius2: float
    children: tuple[_Node, _Node] | None = None
    leaves: int = 1
    least: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    left: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))


def cluster_targets(positions: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """At most MOST_TARGETS spheres that hold triangles: the cut of a tree with the least sum of squared radii.

    Args:
        positions: corners, shape [T, 3, 3].

    Returns:
        Centres, float32, shape [S, 3], and radii, float32, shape [S].
    """
    if not len(positions):
        return np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
    boxes, piece, unit = _units(positions)
    cut = _best_cut(_tree(boxes, piece), MOST_TARGETS)
    sphere = np.empty(len(piece), np.uint8)
    for number, rows in enumerate(cut):
        sphere[rows] = number
    low, high = (np.array([most(boxes[rows, i], axis=0) for rows in cut]) for i, most in enumerate((np.min, np.max)))
    center = ((low + high) / 2.0).astype(np.float32)
    return center, (np.sqrt(_farthest2(positions, center, sphere[unit])) * _GROWTH).astype(np.float32)


def _farthest2(
    positions: NDArray[np.float32], center: NDArray[np.float32], sphere: NDArray[np.uint8]
) -> NDArray[np.float64]:
    """Squared distance to the corner that is farthest from each sphere's rounded centre.

    Args:
        sphere: that each triangle belongs to.
    """
    most = np.zeros(len(sphere))
    middles = [axis[sphere] for axis in center.astype(np.float64).T]
    for corner in range(3):
        x, y, z = (positions[:, corner, axis] - middle for axis, middle in enumerate(middles))
        np.maximum(most, x * x + y * y + z * z, out=most)
    order = np.argsort(sphere, kind="stable")
    farthest: NDArray[np.float64] = np.maximum.reduceat(
        most[order], np.searchsorted(sphere[order], np.arange(len(center)))
    )
    return farthest


def _units(positions: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:
    """What is never divided: triangles, or in large scenes runs of triangles of one connected piece.

    Returns:
        Boxes of the units, shape [units, 2, 3]; the piece of each, counted from 0; the unit of each triangle.
    """
    piece = pieces_of(positions)
    order = np.argsort(piece, kind="stable")
    run = -(-len(positions) // _MOST_UNITS)
    begins = np.flatnonzero(np.diff(piece[order], prepend=-1))
    sizes = np.diff(begins, append=len(order))
    starts = (np.arange(len(order)) - np.repeat(begins, sizes)) % run == 0
    first = np.flatnonzero(starts)
    one, two, three = (positions[:, corner] for corner in range(3))
    low = np.minimum.reduceat(np.minimum(np.minimum(one, two), three)[order], first)
    high = np.maximum.reduceat(np.maximum(np.maximum(one, two), three)[order], first)
    unit = np.empty(len(order), np.intp)
    unit[order] = np.cumsum(starts) - 1
    return np.stack([low, high], axis=1).astype(np.float64), np.searchsorted(begins, first, side="right") - 1, unit


def _tree(boxes: NDArray[np.float64], piece: NDArray[np.intp]) -> _Node:
    """A binary tree of units: the largest leaf is split again and again, between pieces if it has several."""
    root = _Node(np.arange(len(boxes)), _radius2(boxes))
    made = [root]
    waiting = [(-root.radius2, 0)]
    leaves = 1
    while waiting and leaves < _LEAVES:
        node = made[heapq.heappop(waiting)[1]]
        first = _first_half(boxes[node.rows], piece[node.rows])
        if first is None:
            continue
        one, other = node.rows[first], node.rows[~first]
        node.children = _Node(one, _radius2(boxes[one])), _Node(other, _radius2(boxes[other]))
        for child in node.children:
            heapq.heappush(waiting, (-child.radius2, len(made)))
            made.append(child)
        leaves += 1
    for node in reversed(made):  # children before their parents
        _weigh(node)
    return root


def _weigh(node: _Node) -> None:
    """Set `least` and `left` from those of the children."""
    node.least = np.full(MOST_TARGETS, node.radius2)
    node.left = np.zeros(MOST_TARGETS, np.intp)
    if node.children is None:
        return
    node.leaves = sum(child.leaves for child in node.children)
    most = min(node.leaves, MOST_TARGETS)  # more spheres than leaves do no better
    one, other = (child.least for child in node.children)
    sums = np.where(_SOME_LEFT[:most, :most], one[:most] + other[_REST[:most, :most]], np.inf)
    best = np.argmin(sums, axis=1)
    least = sums[np.arange(most), best]
    pays = np.flatnonzero(least < GAIN * node.radius2)
    node.least[pays], node.left[pays] = least[pays], best[pays] + 1
    node.least[most:], node.left[most:] = node.least[most - 1], node.left[most - 1]


def _best_cut(node: _Node, most: int) -> list[NDArray[np.intp]]:
    """Triangles of each of the best spheres, at most so many."""
    left = int(node.left[most - 1])
    if node.children is None or left == 0:
        return [node.rows]
    return _best_cut(node.children[0], left) + _best_cut(node.children[1], most - left)


def _radius2(boxes: NDArray[np.float64]) -> float:
    """Squared radius of the sphere about the middle of the box around some boxes."""
    center = (boxes[:, 0].min(axis=0) + boxes[:, 1].max(axis=0)) / 2.0
    return float(_square(np.maximum(center - boxes[:, 0], boxes[:, 1] - center)).max())


def _square(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squared lengths, by columns: NumPy is slow at sums of three."""
    x, y, z = vectors.T
    squares: NDArray[np.float64] = x * x + y * y + z * z
    return squares


def _numbered(piece: NDArray[np.intp]) -> tuple[NDArray[np.intp], int]:
    """Which of the pieces that some units belong to, in their order, each belongs to; and how many there are."""
    if (piece == piece[0]).all():
        return np.zeros(len(piece), np.intp), 1
    there = np.zeros(int(piece.max()) + 1, np.bool_)
    there[piece] = True
    number = np.cumsum(there) - 1
    return number[piece], int(number[-1]) + 1


def _first_half(boxes: NDArray[np.float64], piece: NDArray[np.intp]) -> NDArray[np.bool_] | None:
    """Which units go to the first of two halves, by the best of all planes across the axes; None for a single unit.

    Halves are compared by the diagonals of their boxes, which bound the spheres.
    """
    low, high = boxes[:, 0], boxes[:, 1]
    member, pieces = _numbered(piece)
    if pieces == 1:
        member = np.arange(len(boxes))
    else:
        order = np.argsort(member, kind="stable")
        first = np.searchsorted(member[order], np.arange(pieces))
        low, high = np.minimum.reduceat(low[order], first), np.maximum.reduceat(high[order], first)
    # Of a few pieces one may be split off; of many, and of a surface in one piece, the best planes are often at the
    # very edge, and the tree would not get on.
    edge = len(low) // 4 if pieces == 1 or pieces > 64 else 0
    best, chosen = np.inf, None
    for axis in range(3):
        order = np.argsort(low[:, axis] + high[:, axis], kind="stable")
        lows, highs = low[order], high[order]
        before = _square(np.maximum.accumulate(highs) - np.minimum.accumulate(lows))[:-1]
        after = _square(np.maximum.accumulate(highs[::-1]) - np.minimum.accumulate(lows[::-1]))[::-1][1:]
        cost = (before + after)[edge : len(before) - edge]
        if len(cost) and cost.min() < best:
            best, plane = float(cost.min()), edge + int(np.argmin(cost))
            rank = np.empty(len(order), np.intp)
            rank[order] = np.arange(len(order))
            chosen = rank[member] <= plane
    return chosen
