"""Making outlines: few boxes around all triangles of each cell, for rays to pass it by where it is empty.

A cell's boxes are the leaves of a small tree over the boxes of its triangles, each cut off where the cell ends. The
leaf whose split saves most surface, that is most rays that meet it for nothing, is split next, until there are
MOST_BOXES. Lamps have leaves of their own: every shadow ray ends at one.

The box of a face that stands askew, or of a triangle, has a plane, but in it corners where there is nothing, and rays
that go by an edge of the face meet those. Where a cell has boxes to spare, such a face is covered by strips.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
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

STRIPS = 16
"""Boxes that a face is covered by in place of one, ..."""

WORTH_STRIPS = 0.9
"""... if they cover no more than this share of what it would."""

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


Plane = tuple[Boxes, Boxes]


@dataclass(frozen=True, eq=False)
class _Leaf:
    """A box, shape [3] each corner, the rows of what lies in it, and the plane of that, if it has one."""

    low: Boxes
    high: Boxes
    rows: NDArray[np.intp]
    plane: Plane | None

    @property
    def across(self) -> int:
        """The axis that the plane's normal is nearest to."""
        return 0 if self.plane is None else int(np.abs(self.plane[0]).argmax())

    @property
    def area(self) -> float:
        """Of the box as it is seen along that axis."""
        return float(np.delete(self.high - self.low, self.across).prod())


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
        writer.add([(_grown(items, most), most) for items, most in found if len(items)])
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
        self._planes: list[Plane] = []

    def add(self, trees: Sequence[tuple[_Node, int]]) -> None:
        """The trees of the next cell, one behind the other, and how many boxes each may have."""
        for tree, most in trees:
            leaves = list(self._leaves(tree))
            for leaf in leaves if len(leaves) == most else self._of_faces(leaves, most):
                self._low.append(leaf.low)
                self._high.append(leaf.high)
                self._plane.append(-1 if leaf.plane is None else len(self._planes))
                if leaf.plane is not None:
                    self._planes.append(leaf.plane)
        self._first.append(len(self._low))

    def _leaves(self, node: _Node) -> Iterator[_Leaf]:
        for child in node.children:
            yield from self._leaves(child)
        if not node.children:
            items = node.items
            plane = plane_of(self._corners, items.row, self._extent)
            yield _Leaf(items.low.min(axis=0), items.high.max(axis=0), items.row, plane)

    def _of_faces(self, leaves: Sequence[_Leaf], most: int) -> Iterator[_Leaf]:
        """The same with faces in place of leaves that overlap in a plane, and strips of faces; `most` in all."""
        left = most - len(leaves)
        for parts in self._overlapping(leaves):
            face = self._joined(parts)
            if face is None:
                yield from parts
                continue
            before = min(face.area, sum(part.area for part in parts))
            strips = self._strips(face) if left + len(parts) >= STRIPS else []
            if strips and sum(strip.area for strip in strips) <= WORTH_STRIPS * before:
                left += len(parts) - len(strips)
                yield from strips
            elif face.area <= before:
                yield face
            else:
                yield from parts

    def _overlapping(self, leaves: Sequence[_Leaf]) -> Iterator[list[_Leaf]]:
        """Leaves of one plane whose boxes overlap; each that has no plane alone."""
        of_plane: dict[tuple[float, ...], list[list[_Leaf]]] = {}
        for leaf in leaves:
            if leaf.plane is None:
                yield [leaf]
                continue
            normal, slab = leaf.plane
            turned = np.sign(normal[leaf.across])
            place = turned * slab[:2].mean() / (FLAT * self._extent)
            key = *np.round(turned * normal, 6).tolist(), float(np.round(place))
            near: list[_Leaf] = [leaf]
            apart = []
            for group in of_plane.get(key, ()):
                if any(bool(((leaf.low <= other.high) & (leaf.high >= other.low)).all()) for other in group):
                    near += group
                else:
                    apart.append(group)
            of_plane[key] = [*apart, near]
        for groups in of_plane.values():
            yield from groups

    def _joined(self, parts: Sequence[_Leaf]) -> _Leaf | None:
        """One box around all parts of a plane; None if they have no plane together."""
        rows = np.unique(np.concatenate([part.rows for part in parts]))
        low = np.min([part.low for part in parts], axis=0)
        high = np.max([part.high for part in parts], axis=0)
        plane = plane_of(self._corners, rows, self._extent) if parts[0].plane is not None else None
        return None if plane is None else _Leaf(low, high, rows, plane)

    def _strips(self, face: _Leaf) -> list[_Leaf]:
        """A face in STRIPS boxes along the longer side of its box, those left out that hold nothing of it."""
        own = self._corners[face.rows].astype(np.float64)
        size = face.high - face.low
        size[face.across] = -1.0
        along = int(size.argmax())
        ends = np.linspace(face.low[along], face.high[along], STRIPS + 1)
        strips = []
        for begin, end in pairwise(ends):
            corners = own.reshape(-1, 3)
            inside = corners[(corners[:, along] >= begin) & (corners[:, along] <= end)]
            points = np.concatenate([inside, *(_crossings(own, along, place) for place in (begin, end))])
            if not len(points):
                continue
            low, high = np.maximum(points.min(axis=0), face.low), np.minimum(points.max(axis=0), face.high)
            if (low <= high).all():
                strips.append(_Leaf(low, high, face.rows, face.plane))
        return strips

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


def _crossings(corners: Boxes, axis: int, place: float) -> Boxes:
    """Where edges of triangles, shape [N, 3, 3], cross a plane across an axis, shape [crossings, 3]."""
    begin, end = corners.reshape(-1, 3), np.roll(corners, -1, axis=1).reshape(-1, 3)
    crosses = (begin[:, axis] - place) * (end[:, axis] - place) < 0.0
    begin, end = begin[crosses], end[crosses]
    share = (place - begin[:, axis]) / (end[:, axis] - begin[:, axis])
    points: Boxes = begin + share[:, None] * (end - begin)
    return points


def _rounded(values: Boxes, towards: float) -> NDArray[np.float32]:
    """To float32, never inwards."""
    near = values.astype(np.float32)
    inwards = near > values if towards < 0 else near < values
    return np.where(inwards, np.nextafter(near, np.float32(towards)), near)


def plane_of(corners: NDArray[np.float32], rows: NDArray[np.intp], extent: float) -> Plane | None:
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
