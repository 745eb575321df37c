"""Columns of a batch as the wire has them: shorter where that costs little, and the same bits when they are read.

A column is told in one of a few forms, which the sender chooses by a look at its numbers: one value for all rows, whole
numbers as small differences, runs of equal rows, or values of those rows alone that have met something. The norm is
docs/protocol.md, "Forms of columns". Floats are compared as bits: -0 is not 0 here, and a NaN is the number that it is.

Columns lie one behind another in blocks of bytes, small ones in the same: a batch of few rays is one frame.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import ProtocolError

Column = NDArray[Any]
Whole = NDArray[np.integer[Any]]
Bytes = NDArray[np.uint8]

ALONE = 1 << 16
"""Bytes from which on a piece of a column is a block of its own, and is not copied."""

ALIGNMENT = 8
"""Bytes at a multiple of which each piece begins in its block."""

# How the values of a column are told: the low four bits of its form.

RAW = 0
"""As they are."""

ONE = 1
"""One value, which all have."""

OVER_8, OVER_16, OVER_32 = 2, 3, 4
"""Whole numbers: the least of them as int64, then what each is over it, as uint8, uint16 or uint32."""

STEPS_8, STEPS_16 = 5, 6
"""Whole numbers: the first as int64, then what each other is over the one before, as uint8 or uint16; the largest of
these stands for any other step, which all come after them, as they are."""

# Of which rows values are told: the high four bits.

EVERY = 0x00

RUNS = 0x10
"""Of those that differ from the row before: one bit a row, set for these and the first, then their values."""

AGAIN = 0x20
"""Of the rows with which the last runs began: their values."""

PICKED = 0x30
"""Of those that are not -1: one bit a row, then their values."""

AS_PICKED = 0x40
"""Of those that were last picked; before them, in 8 bytes, the value that all others have."""

FIRST = 0x50
"""Vectors: the first channel of all, one bit a row, then the other channels of these rows; of all others they are 0."""

_BASE = struct.Struct("<q")
_OVER: dict[int, np.dtype[Any]] = {OVER_8: np.dtype("<u1"), OVER_16: np.dtype("<u2"), OVER_32: np.dtype("<u4")}
_STEPS: dict[int, np.dtype[Any]] = {STEPS_8: np.dtype("<u1"), STEPS_16: np.dtype("<u2")}
_VALUES, _ROWS = 0x0F, 0xF0
_WHOLE: dict[int, np.dtype[Any]] = {4: np.dtype("<i4"), 8: np.dtype("<i8")}
_UNSIGNED: dict[int, np.dtype[Any]] = {4: np.dtype("<u4"), 8: np.dtype("<u8")}
_BYTE = np.dtype("<u1")


def bits_of(column: Column) -> Whole:
    """A column's numbers as whole ones of the same bits."""
    return column.view(_WHOLE[column.itemsize])


class ColumnWriter:
    """Puts the columns of one batch, which are contiguous, into blocks. What puts a column returns its form.

    Args:
        count: rows of each column.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._blocks: list[Bytes] = []
        self._together: list[bytes] = []
        self._picked: NDArray[np.intp] | None = None
        self._first_other = 0
        self._changed: NDArray[np.bool_] | None = None

    def blocks(self) -> list[Bytes]:
        """All that was put, none of them empty."""
        self._close()
        return self._blocks

    def raw(self, column: Column) -> int:
        """Put a column as it is."""
        self._put(column)
        return RAW

    def whole(self, column: Column) -> int:
        """Put a column of whole numbers, of any shape. There is at least one row."""
        numbers = column.reshape(-1)
        if len(numbers) == self._count:
            changed = numbers[1:] != numbers[:-1]
            changes = int(np.count_nonzero(changed))
            if changes < self._count // 4:
                return self._runs(numbers, changed, changes)
        return self._numbers(numbers)

    def floats(self, column: Column) -> int:
        """Put a column of floats or of vectors. There is at least one row."""
        bits = bits_of(column)
        most = self._count * 3 // 4
        planes = [bits] if bits.ndim == 1 else list(bits.T)
        changed = planes[0][1:] != planes[0][:-1]
        for plane in planes[1:]:
            if np.count_nonzero(changed) > most:
                break
            changed |= plane[1:] != plane[:-1]
        changes = int(np.count_nonzero(changed))
        if changes <= most:
            return self._runs(column, changed, changes)
        return self.raw(column) if column.ndim == 1 else self._first_channel(column, planes)

    def pick(self, column: Column) -> int:
        """Put whole numbers of which -1 says that a row has met nothing: what follows may be told of the others."""
        met = column != -1
        count = int(np.count_nonzero(met))
        if not 0 < count <= self._count * 3 // 4:
            return self.whole(column)
        self._picked = met.nonzero()[0]
        self._first_other = int(met.argmin())
        self._put(np.packbits(met))
        return PICKED | self._numbers(column.take(self._picked))

    def of_picked(self, column: Column) -> int | None:
        """Put the values of the picked rows and the one of all others; None if nothing was picked or these differ."""
        if self._picked is None:
            return None
        bits = bits_of(column)
        other = bits[self._first_other]
        picked = bits.take(self._picked)
        if np.count_nonzero(bits != other) != np.count_nonzero(picked != other):
            return None
        self._together.append(other.tobytes().ljust(ALIGNMENT, b"\0"))
        return AS_PICKED | self._some(picked, column.dtype)

    def _runs(self, column: Column, changed: NDArray[np.bool_], changes: int) -> int:
        if not changes:
            self._put(column[:1])
            return ONE
        rows = AGAIN
        begins = np.empty(self._count, np.bool_)
        begins[0] = True
        begins[1:] = changed
        if self._changed is None or not np.array_equal(changed, self._changed):
            rows, self._changed = RUNS, changed
            self._put(np.packbits(begins))
        return rows | self._some(column.take(begins.nonzero()[0], axis=0), column.dtype)

    def _first_channel(self, column: Column, planes: Sequence[Whole]) -> int:
        """Vectors, most of them different; many may have but their first channel."""
        more = planes[1] != 0
        for plane in planes[2:]:
            more |= plane != 0
        if np.count_nonzero(more) > self._count * 3 // 4:
            return self.raw(column)
        self._put(column[:, 0])
        self._put(np.packbits(more))
        self._put(column[more, 1:])
        return FIRST

    def _some(self, values: Column, dtype: np.dtype[Any]) -> int:
        """Values of some rows, of a column of this type."""
        return self._numbers(values) if dtype.kind == "i" else self.raw(values)

    def _numbers(self, numbers: Whole) -> int:
        """Whole numbers, at least one, in the shortest form."""
        least, most = int(np.minimum.reduce(numbers)), int(np.maximum.reduce(numbers))
        apart = most - least
        if not apart:
            self._put(numbers[:1])
            return ONE
        best, size = RAW, numbers.itemsize
        for form, dtype in _OVER.items():
            if apart < 1 << 8 * dtype.itemsize and dtype.itemsize < size:
                best, size = form, dtype.itemsize
                break
        if size > 1 and (form := self._steps(numbers, size * len(numbers))):
            return form
        if best == RAW:
            return self.raw(numbers)
        self._together.append(_BASE.pack(least))
        self._put((numbers - numbers.dtype.type(least)).astype(_OVER[best]))
        return best

    def _steps(self, numbers: Whole, limit: int) -> int:
        """As steps from one to the next, if that takes fewer bytes than `limit`; otherwise 0, and nothing is put."""
        # Those that lead back are large ones here; all add up modulo 2^32 or 2^64.
        steps = (numbers[1:] - numbers[:-1]).view(_UNSIGNED[numbers.itemsize])
        for form, dtype in _STEPS.items():
            top = (1 << 8 * dtype.itemsize) - 1
            large = steps >= top
            size = len(steps) * dtype.itemsize + int(np.count_nonzero(large)) * numbers.itemsize
            if size < limit * 7 // 8:
                self._together.append(_BASE.pack(int(numbers[0])))
                self._put(np.minimum(steps, top).astype(dtype))
                self._put(steps[large])
                return form
        return 0

    def _put(self, piece: Column) -> None:
        size = piece.nbytes
        if size >= ALONE:
            self._close()
            self._blocks.append(np.ascontiguousarray(piece).reshape(-1).view(np.uint8))
        elif size:
            self._together.append(piece.tobytes())
            if size % ALIGNMENT:
                self._together.append(bytes(-size % ALIGNMENT))

    def _close(self) -> None:
        if self._together:
            self._blocks.append(np.frombuffer(b"".join(self._together), np.uint8))
            self._together = []


class ColumnReader:
    """Takes the columns of one batch out of blocks.

    What is wrong with them is a ProtocolError. Nothing is made that has more rows than are asked for.

    Args:
        count: rows of each column.
    """

    def __init__(self, count: int, blocks: Sequence[Bytes]) -> None:
        self._count = count
        self._blocks = list(reversed(blocks))
        self._block: Bytes = np.empty(0, np.uint8)
        self._place = 0
        self._picked: NDArray[np.intp] | None = None
        self._begins: NDArray[np.intp] | None = None
        self._run_of: NDArray[np.intp] = np.empty(0, np.intp)

    def finish(self) -> None:
        """Raise ProtocolError if there is something that no column took."""
        if self._blocks or self._place != len(self._block):
            raise ProtocolError("there is more than their forms say")

    def column(self, form: int, dtype: np.dtype[Any], shape: tuple[int, ...]) -> Column:
        """The next column, of items of a type and a shape; what came as it is stays where it is, and is read-only."""
        rows, values = form & _ROWS, form & _VALUES
        if values > (STEPS_16 if dtype.kind == "i" else ONE):
            raise ProtocolError(f"{form:02x} is no form of a column of {dtype}")
        if rows == EVERY:
            return self._values(values, dtype, shape, self._count)
        if rows in (RUNS, AGAIN):
            return self._of_runs(rows == RUNS, values, dtype, shape)
        if rows in (PICKED, AS_PICKED) and not shape:
            return self._of_picked(rows == PICKED, values, dtype)
        if form == FIRST and len(shape) == 1:
            return self._by_channels(dtype, *shape)
        raise ProtocolError(f"{form:02x} is no form of a column of {dtype} {shape}")

    def _of_runs(self, new: bool, form: int, dtype: np.dtype[Any], shape: tuple[int, ...]) -> Column:
        if new:
            begins = self._marked()
            if not (len(begins) and begins[0] == 0):
                raise ProtocolError("runs begin behind the first row")
            lengths = np.empty_like(begins)
            np.subtract(begins[1:], begins[:-1], out=lengths[:-1])
            lengths[-1] = self._count - begins[-1]
            self._begins, self._run_of = begins, np.arange(len(begins)).repeat(lengths)
        if self._begins is None:
            raise ProtocolError("there were no runs before")
        values = self._values(form, dtype, shape, len(self._begins))
        if not shape:
            return values.take(self._run_of)
        items = values.view((np.void, values.nbytes // len(values))).reshape(-1)  # which NumPy takes in half the time
        return items.take(self._run_of).view(dtype).reshape(self._count, *shape)

    def _of_picked(self, new: bool, form: int, dtype: np.dtype[Any]) -> Column:
        other: Any = -1
        if new:
            self._picked = self._marked()
        if self._picked is None:
            raise ProtocolError("no rows were picked before")
        if not new:
            other = self._take(dtype, ALIGNMENT // dtype.itemsize)[0]
        column = np.full(self._count, other, dtype)
        column[self._picked] = self._values(form, dtype, (), len(self._picked))
        return column

    def _by_channels(self, dtype: np.dtype[Any], channels: int) -> Column:
        first = self._take(dtype, self._count)
        more = self._marked()
        others = self._take(dtype, len(more) * (channels - 1)).reshape(len(more), channels - 1)
        column = np.zeros((self._count, channels), dtype)
        column[:, 0] = first
        column[more, 1:] = others
        return column

    def _values(self, form: int, dtype: np.dtype[Any], shape: tuple[int, ...], count: int) -> Column:
        """The values of so many rows."""
        size = math.prod(shape) * count
        if form == RAW:
            numbers = self._take(dtype, size)
        elif not count:
            numbers = np.empty(0, dtype)
        elif form == ONE:
            numbers = np.frombuffer(bytearray(self._take(dtype, size // count).tobytes()) * count, dtype)
        else:
            [base] = _BASE.unpack(self._take(_BYTE, _BASE.size).data)
            if base >> 8 * dtype.itemsize - 1 not in (0, -1):
                raise ProtocolError(f"{base} is no {dtype}")
            first = dtype.type(base)
            if form in _OVER:
                numbers = np.add(self._take(_OVER[form], size), first, dtype=dtype, casting="unsafe")
            else:
                numbers = self._sums(first, _STEPS[form], size)
        return numbers.reshape(count, *shape)

    def _sums(self, first: Any, told_as: np.dtype[Any], size: int) -> Whole:
        """What steps lead to, from the first number on."""
        steps = self._take(told_as, size - 1)
        numbers: Whole = np.empty(size, first.dtype)
        numbers[0] = first
        numbers[1:] = steps
        large = 1 + (steps == (1 << 8 * told_as.itemsize) - 1).nonzero()[0]
        numbers[large] = self._take(numbers.dtype, len(large))
        return np.cumsum(numbers, dtype=numbers.dtype, out=numbers)

    def _marked(self) -> NDArray[np.intp]:
        """Numbers of the rows whose bit is set."""
        bits = np.unpackbits(self._take(_BYTE, -(-self._count // 8)), count=self._count)
        return bits.view(np.bool_).nonzero()[0]

    def _take(self, dtype: np.dtype[Any], count: int) -> Column:
        size = count * dtype.itemsize
        if not size:
            return np.empty(0, dtype)
        if self._place == len(self._block):
            if not self._blocks:
                raise ProtocolError("there is less than their forms say")
            self._block, self._place = self._blocks.pop(), 0
        if size > len(self._block) - self._place:
            raise ProtocolError("a piece of a column is cut short")
        taken = np.frombuffer(self._block, dtype, count, self._place)
        self._place = min(len(self._block), self._place - (-size // ALIGNMENT) * ALIGNMENT)
        return taken
