"""The photon map: a kd-tree of photons, eight children wide, for range searches with SIMD tests.

The tree is a true kd-tree: every binary node is split at the median of the widest side of its photons' box. It is
stored without pointers: three binary levels make one node with eight children, whose boxes lie in six rows of eight
floats, so that one element-wise expression tests all eight. Leaves hold up to eight photons the same way. With 2^B
leaves the root has 2^((B - 1) mod 3 + 1) children (1 if B = 0), every other node 8; the children of node i are nodes
max(8 i + fan_out - 7, 1) + 0 .. 7, level by level, and node `inner_count + j` is leaf j.

What a gather returns never depends on this shape (see gather.py), which is free to change.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from wdpm.kernels.constants import MAX_PHOTON_COORDINATE
from wdpm.scenes.errors import WdpmError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

vec8 = wp.types.vector(length=8, dtype=wp.float32)

LEAF_SIZE = 8
NODE_ROWS = wp.constant(6)  # low x, y, z, high x, y, z of the eight children
LEAF_ROWS = wp.constant(9)  # position x, y, z, normal x, y, z, direction x, y, z of the eight photons
_EMPTY = wp.constant(float("inf"))

Launch = Callable[..., None]
"""Called as launch(kernel, count, inputs, outputs), like `launch.Launcher`: runs a kernel on the CPU for `count` items.

The items may be cut into several launches: the first item of each is an argument between inputs and outputs.
"""


@wp.struct
class PhotonMap:
    """The photons of one partition, on one device."""

    count: wp.int32  # photons in the map
    fan_out: wp.int32  # children of the root: 1, 2, 4 or 8
    level_count: wp.int32  # levels of inner nodes
    inner_count: wp.int32  # inner nodes
    nodes: wp.array[vec8]  # boxes of the children; empty ones are +inf .. -inf  [6 * inner_count]
    leaves: wp.array[vec8]  # positions, normals, directions; unused places have normal 0  [9 * leaf count]
    flux: wp.array[wp.vec3]  # flux by place in the leaves  [8 * leaf count]
    rank: wp.array[wp.int32]  # place in the order of ids, by place in the leaves  [8 * leaf count]


@wp.struct
class _Record:
    """What the splits move: a photon's position and its number in the arrays given to `build`."""

    position: wp.vec3
    index: wp.int32


@wp.func
def first_child(i: wp.int32, fan_out: wp.int32) -> wp.int32:
    """Number of the first child of inner node i."""
    return wp.max(8 * i + fan_out - 7, 1)


@wp.func
def _segment_begin(segment: wp.int32, segment_bits: wp.int32, count: wp.int32) -> wp.int32:
    """First photon of one of 2^segment_bits segments that are as equal in size as can be."""
    return wp.int32((wp.int64(segment) * wp.int64(count)) >> wp.int64(segment_bits))


@wp.func
def _widest_axis(records: wp.array[_Record], begin: wp.int32, end: wp.int32) -> wp.int32:
    low = wp.vec3(_EMPTY)
    high = wp.vec3(-_EMPTY)
    for i in range(begin, end):
        p = records[i].position
        low = wp.min(low, p)
        high = wp.max(high, p)
    return wp.int32(wp.argmax(high - low))


@wp.func
def _before(coordinate: wp.float32, index: wp.int32, pivot: wp.float32, pivot_index: wp.int32) -> wp.bool:
    """Total order by (coordinate, index): without equals, lattices and coincident photons split like any others."""
    return coordinate < pivot or (coordinate == pivot and index < pivot_index)


@wp.func
def _swap(records: wp.array[_Record], i: wp.int32, j: wp.int32) -> None:
    r = records[i]
    s = records[j]
    records[i] = s
    records[j] = r


@wp.func
def _median_of_three(records: wp.array[_Record], axis: wp.int32, i: wp.int32, j: wp.int32, k: wp.int32) -> wp.int32:
    a = records[i].position[axis]
    b = records[j].position[axis]
    c = records[k].position[axis]
    m = j
    if (b < a) != (c < a):
        m = i
    elif (a < c) != (b < c):
        m = k
    return m


@wp.func
def _select(records: wp.array[_Record], axis: wp.int32, begin: wp.int32, end: wp.int32, nth: wp.int32) -> None:
    """Quickselect: moves records so that those of [begin, nth) come before those of [nth, end) along the axis."""
    low = int(begin)
    high = int(end)
    while high - low > 1:
        quarter = (high - low) >> 2
        middle = low + 2 * quarter
        _swap(records, _median_of_three(records, axis, low + quarter, middle, high - 1 - quarter), high - 1)
        pivot = records[high - 1].position[axis]
        pivot_index = records[high - 1].index
        split = int(low)
        for i in range(low, high - 1):
            # Without a branch, which would be mispredicted every other time.
            r = records[i]
            s = records[split]
            records[split] = r
            records[i] = s
            coordinate = r.position[axis]
            split += wp.int32(coordinate < pivot) | (wp.int32(coordinate == pivot) & wp.int32(r.index < pivot_index))
        _swap(records, split, high - 1)
        if nth <= split:
            high = split
        if nth > split:
            low = split + 1
        if nth == split:
            low = high


@wp.kernel
def _fill_records(
    position: wp.array[wp.vec3], order: wp.array[wp.int32], offset: wp.int32, records_out: wp.array[_Record]
) -> None:
    i = offset + wp.tid()
    record = _Record()
    record.position = position[order[i]]
    record.index = order[i]
    records_out[i] = record


@wp.kernel
def _split_level(
    count: wp.int32, level: wp.int32, first: wp.int32, offset: wp.int32, records: wp.array[_Record]
) -> None:
    """Splits some of the 2^level segments at their medians, from the first on."""
    segment = first + offset + wp.tid()
    begin = _segment_begin(2 * segment, level + 1, count)
    middle = _segment_begin(2 * segment + 1, level + 1, count)
    end = _segment_begin(2 * segment + 2, level + 1, count)
    if begin < middle and middle < end:
        _select(records, _widest_axis(records, begin, end), begin, end, middle)


@wp.kernel
def _pack_leaves(
    records: wp.array[_Record],
    flux: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    rank: wp.array[wp.int32],
    count: wp.int32,
    leaf_bits: wp.int32,
    children: wp.int32,
    first_parent: wp.int32,
    offset: wp.int32,
    nodes_out: wp.array[vec8],
    leaves_out: wp.array[vec8],
    flux_out: wp.array[wp.vec3],
    rank_out: wp.array[wp.int32],
) -> None:
    """One thread for each parent of leaves: copies its photons into their rows and writes its boxes."""
    parent = offset + wp.tid()
    low_x = vec8(_EMPTY)
    low_y = vec8(_EMPTY)
    low_z = vec8(_EMPTY)
    high_x = vec8(-_EMPTY)
    high_y = vec8(-_EMPTY)
    high_z = vec8(-_EMPTY)
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
        begin = _segment_begin(leaf, leaf_bits, count)
        end = _segment_begin(leaf + 1, leaf_bits, count)
        for i in range(begin, end):
            record = records[i]
            place = i - begin
            p = record.position
            n = normal[record.index]
            d = direction[record.index]
            low = wp.min(low, p)
            high = wp.max(high, p)
            px[place] = p[0]
            py[place] = p[1]
            pz[place] = p[2]
            nx[place] = n[0]
            ny[place] = n[1]
            nz[place] = n[2]
            dx[place] = d[0]
            dy[place] = d[1]
            dz[place] = d[2]
            flux_out[8 * leaf + place] = flux[record.index]
            rank_out[8 * leaf + place] = rank[record.index]
        row = LEAF_ROWS * leaf
        leaves_out[row + 0] = px
        leaves_out[row + 1] = py
        leaves_out[row + 2] = pz
        leaves_out[row + 3] = nx
        leaves_out[row + 4] = ny
        leaves_out[row + 5] = nz
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
    fan_out: wp.int32, children: wp.int32, first_node: wp.int32, offset: wp.int32, nodes: wp.array[vec8]
) -> None:
    """The boxes of a node's children enclose those of their children. One thread for each node of a level."""
    i = first_node + offset + wp.tid()
    for axis in range(3):
        low = vec8(_EMPTY)
        high = vec8(-_EMPTY)
        for c in range(children):
            child = NODE_ROWS * (first_child(i, fan_out) + c)
            low[c] = wp.min(nodes[child + axis])
            high[c] = wp.max(nodes[child + 3 + axis])
        nodes[NODE_ROWS * i + axis] = low
        nodes[NODE_ROWS * i + 3 + axis] = high


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
        order: what `sort` gave for all places, one part after another, so that nothing is left to be sorted; any
            permutation of 0 to N - 1 makes a tree, if a slow one. None if nobody has sorted.

    Returns:
        PhotonMap.

    Raises:
        WdpmError: shapes differ, a value is not finite or too large, or an id comes twice.
    """
    columns = {"position": position, "flux": flux, "normal": normal, "direction": direction}
    vectors = {name: np.ascontiguousarray(value, dtype=np.float32) for name, value in columns.items()}
    ids = np.ascontiguousarray(id, dtype=np.int64)
    _check(vectors, ids)
    run = _launch_whole if launch is None else launch

    count = len(ids)
    leaf_bits = _leaf_bits(count)
    level_count = max(-(-leaf_bits // 3), 1)
    fan_out = 1 << (leaf_bits - 3 * (level_count - 1))
    level_begin = [0, *(1 + fan_out * (8**level - 1) // 7 for level in range(level_count))]
    leaf_count = 1 << leaf_bits
    inner_count = level_begin[level_count]

    place_of = {name: wp.array(value, dtype=wp.vec3, device="cpu", copy=False) for name, value in vectors.items()}
    if order is None:
        records = _sorted_records(place_of["position"], 0, count, run)
    else:
        records = _records(place_of["position"], order, run)

    nodes = wp.empty(6 * inner_count, dtype=vec8, device="cpu")
    leaves = wp.empty(9 * leaf_count, dtype=vec8, device="cpu")
    flux_out = wp.zeros(LEAF_SIZE * leaf_count, dtype=wp.vec3, device="cpu")
    rank_out = wp.zeros(LEAF_SIZE * leaf_count, dtype=wp.int32, device="cpu")
    rank = wp.array(_ranks(ids), dtype=wp.int32, device="cpu", copy=False)
    children = fan_out if level_count == 1 else 8
    by_index = [place_of["flux"], place_of["normal"], place_of["direction"], rank]
    sizes = [count, leaf_bits, children, level_begin[level_count - 1]]
    outputs = [nodes, leaves, flux_out, rank_out]
    run(_pack_leaves, leaf_count // children, [records, *by_index, *sizes], outputs)
    for level in reversed(range(level_count - 1)):
        width = level_begin[level + 1] - level_begin[level]
        run(_fit_boxes, width, [fan_out, fan_out if level == 0 else 8, level_begin[level]], [nodes])

    photons = PhotonMap()
    photons.count = count
    photons.fan_out = fan_out
    photons.level_count = level_count
    photons.inner_count = inner_count
    photons.nodes = nodes.to(device)
    photons.leaves = leaves.to(device)
    photons.flux = flux_out.to(device)
    photons.rank = rank_out.to(device)
    return photons


def leaf_from(count: int, place: int) -> int:
    """The first place of a leaf, at or after a place in a tree of `count` > 0 photons: where parts may be cut."""
    bits = _leaf_bits(count)
    return _leaf_at(count, place) * count >> bits


def sort(
    position: npt.NDArray[np.float32], begin: int, end: int, launch: Launch | None = None
) -> npt.NDArray[np.int32]:
    """Which photons stand at the places from `begin` to `end` of a tree's leaves, int32, shape [end - begin].

    Only the nodes above those leaves are split: the root, half of the next level, and so on. So several can share the
    work, and what they find fits together, since a split depends on nothing but the photons and their order.

    Args:
        position: of N > 0 photons, in the order that all who share the work have them in, float32, shape [N, 3].
        begin, end: as `leaf_from` gives them, 0 <= begin <= end <= N.
    """
    places = wp.array(np.ascontiguousarray(position, np.float32), dtype=wp.vec3, device="cpu", copy=False)
    records = _sorted_records(places, begin, end, _launch_whole if launch is None else launch)
    found: npt.NDArray[np.int32] = records.numpy()["index"][begin:end].astype(np.int32)
    return found


def _leaf_bits(count: int) -> int:
    """The least B with 8 * 2^B >= count."""
    return max(-(-count // LEAF_SIZE) - 1, 0).bit_length()


def _leaf_at(count: int, place: int) -> int:
    """The first leaf that begins at or after a place."""
    return -(-(place << _leaf_bits(count)) // count)


def _records(position: Any, order: npt.NDArray[np.int32], run: Launch) -> Any:
    records = wp.empty(len(order), dtype=_Record, device="cpu")
    numbers = wp.array(np.ascontiguousarray(order, np.int32), dtype=wp.int32, device="cpu", copy=False)
    run(_fill_records, len(order), [position, numbers], [records])
    return records


def _sorted_records(position: Any, begin: int, end: int, run: Launch) -> Any:
    """All records, sorted at the places from `begin` to `end`, which are whole leaves."""
    count = len(position)
    records = _records(position, np.arange(count, dtype=np.int32), run)
    if begin == end:
        return records
    bits = _leaf_bits(count)
    first_leaf, end_leaf = _leaf_at(count, begin), _leaf_at(count, end)
    for level in range(bits):
        first, last = first_leaf >> (bits - level), -(-end_leaf >> (bits - level))
        run(_split_level, last - first, [count, level, first], [records])
    return records


def _launch_whole(kernel: Any, count: int, inputs: list[Any], outputs: list[Any]) -> None:
    wp.launch(kernel, dim=count, inputs=[*inputs, 0, *outputs], device="cpu")


def _check(vectors: dict[str, npt.NDArray[np.float32]], ids: npt.NDArray[np.int64]) -> None:
    """Raises WdpmError unless the arrays describe photons."""
    if ids.ndim != 1:
        raise WdpmError(f"photon map: id has shape {ids.shape}, expected [N]")
    for name, value in vectors.items():
        if value.shape != (len(ids), 3):
            raise WdpmError(f"photon map: {name} has shape {value.shape}, expected ({len(ids)}, 3) like id")
        # A sum is finite only if its terms are: one pass without a temporary array.
        if not np.isfinite(value.sum(dtype=np.float64)):
            bad = int(np.flatnonzero(~np.isfinite(value).all(axis=1))[0])
            raise WdpmError(f"photon map: photon {ids[bad]} has {name} {value[bad].tolist()}, expected finite numbers")
    largest = np.abs(vectors["position"]).max(initial=0.0)
    if largest > MAX_PHOTON_COORDINATE:
        raise WdpmError(f"photon map: a coordinate is {largest:g}, expected at most {MAX_PHOTON_COORDINATE:g}")


def _ranks(ids: npt.NDArray[np.int64]) -> npt.NDArray[np.int32]:
    """Each photon's place in the order of ids."""
    if np.all(ids[1:] > ids[:-1]):
        return np.arange(len(ids), dtype=np.int32)
    order = np.argsort(ids)
    ordered = ids[order]
    same = np.flatnonzero(ordered[1:] == ordered[:-1])
    if len(same):
        raise WdpmError(f"photon map: photon id {ordered[same[0]]} comes twice, expected unique ids")
    ranks = np.empty(len(ids), dtype=np.int32)
    ranks[order] = np.arange(len(ids), dtype=np.int32)
    return ranks
