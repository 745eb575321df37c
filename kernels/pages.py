"""Large arrays whose memory is given back piece by piece, while what they hold is made into something else.

An array of NumPy is freed as a whole. What sorts or lays out millions of photons reads one array from its beginning to
its end and writes another; without this both would be in memory whole at the end.
"""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_CAN_RELEASE = hasattr(mmap, "MADV_DONTNEED") and hasattr(mmap, "MAP_ANONYMOUS")  # Linux, macOS


class Pages:
    """Room for items, of which the system gives memory when they are written first.

    Args:
        count: of items.
        dtype: of an item's numbers.
        width: numbers an item; 1 for shape [count], else the shape is [count, width].

    Attributes:
        array: the items.
    """

    def __init__(self, count: int, dtype: DTypeLike, width: int = 1) -> None:
        shape = (count,) if width == 1 else (count, width)
        self._item = np.dtype(dtype).itemsize * width
        self._map: mmap.mmap | None = None
        self.array: NDArray[Any]
        if _CAN_RELEASE and count:
            # Private, so that a forked process has a copy of its own of what either writes.
            self._map = mmap.mmap(-1, count * self._item, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
            self.array = np.frombuffer(self._map, dtype).reshape(shape)
        else:
            self.array = np.empty(shape, dtype)

    def release(self, begin: int, end: int) -> None:
        """Give back the memory of some items, as far as they fill pages. They are not read again."""
        first = -(-begin * self._item // mmap.PAGESIZE) * mmap.PAGESIZE
        size = end * self._item // mmap.PAGESIZE * mmap.PAGESIZE - first
        if self._map is not None and size > 0:
            self._map.madvise(mmap.MADV_DONTNEED, first, size)
