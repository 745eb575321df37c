"""Regions of space that hold equally many of some places: the leaves of a kd-tree that halves them by number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Regions:
    """A complete kd-tree, in heap order as cluster.world.TopTree.

    Attributes:
        axis: int32, shape [2^levels - 1].
        split: a point lies in the left child iff point[axis] < split; float32, shape [2^levels - 1].
        nodes: of each level, the root's first, in which of its nodes each place lies, counted from 0; shape [places].
    """

    axis: NDArray[np.int32]
    split: NDArray[np.float32]
    nodes: list[NDArray[np.int64]]

    def of(self, places: NDArray[np.float32]) -> NDArray[np.int64]:
        """The region of each of some places."""
        return self._descend(places)[-1]

    def _descend(self, places: NDArray[np.float32]) -> list[NDArray[np.int64]]:
        levels = (len(self.axis) + 1).bit_length() - 1
        node = np.zeros(len(places), np.int64)
        found = [node]
        for level in range(levels):
            heap = node + (1 << level) - 1
            right = places[np.arange(len(places)), self.axis[heap]] >= self.split[heap]
            node = 2 * node + right
            found.append(node)
        return found


EVEN = 3
"""A node's smaller part holds at least one of so many of its places, if any side can be cut so."""


def _cut(places: NDArray[np.float32]) -> tuple[int, np.float32]:
    """Axis and place of a cut that halves some places: along the longest side, or the next where that is uneven.

    Of places on a wall most have one and the same coordinate: across it there is no halfway.
    """
    sides = places.max(axis=0) - places.min(axis=0)
    best, most = (0, places[0, 0]), -1
    for axis in (int(each) for each in np.argsort(-sides, kind="stable")):
        along = places[:, axis]
        split = _halfway(along)
        left = int(np.count_nonzero(along < split))
        smaller = min(left, len(places) - left)
        if EVEN * smaller >= len(places):
            return axis, split
        if smaller > most:
            best, most = (axis, split), smaller
    return best


def _halfway(along: NDArray[np.float32]) -> np.float32:
    """What parts some numbers in two halves; where the least of them are half of all, these from the others."""
    middle: np.float32 = np.partition(along, len(along) // 2)[len(along) // 2]
    if middle > along.min() or middle == along.max():
        return middle
    above: np.float32 = along[along > middle].min()
    return above


def divide(places: NDArray[np.float32], least: int) -> Regions:
    """Regions of at least about so many places each, halved along the longest side that can be halved.

    Args:
        places: float32, shape [N, 3].
    """
    levels = max(0, (len(places) // least).bit_length() - 1)
    axis, split = np.zeros((1 << levels) - 1, np.int32), np.zeros((1 << levels) - 1, np.float32)
    inside = [np.arange(len(places))]
    for heap in range(len(axis)):
        own = inside[heap]
        if len(own):
            held = places[own]
            axis[heap], split[heap] = _cut(held)
            along = held[:, axis[heap]]
        else:
            along = np.zeros(0, np.float32)
        left = along < split[heap]
        inside += [own[left], own[~left]]
    regions = Regions(axis, split, [])
    return Regions(axis, split, regions._descend(places))
