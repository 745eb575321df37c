"""A tree over triangles, built on all cores of the host: the same on any number of them.

What holds a large part of the triangles is split first, by one thread for each such node, and what is below is built
side by side, a subtree a launch. Subtrees end up one after another, each in one piece.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import DTypeLike, NDArray

from wdpm.kernels.quick_launch import launch
from wdpm.kernels.rays.bvh_build import (
    BINS,
    MAX_DEPTH,
    MAX_TRIANGLES,
    RANGES,
    WIDTH,
    Scratch,
    box_triangles,
    build_nodes,
    pack_leaves,
)
from wdpm.kernels.rays.lanes import vec8, vec8i

Run = Callable[[wp.Kernel, Sequence[tuple[int, Sequence[Any]]]], None]
"""Called as run(kernel, launches), like `launch.Launcher.run`: each launch is how many threads, and their arguments."""

PARTS = 64
"""Subtrees about, where there are enough triangles: so many that sixteen cores end together."""

LEAST_PART = 1 << 12
"""Triangles of a range that is worth a launch of its own: a millisecond and more."""

PIECE = 1 << 15
"""Triangles or nodes of a launch of what is done to each."""


@dataclass(frozen=True)
class Tree:
    """The arrays of a tree, on the host; bvh.Bvh describes them."""

    bounds: wp.array
    children: wp.array
    corners: wp.array
    ids: wp.array


def build_tree(positions: NDArray[np.float32], ids: NDArray[np.int32], pad: float, run: Run | None = None) -> Tree:
    """Build a tree.

    Args:
        positions, ids, pad: as for bvh.build.
        run: runs kernels on the CPU, on several threads perhaps; None for this one.
    """
    count = len(positions)
    if np.shape(positions) != (count, 3, 3) or np.shape(ids) != (count,):
        raise ValueError(f"positions {np.shape(positions)} and ids {np.shape(ids)}: expected [T, 3, 3] and [T]")
    if count > MAX_TRIANGLES:
        raise ValueError(f"{count} triangles in one tree: at most {MAX_TRIANGLES}; use more cells")
    if not 0.0 <= pad < np.inf:
        raise ValueError(f"pad {pad}: expected a finite number, at least 0")
    if count and not (np.isfinite(positions.min()) and np.isfinite(positions.max())):
        raise ValueError("positions that are not finite: drop such triangles when the scene is loaded")
    run = _run_here if run is None else run
    corners_in = _as_warp(positions, np.float32, wp.vec3)
    ids_in = _as_warp(ids, np.int32, wp.int32)
    bounds, children, order = _Builder(corners_in, count, pad, run).build()
    corners = wp.zeros(9 * count + WIDTH, dtype=wp.float32, device="cpu")
    leaf_ids = wp.empty(count, dtype=wp.int32, device="cpu")
    inputs = [corners_in, ids_in, order, children, corners, leaf_ids]
    run(pack_leaves, [(size, [*inputs, start]) for start, size in _pieces(len(children))])
    return Tree(bounds, children, corners, leaf_ids)


def _run_here(kernel: wp.Kernel, launches: Sequence[tuple[int, Sequence[Any]]]) -> None:
    for size, inputs in launches:
        launch(kernel, size, inputs, "cpu")


def _pieces(count: int) -> list[tuple[int, int]]:
    """Start and size of what so many items are done in."""
    return [(start, min(PIECE, count - start)) for start in range(0, count, PIECE)]


def _as_warp(values: NDArray[Any], scalar: DTypeLike, dtype: Any) -> wp.array:
    """The same values, not copied where they lie as kernels want them."""
    return wp.array(np.require(values, scalar, ["C", "A"]), dtype=dtype, device="cpu", copy=not len(values))


@dataclass(frozen=True)
class _Range:
    """Triangles that lie one after another in build order, for which there is to be a node.

    Attributes:
        begin, end: which.
        depth: of the node.
        parent, lane: whose child it is; of the root -1.
    """

    begin: int
    end: int
    depth: int
    parent: int = -1
    lane: int = 0

    def __len__(self) -> int:
        return self.end - self.begin

    @property
    def capacity(self) -> int:
        """Nodes of its subtree at most.

        A node whose children are all leaves has more than LEAF_MAX triangles; any other has all eight children. So B of
        the first kind and L further leaves make at most B + (B + L) / 7 nodes, with 9 B + L <= len(self).
        """
        return len(self) // (WIDTH - 1) + 1


class _Builder:
    """Bounds and children of all nodes, and the rows of the triangles in leaf order.

    Args:
        corners: of so many triangles.
    """

    def __init__(self, corners: wp.array, count: int, pad: float, run: Run) -> None:
        self._whole = _Range(0, count, 0)
        self._run = run
        self._scratch = scratch = Scratch()
        scratch.boxes = wp.empty(count, dtype=vec8, device="cpu")
        scratch.order = wp.empty(count, dtype=wp.int32, device="cpu")
        run(box_triangles, [(size, [corners, pad, scratch, start]) for start, size in _pieces(count)])
        self._rooms = 0
        self._most = max(count // PARTS, LEAST_PART)
        # Of a level at most PARTS nodes are large. Behind them there is room for each subtree.
        self._subtrees_from = PARTS * int(MAX_DEPTH) if count > self._most else 0
        capacity = self._subtrees_from * int(WIDTH) + self._whole.capacity
        self._bounds = wp.empty(6 * capacity, dtype=vec8, device="cpu")
        self._children = wp.empty(capacity, dtype=vec8i, device="cpu")

    def build(self) -> tuple[wp.array, wp.array, wp.array]:
        """Bounds and children of all nodes, and the rows of the triangles in leaf order."""
        waiting, alone = [self._whole], list[_Range]()
        while large := [each for each in waiting if len(each) > self._most]:
            numbers = len(alone) + np.arange(len(large))
            self._build(large, numbers, whole=False)
            below = [
                child
                for room, (each, number) in enumerate(zip(large, numbers, strict=True))
                for child in self._below(room, each, int(number))
            ]
            waiting = [each for each in waiting if len(each) <= self._most] + below
            alone += large
        rooms = np.array([each.capacity for each in waiting])
        firsts = self._subtrees_from + np.cumsum(rooms) - rooms
        nodes = self._build(waiting, firsts, whole=True)
        bounds, children = self._joined(alone, waiting, firsts, nodes)
        return bounds, children, self._scratch.order

    def _build(self, ranges: Sequence[_Range], firsts: NDArray[np.int64], *, whole: bool) -> NDArray[np.int32]:
        """Build the nodes of some ranges, numbered from `firsts` on: whole subtrees, or their roots alone.

        Returns:
            the nodes of each that have numbers, shape [len(ranges)].
        """
        tasks = np.array(
            [(each.begin, each.end, first, each.depth) for each, first in zip(ranges, firsts, strict=True)]
        )
        self._make_rooms(len(ranges) if whole else PARTS)
        sizes = wp.zeros(len(ranges), dtype=wp.vec2i, device="cpu")
        inputs = [self._scratch, wp.array(tasks.astype(np.int32), dtype=wp.vec4i, device="cpu"), int(whole)]
        outputs = [self._bounds, self._children, sizes]
        self._run(build_nodes, [(size, [*inputs, *outputs, start]) for start, size in _groups(ranges)])
        nodes, levels = sizes.numpy().T
        if whole and ((nodes > [each.capacity for each in ranges]).any() or levels.max() > MAX_DEPTH):
            raise RuntimeError(f"a tree of {len(self._whole)} triangles: {nodes} nodes, {levels.max()} levels")
        return nodes

    def _make_rooms(self, count: int) -> None:
        """Working memory for so many ranges at once, if there is not enough."""
        if count <= self._rooms:
            return
        scratch, self._rooms = self._scratch, count
        scratch.bin_boxes = wp.empty(count * 3 * BINS, dtype=vec8, device="cpu")
        scratch.bin_counts = wp.empty(count * 3 * BINS, dtype=wp.int32, device="cpu")
        scratch.right_areas = wp.empty(count * BINS, dtype=wp.float32, device="cpu")
        scratch.slot_boxes = wp.empty(count * WIDTH, dtype=vec8, device="cpu")
        scratch.slot_begin = wp.empty(count * WIDTH, dtype=wp.int32, device="cpu")
        scratch.slot_end = wp.empty(count * WIDTH, dtype=wp.int32, device="cpu")
        scratch.ranges = wp.empty(count * RANGES, dtype=wp.vec4i, device="cpu")

    def _below(self, room: int, node: _Range, number: int) -> list[_Range]:
        """What is to be built below a node that was built alone, in the room of that number."""
        lanes = np.flatnonzero(self._children.numpy()[number] > 0)
        ranges = self._scratch.ranges.numpy()[room * RANGES :][: len(lanes)]
        return [
            _Range(int(begin), int(end), node.depth + 1, number, int(lane))
            for (begin, end, _, _), lane in zip(ranges, lanes, strict=True)
        ]

    def _joined(
        self, alone: Sequence[_Range], subtrees: Sequence[_Range], firsts: NDArray[np.int64], nodes: NDArray[np.int32]
    ) -> tuple[wp.array, wp.array]:
        """All nodes one after another: those that were built alone, and each subtree.

        Args:
            firsts: number of each subtree's root so far.
            nodes: how many each subtree has.
        """
        tops = len(alone)
        ends = tops + np.cumsum(nodes, dtype=np.int64)
        starts = ends - nodes
        from_bounds, from_codes = self._bounds.numpy().reshape(-1, 48), self._children.numpy()
        bounds, codes = np.empty((int(ends[-1]), 48), np.float32), np.empty((int(ends[-1]), 8), np.int32)
        bounds[:tops], codes[:tops] = from_bounds[:tops], from_codes[:tops]
        for old, count, new, end in zip(firsts, nodes, starts, ends, strict=True):
            bounds[new:end] = from_bounds[old : old + count]
            moved = from_codes[old : old + count]
            codes[new:end] = np.where(moved > 0, moved + (new - old), moved)
        for each, number in zip((*alone, *subtrees), (*range(tops), *starts), strict=True):
            if each.parent >= 0:
                codes[each.parent, each.lane] = number
        whole = wp.array(bounds.reshape(-1, 8), dtype=vec8, device="cpu", copy=False)
        return whole, wp.array(codes, dtype=vec8i, device="cpu", copy=False)


def _groups(ranges: Sequence[_Range]) -> list[tuple[int, int]]:
    """Start and size of ranges that follow each other, and are worth a launch together."""
    groups, start, triangles = [], 0, 0
    for place, each in enumerate(ranges, 1):
        triangles += len(each)
        if triangles >= LEAST_PART or place == len(ranges):
            groups.append((start, place - start))
            start, triangles = place, 0
    return groups
