"""Columns in one block of memory: one allocation for all of them, and one copy between host and device.

Each column begins at a multiple of ALIGNMENT bytes. On the CPU host and device share memory, and nothing is copied.
Elsewhere a block is filled on the host, in memory that a GPU can read by itself (pinned), and sent as a whole; what
comes back is one stretch of a block, from the first column that is wanted to the last.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

ALIGNMENT = 64
"""Bytes: a line of a processor's cache, and more than any load of a GPU asks for."""


def shares_memory(device: str) -> bool:
    """Whether arrays of a device are the host's own memory."""
    return device == "cpu"


def room(dtypes: Sequence[Any], count: int, device: str) -> list[Any]:
    """Columns of `count` items each, of no particular value, in one block.

    Args:
        dtypes: Warp's type of each column's items.
    """
    if count == 0:
        return [wp.empty(0, dtype=dtype, device=device) for dtype in dtypes]
    starts, size = _starts(dtypes, [count] * len(dtypes))
    block = wp.empty(size, dtype=wp.uint8, device=device)
    return [_column(block, start, dtype, count) for start, dtype in zip(starts, dtypes, strict=True)]


def from_host(arrays: Sequence[NDArray[Any]], dtypes: Sequence[Any], device: str) -> list[Any]:
    """Columns on a device whose memory is its own: all of them in one copy.

    Args:
        arrays: shape [items of the column] or [items, channels], each of its own length.
        dtypes: Warp's type of each column's items.
    """
    starts, size = _starts(dtypes, [len(array) for array in arrays])
    if size == 0:
        return [wp.empty(0, dtype=dtype, device=device) for dtype in dtypes]
    staged = _staging.take(size, device)
    for array, dtype, start in zip(arrays, dtypes, starts, strict=True):
        if len(array):
            np.asarray(_column(staged, start, dtype, len(array)))[...] = array
    block = wp.empty(size, dtype=wp.uint8, device=device)
    send(block, staged, size)
    return [
        _column(block, start, dtype, len(array)) if len(array) else wp.empty(0, dtype=dtype, device=device)
        for array, dtype, start in zip(arrays, dtypes, starts, strict=True)
    ]


def to_host(columns: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Columns of a device whose memory is its own, as numpy arrays: one copy for those that stand in one block."""
    blocks: dict[int, list[str]] = {}
    for name, column in columns.items():
        blocks.setdefault(id(getattr(column, "block", column)), []).append(name)
    found: dict[str, NDArray[Any]] = {}
    for names in blocks.values():
        found |= _fetch({name: columns[name] for name in names})
    return {name: found[name] for name in columns}


def _fetch(columns: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Columns of one block."""
    first = next(iter(columns.values()))
    if not hasattr(first, "block"):
        return {name: column.numpy() for name, column in columns.items()}
    begin = min(column.start for column in columns.values())
    size = max(column.start + column.capacity for column in columns.values()) - begin
    staged = _staging.take(size, first.device.alias)
    fetch(staged, first.block, begin, size)
    kept = wp.empty(size, dtype=wp.uint8, device="cpu")
    wp.copy(kept, staged, count=size)
    return {
        name: np.asarray(_column(kept, column.start - begin, column.dtype, len(column)))
        for name, column in columns.items()
    }


def send(block: Any, staged: Any, size: int) -> None:
    """Copy the first bytes of the host's end to a block, and wait."""
    wp.copy(block, staged, count=size)
    _wait(block)


def fetch(staged: Any, block: Any, first: int, size: int) -> None:
    """Copy some bytes of a block, from `first` on, to the host's end, and wait."""
    wp.copy(staged, block, src_offset=first, count=size)
    _wait(block)


def _wait(block: Any) -> None:
    """Until copies from and to pinned memory, which do not wait by themselves, are done."""
    if block.device.is_cuda:
        wp.synchronize_device(block.device)


def _starts(dtypes: Sequence[Any], counts: Sequence[int]) -> tuple[list[int], int]:
    """Where columns begin, and how long the block is [bytes]."""
    starts, end = [], 0
    for dtype, count in zip(dtypes, counts, strict=True):
        starts.append(end)
        end += -(-wp.types.type_size_in_bytes(dtype) * count // ALIGNMENT) * ALIGNMENT
    return starts, end


def _column(block: Any, start: int, dtype: Any, count: int) -> Any:
    """Items of a block as an array, which keeps the block and knows its place in it."""
    array = wp.array(ptr=block.ptr + start, dtype=dtype, shape=count, device=block.device)
    array.block, array.start = block, start
    return array


class _Staging(threading.local):
    """The host's end of copies, used again and again by one thread: pinned memory is slow to get."""

    def __init__(self) -> None:
        self._block: Any = None

    def take(self, size: int, device: str) -> Any:
        """At least so many bytes, of no particular value, until the next call."""
        if self._block is None or len(self._block) < size:
            pinned = wp.get_device(device).is_cuda
            self._block = wp.empty(2 * size, dtype=wp.uint8, device="cpu", pinned=pinned)
        return self._block


_staging = _Staging()
