"""Arrays in the host's memory that kernels on the CPU take as they take Warp's, made in a tenth of the time.

What a launch of a few hundred rays writes beside its columns (where each goes on, what was found) is an array or two
of Warp, which takes longer to make and to read as numpy's than such a launch lasts. A kernel needs no more of it than a
descriptor.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
import warp as wp
from numpy.typing import NDArray

NUMPY: Final[dict[Any, tuple[np.dtype[Any], tuple[int, ...]]]] = {
    wp.bool: (np.dtype(np.bool_), ()),
    wp.int32: (np.dtype(np.int32), ()),
    wp.uint32: (np.dtype(np.uint32), ()),
    wp.int64: (np.dtype(np.int64), ()),
    wp.float32: (np.dtype(np.float32), ()),
    wp.float64: (np.dtype(np.float64), ()),
    wp.vec2: (np.dtype(np.float32), (2,)),
    wp.vec3: (np.dtype(np.float32), (3,)),
    wp.vec3d: (np.dtype(np.float64), (3,)),
}
"""What numpy calls items of Warp's types, and their shape."""


@functools.cache
def numpy_of(dtype: Any) -> tuple[np.dtype[Any], tuple[int, ...]] | None:
    """What numpy calls items of a type of Warp's or of a struct of such, and their shape; None of any other."""
    members = getattr(dtype, "vars", None)
    if members is None:
        return NUMPY.get(dtype)
    if not all(var.type in NUMPY for var in members.values()):
        return None
    return np.dtype(dtype.numpy_dtype()), ()


def known_by_numpy(dtype: Any) -> tuple[np.dtype[Any], tuple[int, ...]]:
    """As numpy_of; KeyError where it has no name for it."""
    found = numpy_of(dtype)
    if found is None:
        raise KeyError(dtype)
    return found


ALIGNMENT: Final = 64
"""Bytes: a line of a processor's cache, at which each array of a block begins."""

_item_at: Callable[[Any], ctypes.c_char] = ctypes.c_char.from_buffer
"""The first byte of an array that may be written to."""

_TEMPLATES: dict[Any, Any] = {}
"""Descriptor of an array without items, by type of its items."""


def place_of(array: NDArray[Any]) -> int:
    """The address of an array's first byte."""
    # What is read-only or empty has no buffer for ctypes, which takes a quarter of the time.
    if array.flags.writeable and len(array):
        return ctypes.addressof(_item_at(array))
    place: int = array.__array_interface__["data"][0]
    return place


class HostArray:
    """An array of the CPU.

    Args:
        array: contiguous, of the numpy type and shape that belong to `dtype`.
        dtype: Warp's type of its items: one of which numpy_of knows.
    """

    __slots__ = ("_array", "_descriptor", "dtype")
    ndim = 1

    def __init__(self, array: NDArray[Any], dtype: Any) -> None:
        self.dtype = dtype
        self._array = array
        self._descriptor: Any = None

    def __len__(self) -> int:
        return len(self._array)

    @property
    def device(self) -> Any:
        """The CPU, as Warp has it."""
        return wp.get_device("cpu")

    @property
    def shape(self) -> tuple[int]:
        """Of items."""
        return (len(self._array),)

    @property
    def __array_interface__(self) -> dict[str, Any]:
        """For Warp and numpy, which need no copy of it."""
        interface: dict[str, Any] = self._array.__array_interface__
        return interface

    def numpy(self) -> NDArray[Any]:
        """As numpy has it: the same memory."""
        return self._array

    def of_warp(self) -> wp.array:
        """As Warp has it, for what needs more of it than kernels do: the same memory."""
        return wp.array(self._array, dtype=self.dtype, device="cpu", copy=False)

    def __ctype__(self) -> Any:
        """What a kernel is handed."""
        if self._descriptor is None:
            template = _template(self.dtype)
            descriptor = type(template).from_buffer_copy(template)
            if len(self._array):
                descriptor.data = place_of(self._array)
                descriptor.shape[0] = len(self._array)
            self._descriptor = descriptor
        return self._descriptor


def _template(dtype: Any) -> Any:
    found = _TEMPLATES.get(dtype)
    if found is None:
        found = _TEMPLATES[dtype] = wp.empty(0, dtype=dtype, device="cpu").__ctype__()
    return found


def room(dtypes: Sequence[Any], count: int) -> list[HostArray]:
    """Arrays of `count` items each, of no particular value, in one block.

    Args:
        dtypes: of each one's items.
    """
    places, size = [], ALIGNMENT
    for number, shape in map(known_by_numpy, dtypes):
        places.append((size, number, (count, *shape)))
        size += -(-number.itemsize * (shape[0] if shape else 1) * count // ALIGNMENT) * ALIGNMENT
    block = np.empty(size, np.uint8)
    shift = -place_of(block) % ALIGNMENT - ALIGNMENT
    return [
        HostArray(np.ndarray(whole, number, block, start + shift), dtype)
        for dtype, (start, number, whole) in zip(dtypes, places, strict=True)
    ]
