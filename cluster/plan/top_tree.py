"""The top tree: which plane splits the scene, and each part of it, into cells.

The paper takes the first n levels of a surface-area-heuristic kd-tree. A cell is a slave's whole burden, so this one
weighs what a slave must hold, too: a plane's cost is the share of its fuller side, in triangles and in photons with
their ghosts, whichever is worse, and the surface area heuristic decides among planes that balance alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.world import TopTree

CANDIDATES = 64
"""Planes tried per axis: at even shares of the triangles' and of the photons' places."""

AREA_WEIGHT = 0.1
"""Weight of the surface area heuristic against balance: the expected share of rays that visit both sides costs
forwarding, an uneven burden makes all slaves wait for one. Balance comes first; the area breaks near-ties."""

MAX_LEVELS = 8


def build_top_tree(
    corners: NDArray[np.float32], photons: NDArray[np.float32], band: float, levels: int, workers: int | None = None
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
    """
    inner = 2**levels - 1
    axis = np.zeros(inner, np.int32)
    split = np.zeros(inner, np.float32)
    low, high = corners.min(axis=1), corners.max(axis=1)
    box = (low.min(axis=0).astype(np.float64), high.max(axis=0).astype(np.float64))
    seats = {0: 2**levels if workers is None else workers}
    parts = {0: (low, high, photons, box)}
    for node in range(inner):
        low, high, photons, (box_low, box_high) = parts.pop(node)
        all_seats = seats.pop(node)
        left_seats = (all_seats + 1) // 2
        seats[2 * node + 1], seats[2 * node + 2] = left_seats, all_seats - left_seats
        if all_seats <= 1:
            axis[node], split[node] = 0, _beyond(corners)
        else:
            axis[node], split[node] = _best_plane(low, high, photons, band, box_low, box_high, left_seats / all_seats)
        a, s = axis[node], split[node]
        left, right = low[:, a] < s, high[:, a] >= s
        left_box, right_box = box_high.copy(), box_low.copy()
        left_box[a] = right_box[a] = s
        # Triangles are cut at the plane, so that a long one counts in each part for what lies in it.
        left_high, right_low = high[left].copy(), low[right].copy()
        left_high[:, a] = np.minimum(left_high[:, a], s)
        right_low[:, a] = np.maximum(right_low[:, a], s)
        parts[2 * node + 1] = (low[left], left_high, photons[photons[:, a] < s + band], (box_low, left_box))
        parts[2 * node + 2] = (right_low, high[right], photons[photons[:, a] >= s - band], (right_box, box_high))
    return TopTree(axis, split)


def photons_in_cells(position: NDArray[np.float32], tree: TopTree) -> NDArray[np.int64]:
    """How many points lie in each cell, shape [cells]."""
    node = np.zeros(len(position), np.intp)
    inner = len(tree.axis)
    while inner and (node < inner).any():
        at = np.minimum(node, inner - 1)
        left = position[np.arange(len(position)), tree.axis[at]] < tree.split[at]
        node = np.where(node < inner, np.where(left, 2 * node + 1, 2 * node + 2), node)
    return np.bincount(node - inner, minlength=tree.cells)


def _best_plane(
    low: NDArray[np.float32],
    high: NDArray[np.float32],
    photons: NDArray[np.float32],
    band: float,
    box_low: NDArray[np.float64],
    box_high: NDArray[np.float64],
    left_share: float,
) -> tuple[int, np.float32]:
    """The axis and the place of the plane that comes nearest to giving the left side its share."""
    best = (np.inf, 0, np.float32((box_low[0] + box_high[0]) / 2))
    extent = box_high - box_low
    for a in range(3):
        planes = _candidates(low[:, a], high[:, a], photons[:, a])
        planes = planes[(planes > box_low[a]) & (planes < box_high[a])]
        if not len(planes):
            continue
        starts, ends = np.sort(low[:, a]), np.sort(high[:, a])
        cost = _burden(starts.searchsorted(planes), len(low) - ends.searchsorted(planes), left_share)
        if len(photons):
            place = np.sort(photons[:, a])
            left, right = place.searchsorted(planes + band), len(place) - place.searchsorted(planes - band)
            cost = np.maximum(cost, _burden(left, right, left_share))
        cost = cost + AREA_WEIGHT * _area_share(a, extent)
        chosen = int(np.argmin(cost))
        best = min(best, (float(cost[chosen]), a, np.float32(planes[chosen])), key=lambda plane: plane[0])
    return best[1], best[2]


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
