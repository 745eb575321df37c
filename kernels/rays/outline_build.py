"""Making outlines: few boxes around all triangles of each cell, for rays to pass it by where it is empty.

A cell's boxes are the leaves of a small tree over the boxes of its triangles, each cut off where the cell ends. The
leaf whose split saves most surface, that is most rays that meet it for nothing, is split next, until there are
MOST_BOXES. Lamps have leaves of their own: every shadow ray ends at one.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.rays.outlines import REACH_SHARE, SLAB_SHARE
from wdpm.scenes.flat.room import let_go

MOST_BOXES = 112
"""Of a cell; MOST_LAMPS more for lamps: two groups of kernels.rays.outlines in all."""

MOST_LAMPS = 16

LATTICE = 20
"""Blocks along a side of a lattice: of many triangles, those whose middles lie in one block are put together first."""

MOST_LARGE = 1 << 12
"""Triangles that are not put together with others, since they are large."""

LARGE_SHARE = 16
"""Triangles longer than the part of a cell with this divisor are large."""

MANY = 1 << 13
"""Triangles of a cell that are not put together."""

AT_ONCE = 1 << 19
"""Triangles that are looked at together."""

MOST_IN_PLANE = 64
"""Triangles of a leaf that are looked through for a plane that they lie in."""

FLAT = 2.0**-21
"""How thick a leaf with a plane may be, as a share of the scene's extent."""

LEAST_SHAPE = 2.0**-4
"""Twice the area of a triangle in a plane over the square of its longest edge, at least."""

Boxes = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Items:
    """Boxes, shape [N, 3], and the row of the triangle that each is of; -1 for that of several, or of an instance."""

    low: Boxes
    high: Boxes
    row: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.low)

    def take(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Items:
        return Items(self.low[which], self.high[which], self.row[which])


NO_ITEMS = Items(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.intp))


@dataclass(eq=False)
class _Node:
    """A node of a cell's tree; a leaf while it has no children."""

    items: Items
    children: tuple[_Node, ...] = ()


def build_outlines(
    corners: NDArray[np.float32],
    emitter: NDArray[np.int32],
    cells: tuple[NDArray[np.float32], NDArray[np.float32]],
    rows: Sequence[NDArray[np.intp]],
    others: Sequence[Items],
    extent: float,
) -> dict[str, NDArray[Any]]:
    """Boxes of all cells: what outlines.upload takes.

    Args:
        corners: of triangles, shape [T, 3, 3].
        cells: lower and upper corners of the cells.
        emitter: below 0 for those that emit nothing, shape [T].
        rows: of the triangles that each cell holds.
        others: boxes of what else each cell holds.
    """
    cell_low, cell_high = (corner.astype(np.float64) for corner in cells)
    grow = 2.0 * PAD_SHARE * extent
    writer = _Writer(corners, extent)
    for held, other, low, high in zip(rows, others, cell_low - grow, cell_high + grow, strict=True):
        lamp = emitter[held] >= 0
        lamps = _items_of(corners, held[lamp], low, high, extent)
        rest = _joined([_items_of(corners, held[~lamp], low, high, extent), _cut(other, low, high)])
        found = (rest, MOST_BOXES), (lamps, MOST_LAMPS)
        writer.add([_grown(items, most) for items, most in found if len(items)])
    return writer.tables()


def _items_of(corners: NDArray[np.float32], rows: NDArray[np.intp], low: Boxes, high: Boxes, extent: float) -> Items:
    """What is to be put into boxes: triangles, or blocks of a lattice where there are very many."""
    if len(rows) <= MANY:
        return _cut(_boxes_of(corners, rows), low, high)
    large = (np.minimum(high, extent) - np.maximum(low, -extent)).max() / LARGE_SHARE
    parts = []
    room = MOST_LARGE
    for first in range(0, len(rows), AT_ONCE):
        some = rows[first : first + AT_ONCE]
        items = _cut(_boxes_of(corners, some), low, high)
        let_go(corners[some[0] : some[-1] + 1])
        alone = np.flatnonzero((items.high - items.low > large).any(axis=1))[:room]
        room -= len(alone)
        rest = np.ones(len(items), np.bool_)
        rest[alone] = False
        parts += [items.take(alone), _put_together(items.take(rest))]
    return _joined(parts)


def _boxes_of(corners: NDArray[np.float32], rows: NDArray[np.intp]) -> Items:
    a, b, c = (corners[rows, corner] for corner in range(3))
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    return Items(low.astype(np.float64), high.astype(np.float64), rows)


def _put_together(items: Items) -> Items:
    """Items of which those are one whose middles lie in the same block of a lattice."""
    if not len(items):
        return items
    middle = items.low + items.high
    start, size = middle.min(axis=0), np.maximum(np.ptp(middle, axis=0), np.finfo(np.float32).tiny)
    place = np.minimum((middle - start) / size * LATTICE, LATTICE - 1).astype(np.intp)
    block = np.ravel_multi_index(tuple(place.T), (LATTICE, LATTICE, LATTICE))
    order = np.argsort(block, kind="stable")
    first = np.unique(block[order], return_index=True)[1]
    low = np.minimum.reduceat(items.low[order], first)
    high = np.maximum.reduceat(items.high[order], first)
    return Items(low, high, np.full(len(first), -1))


def _cut(items: Items, low: Boxes, high: Boxes) -> Items:
    """Boxes, cut off where a cell ends; those are left out that lie beside it."""
    cut = Items(np.maximum(items.low, low), np.minimum(items.high, high), items.row)
    return cut.take(np.flatnonzero((cut.low <= cut.high).all(axis=1)))


def _joined(parts: Sequence[Items]) -> Items:
    return Items(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("low", "high", "row")))


def _grown(items: Items, most: int) -> _Node:
    """A tree over items with so many leaves at most."""
    root = _Node(items)
    number = 0
    waiting = [(-gain, number, root, split) for gain, split in _best_split(items)]
    leaves = 1
    while waiting and leaves < most:
        _, _, node, (left, right) = heapq.heappop(waiting)
        node.children = _Node(node.items.take(left)), _Node(node.items.take(right))
        leaves += 1
        for child in node.children:
            for gain, split in _best_split(child.items):
                number += 1
                heapq.heappush(waiting, (-gain, number, child, split))
    return root


def _best_split(items: Items) -> Iterator[tuple[float, tuple[NDArray[np.intp], NDArray[np.intp]]]]:
    """What the best split of items saves, and what it gives to either side; nothing if none saves any.

    As the surface area heuristic has it: the surface of a box counts once for each item in it.
    """
    count = len(items)
    if count < 2:
        return
    middle = items.low + items.high
    many = np.arange(1, count)
    best: tuple[float, NDArray[np.intp], int] | None = None
    for axis in range(3):
        order = np.argsort(middle[:, axis], kind="stable")
        low, high = items.low[order], items.high[order]
        left = _area(np.minimum.accumulate(low), np.maximum.accumulate(high))[:-1]
        right = _area(np.minimum.accumulate(low[::-1]), np.maximum.accumulate(high[::-1]))[::-1][1:]
        cost = left * many + right * many[::-1]
        at = int(np.argmin(cost))
        if best is None or cost[at] < best[0]:
            best = float(cost[at]), order, at + 1
    whole = count * float(_area(items.low.min(axis=0), items.high.max(axis=0)))
    if best is not None and best[0] < whole:
        yield whole - best[0], (best[1][: best[2]], best[1][best[2] :])


def _area(low: Boxes, high: Boxes) -> Boxes:
    """Half the surface of boxes."""
    size = high - low
    area: Boxes = size[..., 0] * size[..., 1] + size[..., 1] * size[..., 2] + size[..., 2] * size[..., 0]
    return area


class _Writer:
    """Leaves of trees as tables."""

    def __init__(self, corners: NDArray[np.float32], extent: float) -> None:
        self._corners = corners
        self._extent = extent
        self._first = [0]
        self._low: list[Boxes] = []
        self._high: list[Boxes] = []
        self._plane: list[int] = []
        self._planes: list[tuple[Boxes, Boxes]] = []

    def add(self, trees: Sequence[_Node]) -> None:
        """The trees of the next cell, one behind the other."""
        for tree in trees:
            self._write(tree)
        self._first.append(len(self._low))

    def _write(self, node: _Node) -> None:
        for child in node.children:
            self._write(child)
        if not node.children:
            self._low.append(node.items.low.min(axis=0))
            self._high.append(node.items.high.max(axis=0))
            found = plane_of(self._corners, node.items.row, self._extent)
            self._plane.append(-1 if found is None else len(self._planes))
            if found is not None:
                self._planes.append(found)

    def tables(self) -> dict[str, NDArray[Any]]:
        """All of it."""
        return {
            "first": np.array(self._first, np.int32),
            "low": _rounded(np.array(self._low).reshape(-1, 3), -np.inf),
            "high": _rounded(np.array(self._high).reshape(-1, 3), np.inf),
            "plane": np.array(self._plane, np.int32),
            "normal": np.array([normal for normal, _ in self._planes]).reshape(-1, 3),
            "slab": np.array([slab for _, slab in self._planes]).reshape(-1, 3),
        }


def _rounded(values: Boxes, towards: float) -> NDArray[np.float32]:
    """To float32, never inwards."""
    near = values.astype(np.float32)
    inwards = near > values if towards < 0 else near < values
    return np.where(inwards, np.nextafter(near, np.float32(towards)), near)


def plane_of(corners: NDArray[np.float32], rows: NDArray[np.intp], extent: float) -> tuple[Boxes, Boxes] | None:
    """Normal and slab of the plane that triangles lie in (outlines.upload); None if none, or one is badly shaped."""
    if not 0 < len(rows) <= MOST_IN_PLANE or rows.min() < 0:
        return None
    own = corners[rows].astype(np.float64)
    edges = np.roll(own, -1, axis=1) - own
    longest = np.sqrt((edges**2).sum(axis=2).max(axis=1))
    cross = np.cross(edges[:, 0], edges[:, 1])
    doubled = np.sqrt((cross**2).sum(axis=1))
    if (doubled < LEAST_SHAPE * longest**2).any() or longest.min() == 0:
        return None
    largest = int(np.argmax(doubled))
    normal = cross[largest] / doubled[largest]
    along = own.reshape(-1, 3) @ normal
    if along.max() - along.min() > FLAT * extent:
        return None
    grow = SLAB_SHARE * float(longest.max())
    return normal, np.array([along.min() - grow, along.max() + grow, REACH_SHARE * float(longest.min())])
