"""The photon map: a kd-tree of photons, eight children wide, for range searches with SIMD tests.

The tree is a true kd-tree: every binary node is split along the widest side of its photons' box, in the middle of the
leaves that it might have (kd_order.py). It is stored without pointers: three binary levels make one node with eight
children, whose boxes lie in six rows of eight floats, so that one element-wise expression tests all eight. Leaves hold
eight photons the same way, all but the last. Above the leaves lie as many levels as are needed, the lowest as long as
there are leaves; the root has `fan_out` children, every other node 8, some of which may be empty and have no place. The
children of node i are nodes max(8 i + fan_out - 7, 1) + 0 .. 7, level by level, and node `inner_count` + j is leaf j.
So a photon takes 56 bytes.

It is built in little memory. Columns are let go of as soon as their places in the tree are written, piece by piece.

What a gather returns never depends on this shape (see gather.py), which is free to change.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import warp as wp

from wdpm.kernels.constants import MAX_PHOTON_COORDINATE
from wdpm.kernels.pages import Pages
from wdpm.kernels.photons.kd_order import LEAF_SIZE, Launch, Record, Records, launch_whole, leaf_bits, over
from wdpm.scenes.errors import WdpmError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

vec8 = wp.types.vector(length=8, dtype=wp.float32)

NODE_ROWS = wp.constant(6)  # low x, y, z, high x, y, z of the eight children
LEAF_ROWS = wp.constant(9)  # position x, y, z, normal x, y, z, direction x, y, z of the eight photons
POINT_ROWS = wp.constant(6)  # position x, y, z, normal x, y, z of eight surface points
_EMPTY = wp.constant(float("inf"))

PARENTS_A_PIECE = 1 << 13
"""Of leaves, written before the memory of what they are written from is given back: half a million photons."""

_A_PIECE = 1 << 18
"""Photons that are numbered at once."""


@wp.struct
class PhotonMap:
    """The photons of one partition, on one device."""

    count: wp.int32  # photons in the map
    fan_out: wp.int32  # children of the root: 1, 2, 4 or 8
    inner_count: wp.int32  # inner nodes, had all of them eight children
    nodes: wp.array[
        vec8
    ]  # boxes of the children; empty ones are +inf .. -inf  [6 * nodes up to the last that is there]
    leaves: wp.array[vec8]  # positions, normals, directions; unused places have normal 0  [9, or 6, * leaf count]
    flux: wp.array[wp.vec3]  # flux by place in the leaves  [8 * leaf count]
    rank: wp.array[wp.int32]  # place in the order of ids, by place in the leaves  [8 * leaf count]


@wp.func
def first_child(i: wp.int32, fan_out: wp.int32) -> wp.int32:
    """Number of the first child of inner node i."""
    return wp.max(8 * i + fan_out - 7, 1)


@wp.kernel
def _fill_places(
    position: wp.array[wp.vec3],
    index: wp.array[wp.int32],
    place_of: wp.array[wp.int32],
    offset: wp.int32,
    records_out: wp.array[Record],
) -> None:
    i = offset + wp.tid()
    record = Record()
    record.position = position[i]
    record.index = index[i]
    records_out[place_of[index[i]]] = record


@wp.kernel
def _find_places(records: wp.array[Record], offset: wp.int32, place_out: wp.array[wp.int32]) -> None:
    i = offset + wp.tid()
    place_out[records[i].index] = i


@wp.kernel
def _move(
    column: wp.array[wp.vec3],
    index: wp.array[wp.int32],
    place_of: wp.array[wp.int32],
    offset: wp.int32,
    column_out: wp.array[wp.vec3],
) -> None:
    i = offset + wp.tid()
    column_out[place_of[index[i]]] = column[i]


@wp.kernel
def _pack_leaves(
    records: wp.array[Record],
    normal: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    rows: wp.int32,
    children: wp.int32,
    first: wp.int32,
    first_parent: wp.int32,
    offset: wp.int32,
    nodes_out: wp.array[vec8],
    leaves_out: wp.array[vec8],
    rank_out: wp.array[wp.int32],
) -> None:
    """One thread for each parent of leaves, from the first on: copies its photons into their rows, writes its boxes.

    Args:
        rows: LEAF_ROWS, or POINT_ROWS of what has neither direction nor rank.
    """
    parent = first + offset + wp.tid()
    low_x = vec8(_EMPTY)
    low_y = vec8(_EMPTY)
    low_z = vec8(_EMPTY)
    high_x = vec8(-_EMPTY)
    high_y = vec8(-_EMPTY)
    high_z = vec8(-_EMPTY)
    count = records.shape[0]
    for c in range(children):
        leaf = parent * children + c
        px = vec8(0.0)
        py = vec8(0.0)
        pz = vec8(0.0)
        nx = vec8(0.0)
        ny = vec8(0.0)
        nz = vec8(0.0)
        dx = vec8(0.0)
        dy = vec8(0.0)
        dz = vec8(0.0)
        low = wp.vec3(_EMPTY)
        high = wp.vec3(-_EMPTY)
        begin = 8 * leaf
        for i in range(begin, wp.min(begin + 8, count)):
            record = records[i]
            place = i - begin
            p = record.position
            n = normal[i]
            low = wp.min(low, p)
            high = wp.max(high, p)
            px[place] = p[0]
            py[place] = p[1]
            pz[place] = p[2]
            nx[place] = n[0]
            ny[place] = n[1]
            nz[place] = n[2]
            if rows == LEAF_ROWS:
                d = direction[i]
                dx[place] = d[0]
                dy[place] = d[1]
                dz[place] = d[2]
                rank_out[i] = record.index
        row = rows * leaf
        if row < leaves_out.shape[0]:
            leaves_out[row + 0] = px
            leaves_out[row + 1] = py
            leaves_out[row + 2] = pz
            leaves_out[row + 3] = nx
            leaves_out[row + 4] = ny
            leaves_out[row + 5] = nz
            if rows == LEAF_ROWS:
                leaves_out[row + 6] = dx
                leaves_out[row + 7] = dy
                leaves_out[row + 8] = dz
        low_x[c] = low[0]
        low_y[c] = low[1]
        low_z[c] = low[2]
        high_x[c] = high[0]
        high_y[c] = high[1]
        high_z[c] = high[2]
    row = NODE_ROWS * (first_parent + parent)
    nodes_out[row + 0] = low_x
    nodes_out[row + 1] = low_y
    nodes_out[row + 2] = low_z
    nodes_out[row + 3] = high_x
    nodes_out[row + 4] = high_y
    nodes_out[row + 5] = high_z


@wp.kernel
def _fit_boxes(
    fan_out: wp.int32,
    children: wp.int32,
    first_node: wp.int32,
    end_child: wp.int32,
    offset: wp.int32,
    nodes: wp.array[vec8],
) -> None:
    """The boxes of a node's children enclose those of their children. One thread for each node of a level.

    Args:
        end_child: the node after the last of the next level.
    """
    i = first_node + offset + wp.tid()
    for axis in range(3):
        low = vec8(_EMPTY)
        high = vec8(-_EMPTY)
        for c in range(children):
            number = first_child(i, fan_out) + c
            if number < end_child:
                child = NODE_ROWS * number
                low[c] = wp.min(nodes[child + axis])
                high[c] = wp.max(nodes[child + 3 + axis])
        nodes[NODE_ROWS * i + axis] = low
        nodes[NODE_ROWS * i + 3 + axis] = high


class Parts(Protocol):
    """Photons in several parts, each a set of equally long columns."""

    def lengths(self) -> Sequence[int]:
        """Photons of each part."""

    def peek(self) -> Iterator[Mapping[str, npt.NDArray[Any]]]:
        """The columns of each part."""

    def take(self, name: str) -> Iterator[npt.NDArray[Any]]:
        """One column of each part, which is let go of when the next is asked for."""


Ranks = list[npt.NDArray[np.int32]]
"""Of each part's photons: their places in the order of all ids."""


@dataclass(frozen=True)
class WholeParts:
    """Columns as they are, which stay their owner's: one part."""

    columns: Mapping[str, npt.NDArray[Any]]

    def lengths(self) -> Sequence[int]:
        return [len(next(iter(self.columns.values())))]

    def peek(self) -> Iterator[Mapping[str, npt.NDArray[Any]]]:
        yield self.columns

    def take(self, name: str) -> Iterator[npt.NDArray[Any]]:
        yield self.columns[name]


def build(
    position: npt.ArrayLike,
    flux: npt.ArrayLike,
    normal: npt.ArrayLike,
    direction: npt.ArrayLike,
    id: npt.ArrayLike,
    device: Any = "cpu",
    launch: Launch | None = None,
    order: npt.NDArray[np.int32] | None = None,
) -> Any:
    """The map of N >= 0 photons. It is built on the CPU and copied to the device.

    Args:
        position: [scene units], shape [N, 3].
        flux: red, green, blue; finite, shape [N, 3].
        normal: unit geometric normal of the surface, on the side the photon arrived at, shape [N, 3].
        direction: unit, pointing back to where the photon came from, shape [N, 3].
        id: integers, unique among all photons of the pass, in this map or not, shape [N].
        device: where the map will be used.
        launch: runs the kernels, on several threads perhaps (see `Launch`); None for one thread.
        order: see `build_of`.

    Returns:
        PhotonMap.

    Raises:
        WdpmError: shapes differ, a value is not finite or too large, or an id comes twice.
    """
    columns = {"position": position, "flux": flux, "normal": normal, "direction": direction}
    vectors = {name: np.ascontiguousarray(value, dtype=np.float32) for name, value in columns.items()}
    parts = WholeParts({**vectors, "id": np.ascontiguousarray(id, dtype=np.int64)})
    check(parts)
    return build_of(parts, ranks_of(parts), device, launch, order)


def build_of(
    parts: Parts,
    ranks: Ranks,
    device: Any = "cpu",
    launch: Launch | None = None,
    order: npt.NDArray[np.int32] | None = None,
) -> Any:
    """The map of photons in parts, whose columns are taken, all but their ids; so are the ranks.

    Args:
        parts: as `check` wants them.
        ranks: of the photons, as `ranks_of` has them.
        device, launch: see `build`.
        order: the ranks of the photons in the order of their places, as kd_order.sort gives it for all places, one part
            after another, so that nothing is left to be sorted; any permutation makes a tree, if a slow one. None if
            nobody has sorted.

    Returns:
        PhotonMap.
    """
    return _Tree(parts, ranks, launch_whole if launch is None else launch, order).finish(LEAF_ROWS, device)


def build_points(
    parts: Parts, device: Any = "cpu", launch: Launch | None = None, order: npt.NDArray[np.int32] | None = None
) -> Any:
    """The tree of surface points, which are positions and unit normals alone; their columns are taken.

    Args:
        order: as in `build_of`, of the points as they are numbered through all parts.

    Returns:
        PhotonMap, of POINT_ROWS a leaf, without flux and ranks.
    """
    for part in parts.peek():
        _check_vectors(part, np.arange(len(part["position"])))
    return _Tree(parts, running(parts), launch_whole if launch is None else launch, order).finish(POINT_ROWS, device)


class _Tree:
    """A tree that is being built: what it is built from is ordered by place."""

    def __init__(self, parts: Parts, ranks: Ranks, run: Launch, order: npt.NDArray[np.int32] | None) -> None:
        self._parts = parts
        self._ranks = ranks
        self._run = run
        self._count = sum(parts.lengths())
        self._records = Records(self._count, run)
        self._place_of = np.empty(self._count, np.int32)
        places = _integers(self._place_of)
        if order is None:
            for position, rank in zip(parts.take("position"), ranks, strict=True):
                self._records.add(position, rank)
            self._records.sort(0, self._count)
            run(_find_places, self._count, [self._records.array], [places])
        else:
            self._place_of[order] = np.arange(self._count, dtype=np.int32)
            for position, rank in zip(parts.take("position"), ranks, strict=True):
                run(_fill_places, len(rank), [_vectors(position), _integers(rank), places], [self._records.array])

    def finish(self, rows: int, device: Any) -> Any:
        """The tree; of photons, or of points."""
        whole = rows == LEAF_ROWS
        leaf_count = max(-(-self._count // LEAF_SIZE), 1)
        flux = wp.zeros(LEAF_SIZE * leaf_count if whole else 0, dtype=wp.vec3, device="cpu")
        rank = wp.zeros(LEAF_SIZE * leaf_count if whole else 0, dtype=wp.int32, device="cpu")
        if whole:
            self._move("flux", flux)
        normal = self._moved("normal")
        direction = self._moved("direction") if whole else Pages(0, np.float32, 3)
        self._place_of = np.empty(0, np.int32)
        self._ranks.clear()

        photons = PhotonMap()
        photons.count = self._count
        photons.leaves = wp.empty(rows * leaf_count, dtype=vec8, device="cpu")
        self._lay_out(photons, rows, leaf_count, normal, direction, rank)
        photons.flux, photons.rank = flux.to(device), rank.to(device)
        photons.leaves, photons.nodes = photons.leaves.to(device), photons.nodes.to(device)
        return photons

    def _lay_out(self, photons: Any, rows: int, leaf_count: int, normal: Pages, direction: Pages, rank: Any) -> None:
        """Write leaves and nodes; let go of what they are written from."""
        levels = max(-(-leaf_bits(self._count) // 3), 1)
        fan_out = -(-leaf_count // 8 ** (levels - 1))
        begin = [0, *(1 + fan_out * (8**level - 1) // 7 for level in range(levels))]
        lowest = begin[levels - 1]
        children = fan_out if levels == 1 else 8
        parents = -(-leaf_count // children)
        nodes = wp.zeros(6 * (lowest + parents), dtype=vec8, device="cpu")
        sources = [self._records.array, _vectors(normal.array), _vectors(direction.array), rows, children]
        for first in range(0, parents, PARENTS_A_PIECE):
            end = min(first + PARENTS_A_PIECE, parents)
            self._run(_pack_leaves, end - first, [*sources, first, lowest], [nodes, photons.leaves, rank])
            for pages in (self._records.pages, normal, direction):
                pages.release(first * children * LEAF_SIZE, min(end * children * LEAF_SIZE, len(pages.array)))
        there = parents
        for level in reversed(range(levels - 1)):
            end_child, there = begin[level + 1] + there, -(-there // (8 if level else fan_out))
            inputs = [fan_out, 8 if level else fan_out, begin[level], end_child]
            self._run(_fit_boxes, there, inputs, [nodes])
        photons.fan_out = fan_out
        photons.inner_count, photons.nodes = begin[levels], nodes

    def _moved(self, name: str) -> Pages:
        pages = Pages(self._count, np.float32, 3)
        self._move(name, _vectors(pages.array))
        return pages

    def _move(self, name: str, out: Any) -> None:
        """Take a column, and write it by place."""
        places = _integers(self._place_of)
        for column, rank in zip(self._parts.take(name), self._ranks, strict=True):
            self._run(_move, len(rank), [_vectors(column), _integers(rank), places], [out])


def _vectors(array: npt.NDArray[np.float32]) -> Any:
    return over(np.ascontiguousarray(array, np.float32), wp.vec3)


def _integers(array: npt.NDArray[np.int32]) -> Any:
    return over(np.ascontiguousarray(array, np.int32), wp.int32)


def check(parts: Parts) -> None:
    """Raises WdpmError unless the columns of all parts describe photons."""
    for part in parts.peek():
        ids = part["id"]
        if ids.ndim != 1:
            raise WdpmError(f"photon map: id has shape {ids.shape}, expected [N]")
        _check_vectors({name: part[name] for name in ("position", "flux", "normal", "direction")}, ids)


def _check_vectors(vectors: Mapping[str, npt.NDArray[np.float32]], ids: npt.NDArray[Any]) -> None:
    for name, value in vectors.items():
        if value.shape != (len(ids), 3):
            raise WdpmError(f"photon map: {name} has shape {value.shape}, expected ({len(ids)}, 3) like id")
        with np.errstate(over="ignore", invalid="ignore"):
            together = value.sum()
        if not np.isfinite(together):  # one pass without a temporary array; a sum of many may be inf though none is
            bad = np.flatnonzero(~np.isfinite(value).all(axis=1))
            if len(bad):
                of = f"photon {ids[bad[0]]} has {name} {value[bad[0]].tolist()}"
                raise WdpmError(f"photon map: {of}, expected finite numbers")
    position = vectors["position"]
    largest = max(position.max(initial=0.0), -position.min(initial=0.0))
    if largest > MAX_PHOTON_COORDINATE:
        raise WdpmError(f"photon map: a coordinate is {largest:g}, expected at most {MAX_PHOTON_COORDINATE:g}")


def running(parts: Parts) -> Ranks:
    """Numbers through all parts."""
    ends = np.cumsum([0, *parts.lengths()])
    return [np.arange(begin, end, dtype=np.int32) for begin, end in itertools.pairwise(ends)]


def ranks_of(parts: Parts) -> Ranks:
    """Each photon's place in the order of ids, which are taken; WdpmError if one comes twice."""
    lengths = parts.lengths()
    ends = np.cumsum([0, *lengths])
    ids = np.empty(ends[-1], np.int64)
    for part, (begin, end) in zip(parts.take("id"), itertools.pairwise(ends), strict=True):
        ids[begin:end] = part
    if np.all(ids[1:] > ids[:-1]):
        return running(parts)
    order = np.argsort(ids)
    ranks = np.empty(len(ids), np.int32)
    for begin in range(0, len(ids), _A_PIECE):  # what is as long as all photons is worth avoiding
        piece = order[begin : begin + _A_PIECE + 1]
        ordered = ids[piece]
        same = np.flatnonzero(ordered[1:] == ordered[:-1])
        if len(same):
            raise WdpmError(f"photon map: photon id {ordered[same[0]]} comes twice, expected unique ids")
        ranks[piece] = np.arange(begin, begin + len(piece), dtype=np.int32)
    return np.split(ranks, ends[1:-1])
