"""Columns in the host's memory: structs of arrays that kernels on the CPU take, without an array of Warp for each.

A launch of a few thousand rays lasts less than a millisecond, and a dozen arrays of Warp for what it reads and writes,
made one by one and set in a struct, cost as much again. A kernel needs none of them: it is given a struct of
descriptors, which say where each array begins and how long it is. So a struct's descriptors are copied from a template
here, and the places and the length written into them, all at once. Whoever asks for a member by its name gets an array
of Warp over the same memory, made then.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.host_arrays import ALIGNMENT, HostArray, known_by_numpy, numpy_of, place_of

Bytes = NDArray[np.uint8]


class Layout:
    """Where the descriptors of a struct's arrays hold what differs from one instance to the next.

    Args:
        struct: of arrays alone, whose items numpy knows.

    Attributes:
        types: of each column's items, as Warp calls them.
        items: name, NumPy's type and shape of each column's items.
        words: a struct of arrays without items, as 64-bit words.
    """

    def __init__(self, struct: wp.Struct) -> None:
        self.struct = struct
        self.types = {name: var.type.dtype for name, var in struct.vars.items()}
        self.numbers = {name: known_by_numpy(dtype)[0] for name, dtype in self.types.items()}
        self.shapes = {name: known_by_numpy(dtype)[1] for name, dtype in self.types.items()}
        self.items = [(name, number, self.shapes[name]) for name, number in self.numbers.items()]
        self._sizes = [wp.types.type_size_in_bytes(dtype) for dtype in self.types.values()]
        template, starts = struct.ctype(), []
        for name, dtype in self.types.items():
            setattr(template, name, wp.empty(1, dtype=dtype, device="cpu").__ctype__())
            starts.append(getattr(struct.ctype, name).offset)
        descriptor = type(getattr(template, next(iter(self.types))))
        self._places = (np.array(starts) + descriptor.data.offset) // 8
        self._lengths = (np.array(starts) + descriptor.shape.offset) // 4
        self.words = np.frombuffer(bytes(template), np.uint64).copy()
        self.describe(self.words, [0] * len(starts), 0)

    def describe(self, words: NDArray[np.uint64], places: list[int], lengths: int | list[int]) -> None:
        """Write into a struct, which is a copy of the template, where its arrays are and how long."""
        words[self._places] = places
        words.view(np.int32)[self._lengths] = lengths

    def starts(self, count: int) -> tuple[list[int], int]:
        """Where columns of so many items begin in one block, and how long that is [bytes]."""
        starts, end = [], 0
        for size in self._sizes:
            starts.append(end)
            end += -(-size * count // ALIGNMENT) * ALIGNMENT
        return starts, end


@functools.cache
def layout_of(struct: wp.Struct) -> Layout | None:
    """The layout of a struct, or None where it holds more than arrays whose items numpy knows."""
    for var in struct.vars.values():
        if getattr(var.type, "ndim", 0) != 1 or numpy_of(var.type.dtype) is None:
            return None
    return Layout(struct)


class HostColumns:
    """Columns: what a kernel takes for a struct of arrays, on the CPU.

    Its members are arrays of Warp; None where it was made without arrays.

    Args:
        layout: of the struct.
        words: the struct, as 64-bit words that stay where they are.
    """

    def __init__(self, layout: Layout, words: NDArray[np.uint64]) -> None:
        inner = self.__dict__
        inner["_layout"] = layout
        inner["_struct"] = layout.struct.ctype.from_buffer(words)
        inner["_words"] = words
        inner["_count"] = 0
        inner["_block"] = None
        inner["_starts"] = {}
        inner["_arrays"] = {}

    def __ctype__(self) -> Any:
        """What Warp hands to a kernel."""
        return self._struct

    @property
    def of_struct(self) -> wp.Struct:
        """What it is an instance of, for a kernel."""
        return self._layout.struct

    def __getattr__(self, name: str) -> Any:
        if name not in self._layout.types:
            raise AttributeError(f"{self._layout.struct.key} has no member {name}")
        if not self.has_arrays:
            return None
        made = self.array(name).of_warp()
        self.__dict__[name] = made
        return made

    def __setattr__(self, name: str, value: Any) -> None:
        """Have another array, of Warp or of the host, for a member."""
        setattr(self._struct, name, value.__ctype__())
        self.__dict__[name] = value
        self._arrays[name] = value.numpy()

    @property
    def has_arrays(self) -> bool:
        """Whether there are arrays, be they without items."""
        return bool(self._starts or self._arrays)

    def array(self, name: str) -> HostArray:
        """A column as an argument of a kernel: the same memory."""
        return HostArray(self.column(name), self._layout.types[name])

    def column(self, name: str) -> NDArray[Any]:
        """A column as a numpy array over the same memory, shape [items] or [items, channels]."""
        array: NDArray[Any] | None = self._arrays.get(name)
        if array is None:
            layout = self._layout
            shape = (self._count, *layout.shapes[name])
            array = np.ndarray(shape, layout.numbers[name], self._block, self._starts[name])
            self._arrays[name] = array
        return array

    def some(self, names: Iterable[str]) -> dict[str, NDArray[Any]]:
        """The named columns, as `column` has them."""
        known = self._arrays
        if known.keys() >= self._layout.types.keys():
            return {name: known[name] for name in names}
        return {name: self.column(name) for name in names}

    def make_room(self, count: int) -> None:
        """Have columns of so many items, of no particular value."""
        starts, size = self._layout.starts(count)
        block = np.empty(size + ALIGNMENT, np.uint8)
        place = place_of(block)
        shift = -place % ALIGNMENT
        starts = [start + shift for start in starts]
        self._layout.describe(self._words, [place + start for start in starts], count)
        self.__dict__.update(_count=count, _block=block, _starts=dict(zip(self._layout.types, starts, strict=True)))

    def take_over(self, arrays: Mapping[str, NDArray[Any]], written: Collection[str]) -> None:
        """Have these arrays for columns: themselves where they lie as kernels expect it.

        Args:
            written: columns that kernels write to. Of those, arrays that may not be written to are copied.
        """
        places, lengths, kept = [], [], self._arrays
        for name, number, shape in self._layout.items:
            array = arrays[name]
            flags = array.flags
            if array.shape[1:] != shape or array.ndim == 0:
                raise ValueError(
                    f"{self._layout.struct.key}.{name}: items of shape {array.shape[1:]}, expected {shape}"
                )
            if array.dtype != number or not (flags.c_contiguous and (flags.writeable or name not in written)):
                array = np.array(array, number, order="C")
                flags = array.flags
            length = len(array)
            kept[name] = array
            places.append(place_of(array))
            lengths.append(length)
        self._layout.describe(self._words, places, lengths)


class HostNest:
    """Structs of columns within one struct.

    Args:
        struct: of structs alone.
        counts: items of each of them, of no particular value; those without any have None for members.
        others: Warp's instances of those that have no layout.
    """

    def __init__(self, struct: wp.Struct, counts: Mapping[str, int], others: Mapping[str, Any]) -> None:
        words = np.zeros(ctypes.sizeof(struct.ctype) // 8, np.uint64)
        self.of_struct = struct
        self._struct = struct.ctype.from_buffer(words)
        for name, var in struct.vars.items():
            if name in others:
                setattr(self._struct, name, others[name].__ctype__())
                setattr(self, name, others[name])
                continue
            layout = layout_of(var.type)
            if layout is None:
                raise TypeError(f"{struct.key}.{name} has no layout")
            first = getattr(struct.ctype, name).offset // 8
            own = words[first : first + len(layout.words)]
            columns = HostColumns(layout, own)
            if counts.get(name):
                own[:] = layout.words
                columns.make_room(counts[name])
            setattr(self, name, columns)

    def __ctype__(self) -> Any:
        """What Warp hands to a kernel."""
        return self._struct


@functools.cache
def without_layout(struct: wp.Struct) -> frozenset[str] | None:
    """The members of a struct of structs that have no layout; None where some members are no structs."""
    if not all(hasattr(var.type, "vars") for var in struct.vars.values()):
        return None
    return frozenset(name for name, var in struct.vars.items() if layout_of(var.type) is None)


def room(layout: Layout, count: int) -> HostColumns:
    """Columns of so many items, of no particular value."""
    columns = HostColumns(layout, layout.words.copy())
    columns.make_room(count)
    return columns


def over(layout: Layout, arrays: Mapping[str, NDArray[Any]], written: Collection[str] | None = None) -> HostColumns:
    """Columns over these arrays, as HostColumns.take_over has them; None: kernels may write to all of them.

    Raises:
        ValueError: their items are not of the struct's shapes.
    """
    columns = HostColumns(layout, layout.words.copy())
    columns.take_over(arrays, layout.types if written is None else written)
    return columns
