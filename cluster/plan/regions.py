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


def divide(places: NDArray[np.float32], least: int) -> Regions:
    """Regions of at least about so many places each, halved along the longest side of what a node holds.

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
            axis[heap] = np.argmax(held.max(axis=0) - held.min(axis=0))
            along = held[:, axis[heap]]
            split[heap] = np.partition(along, len(own) // 2)[len(own) // 2]
        else:
            along = np.zeros(0, np.float32)
        left = along < split[heap]
        inside += [own[left], own[~left]]
    regions = Regions(axis, split, [])
    return Regions(axis, split, regions._descend(places))
