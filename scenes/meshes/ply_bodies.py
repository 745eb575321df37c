"""The bodies of PLY files: tables of elements, and lists, in binary or as text."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.mapped import FileBytes, let_go
from wdpm.scenes.meshes.several import converted, in_threads
from wdpm.scenes.meshes.text.numbers import find_words, floats, integers, padded

Lists = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Lengths of lists, and their items one after another."""

_NONE: Final = np.zeros(0, np.int64)
_SHORT_RUN: Final = 64  # rows; of shorter ones each row is looked at by itself
_MOST_AT_ONCE: Final = 1 << 18
_WORDS_AT_ONCE: Final = 1 << 15


@dataclass(frozen=True)
class Property:
    name: str
    dtype: str
    count_dtype: str | None  # of a list's length; None for a single value


@dataclass(frozen=True)
class ElementKind:
    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def has_lists(self) -> bool:
        return any(prop.count_dtype is not None for prop in self.properties)


class Table(Mapping[str, NDArray[np.float64]]):
    """Columns by name, which are converted when they are asked for."""

    def __init__(self, columns: Mapping[str, NDArray[Any]], data: FileBytes = b"") -> None:
        self._columns = columns
        self._data = data

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self._columns[name].astype(np.float64)

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def together(self, names: tuple[str, ...]) -> NDArray[np.float64] | None:
        """Columns side by side, shape [rows, names]; None if there is not each of them."""
        if any(name not in self._columns for name in names):
            return None
        values = converted([self._columns[name] for name in names], np.float64)
        let_go(self._data)
        return values


class BinaryBody:
    def __init__(self, data: FileBytes, begin: int, order: str, file: Path) -> None:
        self.data = data
        self.order = order
        self.file = file
        self.position = begin

    def _truncated(self, kind: ElementKind) -> SceneError:
        return SceneError(f'the file ends within its {kind.count} elements "{kind.name}": it is truncated', self.file)

    def _need(self, size: int, kind: ElementKind) -> None:
        if self.position + size > len(self.data):
            raise self._truncated(kind)

    def read_table(self, kind: ElementKind) -> Table:
        fields = [(f"{i}", self.order + prop.dtype) for i, prop in enumerate(kind.properties)]
        row = np.dtype(fields)
        self._need(row.itemsize * kind.count, kind)
        table = np.frombuffer(self.data, row, kind.count, self.position)
        self.position += row.itemsize * kind.count
        return Table({prop.name: table[f"{i}"] for i, prop in enumerate(kind.properties)}, self.data)

    def read_lists(self, kind: ElementKind, wanted: tuple[str, ...]) -> Lists:
        """Lengths of the wanted lists, shape [count], and their items one after another."""
        runs: list[Lists] = []
        left = kind.count
        while left:
            run, rows = self._read_run(kind, wanted, left)
            runs.append(run)
            left -= rows
            if left and rows < _SHORT_RUN and len(kind.properties) == 1:
                runs.append(self._read_walking(kind, left, wanted))
                left = 0
        let_go(self.data)
        return _joined(runs)

    def _read_run(self, kind: ElementKind, wanted: tuple[str, ...], rows_left: int) -> tuple[Lists, int]:
        """Reads the rows whose lists are as long as those of the next row; meshes are nearly always one such run."""
        row, sizes = self._row_like_next(kind)
        rows = min(rows_left, (len(self.data) - self.position) // row.itemsize)
        if rows == 0:
            raise self._truncated(kind)
        table = np.frombuffer(self.data, row, rows, self.position)
        rows = _alike(table, sizes)
        table = table[:rows]
        self.position += rows * row.itemsize
        for index, prop in enumerate(kind.properties):
            if prop.name in wanted:
                corners = table[f"{index}"].reshape(rows, -1)
                items = converted([corners], np.int64).reshape(-1) if corners.size else _NONE
                return (np.broadcast_to(np.int64(sizes[index]), rows), items), rows
        return (np.zeros(rows, dtype=np.int64), _NONE), rows

    def _read_walking(self, kind: ElementKind, rows: int, wanted: tuple[str, ...]) -> Lists:
        """Rows of one list each, of whatever lengths: from each to the next."""
        (prop,) = kind.properties
        count, item = np.dtype(self.order + str(prop.count_dtype)), np.dtype(self.order + prop.dtype)
        if rows * count.itemsize > len(self.data) - self.position:
            raise self._truncated(kind)
        order: Literal["little", "big"] = "big" if self.order == ">" else "little"
        signed = count.kind == "i"
        begins, lengths = np.empty(rows, np.int64), np.empty(rows, np.int64)
        position = self.position
        for row in range(rows):
            length = int.from_bytes(self.data[position : position + count.itemsize], order, signed=signed)
            if length < 0:
                raise SceneError(f'element "{kind.name}" has a list of negative length', self.file)
            begins[row], lengths[row] = position + count.itemsize, length
            position += count.itemsize + length * item.itemsize
            if position > len(self.data):
                raise self._truncated(kind)
        self.position = position
        if prop.name not in wanted:
            return np.zeros(rows, np.int64), _NONE
        items = np.empty(int(lengths.sum()), np.int64)
        first = np.cumsum(lengths) - lengths
        for length in np.unique(lengths[lengths > 0]).tolist():
            own = np.flatnonzero(lengths == length)
            places = len(self.data) - item.itemsize * length + 1
            lists = np.ndarray((places, length), item, self.data, 0, (1, item.itemsize))
            items[first[own, None] + np.arange(length)] = lists[begins[own]]
        return lengths, items

    def _row_like_next(self, kind: ElementKind) -> tuple[np.dtype[np.void], dict[int, int]]:
        fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        sizes: dict[int, int] = {}
        offset = self.position
        for index, prop in enumerate(kind.properties):
            dtype = np.dtype(self.order + prop.dtype)
            length = 1
            if prop.count_dtype is not None:
                count_dtype = np.dtype(self.order + prop.count_dtype)
                if offset + count_dtype.itemsize > len(self.data):
                    raise self._truncated(kind)
                length = int(np.frombuffer(self.data, count_dtype, 1, offset)[0])
                if length < 0:
                    raise SceneError(f'element "{kind.name}" has a list of negative length', self.file)
                if offset + length * dtype.itemsize > len(self.data):
                    raise self._truncated(kind)
                sizes[index] = length
                fields.append((f"n{index}", count_dtype.str))
                offset += count_dtype.itemsize
            fields.append((f"{index}", dtype.str, (length,)))
            offset += length * dtype.itemsize
        return np.dtype(fields), sizes


def _alike(table: NDArray[Any], sizes: Mapping[int, int]) -> int:
    """How many rows from the first on have lists of these sizes; no more rows are looked at than twice as many."""
    looked = 0
    window = _SHORT_RUN
    while looked < len(table):
        part = table[looked : looked + window]
        for index, size in sizes.items():
            alike = part[f"n{index}"] == size
            if not alike.all():
                part = part[: int(np.argmin(alike))]
        if len(part) < min(window, len(table) - looked):
            return looked + len(part)
        looked += len(part)
        window = min(2 * window, _MOST_AT_ONCE)
    return len(table)


def _joined(runs: Sequence[Lists]) -> Lists:
    if len(runs) == 1:
        return runs[0]
    lengths, items = zip(*runs, strict=True) if runs else ((), ())
    return np.concatenate([_NONE, *lengths]), np.concatenate([_NONE, *items])


class AsciiBody:
    def __init__(self, data: bytes, file: Path) -> None:
        self.file = file
        self.data = padded(data)
        words = find_words(self.data)
        if words is None:
            raise SceneError("the body holds bytes that are no text", file)
        self.begin, self.end = words.begin, words.end
        self.position = 0

    def _take(self, count: int, kind: ElementKind) -> slice:
        if self.position + count > len(self.begin):
            message = f'the file ends within its {kind.count} elements "{kind.name}": it is truncated'
            raise SceneError(message, self.file)
        taken = slice(self.position, self.position + count)
        self.position += count
        return taken

    def _not_a_number(self, kind: ElementKind, error: Exception, what: str) -> SceneError:
        return SceneError(f'a value of element "{kind.name}" is not a {what}: {error}', self.file)

    def read_table(self, kind: ElementKind) -> Table:
        width = len(kind.properties)
        taken = self._take(width * kind.count, kind)
        try:
            values = self._numbers(floats, taken, np.float64).reshape(kind.count, width)
        except ValueError as error:
            raise self._not_a_number(kind, error, "number") from error
        return Table({prop.name: values[:, i] for i, prop in enumerate(kind.properties)})

    def read_lists(self, kind: ElementKind, wanted: tuple[str, ...]) -> Lists:
        """Lengths of the wanted lists, shape [count], and their items one after another."""
        try:
            plain = len(kind.properties) == 1 and kind.properties[0].name in wanted
            found = self._read_plain_lists(kind) if plain else None
            return self._read_rows(kind, wanted) if found is None else found
        except (ValueError, OverflowError) as error:
            raise self._not_a_number(kind, error, "whole number") from error

    def _read_plain_lists(self, kind: ElementKind) -> Lists | None:
        """Rows of one list each, from whatever is left of the text; None if that is not all whole numbers."""
        try:
            values = self._numbers(integers, slice(self.position, len(self.begin)), np.int64)
        except (ValueError, OverflowError):
            return None
        begins: list[int] = []
        position = 0
        numbers = memoryview(values.data)  # a quick way to single values
        while len(begins) < kind.count and position < len(values):
            begins.append(position)
            position += 1 + max(numbers[position], 0)
        self._take(position if len(begins) == kind.count else len(values) + 1, kind)
        lengths = values[begins]
        is_item = np.ones(position, np.bool_)
        is_item[begins] = False
        return lengths, values[:position][is_item]

    def _read_rows(self, kind: ElementKind, wanted: tuple[str, ...]) -> Lists:
        """Rows of lists and single values, each by itself."""
        lengths: list[int] = []
        items: list[int] = []
        for _ in range(kind.count):
            length = 0
            for prop in kind.properties:
                count = 1 if prop.count_dtype is None else int(self._words(1, kind)[0])
                values = self._words(max(count, 0), kind)
                if prop.name in wanted:
                    length = count
                    items.extend(map(int, values))
            lengths.append(length)
        return np.array(lengths, dtype=np.int64), np.array(items, dtype=np.int64)

    def _words(self, count: int, kind: ElementKind) -> list[bytes]:
        taken = self._take(count, kind)
        places = zip(self.begin[taken].tolist(), self.end[taken].tolist(), strict=True)
        return [self.data[begin:end].tobytes() for begin, end in places]

    def _numbers(self, read: Callable[..., NDArray[Any]], taken: slice, dtype: DTypeLike) -> NDArray[Any]:
        """Some words as numbers, a few at a time."""
        values = np.empty(taken.stop - taken.start, dtype)

        def fill(first: int) -> None:
            last = min(first + _WORDS_AT_ONCE, taken.stop)
            values[first - taken.start : last - taken.start] = read(
                self.data, self.begin[first:last], self.end[first:last]
            )

        for _ in in_threads(fill, range(taken.start, taken.stop, _WORDS_AT_ONCE)):
            pass
        return values
