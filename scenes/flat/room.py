"""Where the arrays of a flat scene lie: in memory, or in files without names, of which memory holds what is looked at.

A master sends a scene's triangles and looks at them but a few times, one after another. Of a mapped file the system may
take back each page as soon as it needs room; of memory it can take back nothing.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Callable
from typing import IO, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

Room = Callable[[tuple[int, ...], DTypeLike], NDArray[Any]]
"""Makes an array of a shape and type, whose values are whatever they are: np.empty, or in_file."""


class Mapping(mmap.mmap):
    """A file that is mapped and shared: its pages may leave memory at any time, and nothing is lost."""


def in_file(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """An array in a file without a name, which ends with it; in memory where the disk has no room.

    The file has its place on the disk from the start: a page for which there is none would end the process.
    """
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    if not size:
        return np.empty(shape, dtype)
    try:
        with tempfile.TemporaryFile(prefix="wdpm") as file:  # the mapping needs no open file
            _reserve(file, size)
            return np.ndarray(shape, dtype, Mapping(file.fileno(), size))
    except OSError:
        return np.empty(shape, dtype)


def _reserve(file: IO[bytes], size: int) -> None:
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size)
        return
    for first in range(0, size, _BLOCK):
        file.write(bytes(min(_BLOCK, size - first)))
    file.flush()


_BLOCK = 1 << 20


def lies_in_file(array: NDArray[Any]) -> bool:
    """Whether it is an array of `in_file`, or a part of one; an empty one need not lie anywhere."""
    return not array.nbytes or _mapping_of(array) is not None


def let_go(*arrays: NDArray[Any]) -> int:
    """Have pages of contiguous arrays that lie in files leave memory until they are looked at again.

    Returns:
        How many bytes of arrays that was; 0 for arrays in memory, and where the system cannot be told.
    """
    gone = 0
    for array in arrays:
        mapping = _mapping_of(array) if array.flags.c_contiguous and hasattr(mmap, "MADV_DONTNEED") else None
        if mapping is not None and array.nbytes:
            begin = array.ctypes.data - np.frombuffer(mapping, np.uint8).ctypes.data
            first = begin - begin % mmap.PAGESIZE
            mapping.madvise(mmap.MADV_DONTNEED, first, begin + array.nbytes - first)
            gone += array.nbytes
    return gone


def _mapping_of(array: NDArray[Any]) -> Mapping | None:
    base: Any = array.base
    while isinstance(base, np.ndarray):
        base = base.base
    return base if isinstance(base, Mapping) else None
