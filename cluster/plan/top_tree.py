"""The top tree: which plane splits the scene, and each part of it, into cells.

The paper takes the first n levels of a surface-area-heuristic kd-tree. A cell is a slave's whole burden, so this one
weighs what a slave must hold, too: a plane's cost is the share of its fuller side, in triangles and in photons with
their ghosts, whichever is worse, and the surface area heuristic decides among planes that balance alike.

Where it is known what a render computes where (plan.forecast.work), planes share that out evenly, as long as no side
needs more than UNEVEN times its share of memory; and in place of areas, which stand for rays that go everywhere alike,
rays are counted that would go from one side to the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.plan.forecast.work import NO_WORK, Work
from wdpm.cluster.world import TopTree

CANDIDATES = 64
"""Planes tried per axis: at even shares of the triangles' and of the photons' places."""

AREA_WEIGHT = 0.1
"""Weight of the surface area heuristic against balance: the expected share of rays that visit both sides costs
forwarding, an uneven burden makes all slaves wait for one. Balance comes first; the area breaks near-ties."""

UNEVEN = 1.5
"""A slave may need so many times its share of the memory for triangles and photons for the sake of equal work ..."""

BEYOND = 10.0
"""... and each further share counts as so many times as much work: where triangles and bands overlap, all planes may be
beyond that."""

CROSSING = 1.0
"""What it costs that a ray goes to another slave, as a share of what is computed of it where it stays: packing it, and
handling it and what comes home in small batches (docs/scaling.md)."""


@dataclass(frozen=True, eq=False)
class _Part:
    """What lies in a node.

    Attributes:
        low, high: corners of the boxes of triangles, cut to the node.
        box: of the node.
        work: what is computed in it, and rays, cut to it.
        workers: how many share it.
    """

    low: NDArray[np.float32]
    high: NDArray[np.float32]
    photons: NDArray[np.float32]
    box: tuple[NDArray[np.float64], NDArray[np.float64]]
    work: Work
    workers: int


@dataclass(frozen=True)
class _Whole:
    """What one worker's even share of the whole scene takes [bytes]; and the width of the band."""

    memory: float
    band: float


def build_top_tree(
    corners: NDArray[np.float32],
    photons: NDArray[np.float32],
    band: float,
    levels: int,
    workers: int | None = None,
    work: Work = NO_WORK,
) -> TopTree:
    """Split a scene into 2^levels cells, of which as many are worth holding as there are workers.

    A node's workers are divided among its children, and its plane divides the burden in the same proportion: three
    workers get a third each. A node that is left with one worker is split beyond everything, so that its other cells
    are empty.

    Args:
        corners: of the triangles, float32, shape [T, 3, 3].
        photons: places of a sample of the photons, float32, shape [P, 3].
        band: width of the overlap band.
        levels: 0 for one cell.
        workers: from 2^(levels - 1) + 1 to 2^levels; None for 2^levels.
        work: that is to be shared out; NO_WORK if nothing is known of it.
    """
    inner = 2**levels - 1
    axis = np.zeros(inner, np.int32)
    split = np.zeros(inner, np.float32)
    low, high = corners.min(axis=1), corners.max(axis=1)
    box = (low.min(axis=0).astype(np.float64), high.max(axis=0).astype(np.float64))
    every = 2**levels if workers is None else workers
    whole = _Whole((len(corners) * work.triangle_bytes + len(photons) * work.photon_bytes) / every, band)
    parts = {0: _Part(low, high, photons, box, work, every)}
    for node in range(inner):
        part = parts.pop(node)
        if part.workers <= 1:
            axis[node], split[node] = 0, _beyond(corners)
        else:
            axis[node], split[node] = _best_plane(part, whole)
        parts[2 * node + 1], parts[2 * node + 2] = _divided(part, int(axis[node]), split[node], band)
    return TopTree(axis, split)


def _divided(part: _Part, a: int, s: np.float32, band: float) -> tuple[_Part, _Part]:
    """Both sides of a plane."""
    low, high, photons, (box_low, box_high) = part.low, part.high, part.photons, part.box
    left_box, right_box = box_high.copy(), box_low.copy()
    left_box[a] = right_box[a] = s
    left, right = low[:, a] < s, high[:, a] >= s
    # Triangles are cut at the plane, so that a long one counts in each part for what lies in it.
    left_high, right_low = high[left].copy(), low[right].copy()
    left_high[:, a] = np.minimum(left_high[:, a], s)
    right_low[:, a] = np.maximum(right_low[:, a], s)
    left_work, right_work = part.work.divided(a, s)
    workers = (part.workers + 1) // 2
    return (
        _Part(low[left], left_high, photons[photons[:, a] < s + band], (box_low, left_box), left_work, workers),
        _Part(
            right_low,
            high[right],
            photons[photons[:, a] >= s - band],
            (right_box, box_high),
            right_work,
            part.workers - workers,
        ),
    )


def photons_in_cells(position: NDArray[np.float32], tree: TopTree) -> NDArray[np.int64]:
    """How many points lie in each cell, shape [cells]."""
    return np.bincount(cells_of(position, tree), minlength=tree.cells)


def cells_of(position: NDArray[np.float32], tree: TopTree) -> NDArray[np.intp]:
    """The cell that each point lies in, shape [points]."""
    node = np.zeros(len(position), np.intp)
    inner = len(tree.axis)
    while inner and (node < inner).any():
        at = np.minimum(node, inner - 1)
        left = position[np.arange(len(position)), tree.axis[at]] < tree.split[at]
        node = np.where(node < inner, np.where(left, 2 * node + 1, 2 * node + 2), node)
    return node - inner


def cells_seen(position: NDArray[np.float32], seen: NDArray[np.bool_], tree: TopTree) -> NDArray[np.int32]:
    """The cell that each pixel of a grid sees, -1 for none, shape [rows, columns]: of plan.forecast.sight.Sight."""
    cells = np.full(seen.shape, -1, np.int32)
    cells[seen] = cells_of(position[seen], tree)
    return cells


def _best_plane(part: _Part, whole: _Whole) -> tuple[int, np.float32]:
    """The axis and the place of the plane that comes nearest to giving the left side its share."""
    box_low, box_high = part.box
    best = (np.inf, 0, np.float32((box_low[0] + box_high[0]) / 2))
    for a in range(3):
        planes = _candidates(part.low[:, a], part.high[:, a], np.concatenate([part.photons, part.work.place])[:, a])
        planes = planes[(planes > box_low[a]) & (planes < box_high[a])]
        if not len(planes):
            continue
        cost = _cost(part, whole, a, planes)
        chosen = int(np.argmin(cost))
        best = min(best, (float(cost[chosen]), a, np.float32(planes[chosen])), key=lambda plane: plane[0])
    return best[1], best[2]


def _cost(part: _Part, whole: _Whole, a: int, planes: NDArray[np.float32]) -> NDArray[np.float64]:
    """Of planes across an axis, shape [planes]."""
    starts, ends, place = np.sort(part.low[:, a]), np.sort(part.high[:, a]), np.sort(part.photons[:, a])
    workers = (part.workers + 1) // 2, part.workers // 2
    held = [(starts.searchsorted(planes), len(part.low) - ends.searchsorted(planes))]
    if len(place):
        left, right = place.searchsorted(planes + whole.band), len(place) - place.searchsorted(planes - whole.band)
        held.append((left, right))
    known = float(part.work.seconds.sum())
    if known <= 0.0:
        burden = np.max([_burden(left, right, workers[0] / part.workers) for left, right in held], axis=0)
        return burden + AREA_WEIGHT * _area_share(a, part.box[1] - part.box[0])
    weights = (part.work.triangle_bytes, part.work.photon_bytes)[: len(held)]
    needs = [
        sum(side * of_each for side, of_each in zip(sides, weights, strict=True)) for sides in zip(*held, strict=True)
    ]
    full = np.maximum(needs[0] / workers[0], needs[1] / workers[1]) / max(whole.memory, 1.0)
    before = part.work.before(a, planes)
    busy = np.maximum(before / workers[0], (known - before) / workers[1]) * part.workers / known
    crossing = part.work.crossing(a, planes) / known
    cost: NDArray[np.float64] = busy + CROSSING * crossing + BEYOND * np.maximum(full / UNEVEN - 1.0, 0.0)
    return cost


def _candidates(
    low: NDArray[np.float32], high: NDArray[np.float32], photons: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Places of planes at even shares of the triangles' centres and of the photons, between float neighbours."""
    shares = (np.arange(CANDIDATES) + 0.5) / CANDIDATES
    places = [np.quantile((low + high) / 2, shares)] if len(low) else []
    if len(photons):
        places.append(np.quantile(photons, shares))
    if len(low):
        places.append(low.min() + (high.max() - low.min()) * shares)
    return np.unique(np.concatenate(places).astype(np.float32)) if places else np.zeros(0, np.float32)


def _burden(left: NDArray[np.intp], right: NDArray[np.intp], left_share: float) -> NDArray[np.float64]:
    """What the fuller side holds against its share of a split without overlap: 1 is perfect."""
    total = max(int((left + right).min()), 1)
    burden: NDArray[np.float64] = np.maximum(left / left_share, right / (1.0 - left_share)) / total
    return burden


def _beyond(corners: NDArray[np.float32]) -> np.float32:
    """A place on an axis that nothing of the scene comes near."""
    return np.float32(16.0 * np.abs(corners).max(initial=1.0))


def _area_share(axis: int, extent: NDArray[np.float64]) -> float:
    """Areas of both sides over that of the whole: the mean number of sides that a ray through the box visits."""
    others = [extent[i] for i in range(3) if i != axis]
    face = others[0] * others[1]
    whole = face + extent[axis] * (others[0] + others[1])
    return 1.0 + (face / whole if whole > 0 else 0.0)
