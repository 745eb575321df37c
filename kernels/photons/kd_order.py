"""The order in which a kd-tree lays out its items: split after split, each at a multiple of a leaf's items.

All leaves but the last are full: with L leaves, and 2^B >= L of them thinkable, the node of `level` splits is one of
2^level runs of 2^(B - level) leaves, as far as there are any, and is split in the middle of the run, along the widest
side of its items' box. A node whose second half would be empty is not split. Three such levels are one level of a tree
that is eight wide (photon_map.py).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from wdpm.kernels.pages import Pages
from wdpm.kernels.quick_launch import launch as quick_launch

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LEAF_SIZE = 8
_LEAF_BITS = wp.constant(3)
_EMPTY = wp.constant(float("inf"))

Launch = Callable[..., None]
"""Called as launch(kernel, count, inputs, outputs), like `launch.Launcher`: runs a kernel on the CPU for `count` items.

The items may be cut into several launches: the first item of each is an argument between inputs and outputs.
"""


@wp.struct
class Record:
    """What the splits move: where an item is, and its number."""

    position: wp.vec3
    index: wp.int32


@wp.func
def _run_begin(run: wp.int32, run_bits: wp.int32, count: wp.int32) -> wp.int32:
    """First item of a run of 2^run_bits leaves."""
    return wp.int32(wp.min(wp.int64(run) << wp.int64(run_bits + _LEAF_BITS), wp.int64(count)))


@wp.func
def _widest_axis(records: wp.array[Record], begin: wp.int32, end: wp.int32) -> wp.int32:
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
def _swap(records: wp.array[Record], i: wp.int32, j: wp.int32) -> None:
    r = records[i]
    s = records[j]
    records[i] = s
    records[j] = r


@wp.func
def _median_of_three(records: wp.array[Record], axis: wp.int32, i: wp.int32, j: wp.int32, k: wp.int32) -> wp.int32:
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
def _select(records: wp.array[Record], axis: wp.int32, begin: wp.int32, end: wp.int32, nth: wp.int32) -> None:
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
    position: wp.array[wp.vec3],
    index: wp.array[wp.int32],
    first: wp.int32,
    offset: wp.int32,
    records_out: wp.array[Record],
) -> None:
    i = offset + wp.tid()
    record = Record()
    record.position = position[i]
    record.index = index[i]
    records_out[first + i] = record


@wp.kernel
def _split_level(
    count: wp.int32, run_bits: wp.int32, first: wp.int32, offset: wp.int32, records: wp.array[Record]
) -> None:
    """Splits some of the runs of 2^run_bits leaves, from the first on."""
    run = first + offset + wp.tid()
    begin = _run_begin(run, run_bits, count)
    middle = _run_begin(2 * run + 1, run_bits - 1, count)
    end = _run_begin(run + 1, run_bits, count)
    if begin < middle and middle < end:
        _select(records, _widest_axis(records, begin, end), begin, end, middle)


class Records:
    """Items on their way into a tree.

    Args:
        count: how many will be added.
        launch: runs the kernels.

    Attributes:
        pages: as float32, shape [count, 4]: positions, and the bits of the numbers.
    """

    def __init__(self, count: int, launch: Launch) -> None:
        self.pages = Pages(count, np.float32, 4)
        self.array = over(self.pages.array, Record)
        self._launch = launch
        self._filled = 0

    def add(self, position: npt.NDArray[np.float32], index: npt.NDArray[np.int32]) -> None:
        """Add items: where they are, shape [N, 3], and their numbers, shape [N]."""
        inputs = [over(np.ascontiguousarray(position, np.float32), wp.vec3), over(index, wp.int32), self._filled]
        self._launch(_fill_records, len(index), inputs, [self.array])
        self._filled += len(index)

    @property
    def numbers(self) -> npt.NDArray[np.int32]:
        """Of the items, in the order that they are in."""
        return self.pages.array.view(np.int32)[:, 3]

    def sort(self, begin: int, end: int) -> None:
        """Bring the places from `begin` to `end`, as `leaf_from` gives them, in order. All items are added."""
        count = len(self.pages.array)
        bits = leaf_bits(count)
        first_leaf, end_leaf = begin // LEAF_SIZE, -(-end // LEAF_SIZE)
        for run_bits in range(bits, 0, -1) if begin < end else ():
            first, last = first_leaf >> run_bits, -(-end_leaf >> run_bits)
            self._launch(_split_level, last - first, [count, run_bits, first], [self.array])


def over(array: npt.NDArray[Any], dtype: Any) -> Any:
    """An array of Warp over the same memory, on the host; `dtype` is what Warp calls a row of the array."""
    if not len(array):
        return wp.empty(0, dtype=dtype, device="cpu")
    made = wp.array(ptr=array.ctypes.data, dtype=dtype, shape=(len(array),), device="cpu", copy=False)
    made.whole = array  # which stays as long as this
    return made


def launch_whole(kernel: Any, count: int, inputs: list[Any], outputs: list[Any]) -> None:
    """Launch on the calling thread."""
    quick_launch(kernel, count, [*inputs, 0, *outputs], "cpu")


def leaf_bits(count: int) -> int:
    """The least B with 8 * 2^B >= count."""
    return max(-(-count // LEAF_SIZE) - 1, 0).bit_length()


def leaf_from(count: int, place: int) -> int:
    """The first place of a leaf, at or after a place in a tree of `count` > 0 items: where parts may be cut."""
    return min(-(-place // LEAF_SIZE) * LEAF_SIZE, count)


def sort(
    position: npt.NDArray[np.float32], begin: int, end: int, launch: Launch | None = None
) -> npt.NDArray[np.int32]:
    """Which items stand at the places from `begin` to `end` of a tree's leaves, int32, shape [end - begin].

    Only the nodes above those leaves are split: the root, half of the next level, and so on. So several can share the
    work, and what they find fits together, since a split depends on nothing but the items and their order.

    Args:
        position: of N > 0 items, in the order that all who share the work have them in, float32, shape [N, 3].
        begin, end: as `leaf_from` gives them, 0 <= begin <= end <= N.
    """
    records = Records(len(position), launch_whole if launch is None else launch)
    records.add(np.ascontiguousarray(position, np.float32), np.arange(len(position), dtype=np.int32))
    records.sort(begin, end)
    return records.numbers[begin:end].copy()
