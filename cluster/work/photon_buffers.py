"""Stored photons of one map, in chunks of columns, 61 bytes each; and surface points, in 24.

Columns lie in chunks, so that a buffer grows without being copied, and is let go of column by column and chunk by chunk
while a tree is built of it: what is stored and what is built of it are never in memory both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Kind, concatenate, take
from wdpm.cluster.rows import take_rows
from wdpm.kernels.limits import MAPS
from wdpm.kernels.pages import Pages
from wdpm.kernels.photons import photon_map

CHUNK = 1 << 18
"""Photons of a chunk, of which those that there are take memory."""

Columns = Mapping[str, tuple[str, int]]
"""Type and width of each column's items."""

POINT_COLUMNS: Final[Columns] = {"position": ("<f4", 3), "normal": ("<f4", 3)}

PHOTON_COLUMNS: Final[Columns] = {
    "id": ("<i8", 1),
    "edges": ("<i4", 1),
    "front": ("i1", 1),
    **POINT_COLUMNS,
    "flux": ("<f4", 3),
    "direction": ("<f4", 3),
}
"""As kernels.ray_fields.STORED_PHOTON has them, but for the map."""


class _Column(Protocol):
    """kernels.pages.Pages, or what lies elsewhere."""

    @property
    def array(self) -> NDArray[Any]: ...


@dataclass(frozen=True, eq=False)
class _Borrowed:
    """A column in memory that another process lends; it is read there, and never copied."""

    array: NDArray[Any]


class _Chunk:
    """Room for some items, and how many there are."""

    def __init__(self, pages: dict[str, _Column], room: int, count: int = 0) -> None:
        self.pages = pages
        self.room = room
        self.count = count

    def column(self, name: str) -> NDArray[Any]:
        return self.pages[name].array[: self.count]

    def add(self, arrays: Arrays, rows: NDArray[np.intp] | slice) -> None:
        """Add some rows, for which there is room."""
        for name, pages in self.pages.items():
            chosen = arrays[name][rows] if isinstance(rows, slice) else take_rows(arrays[name], rows)
            pages.array[self.count : self.count + len(chosen)] = chosen
        self.count += len(chosen)


class ColumnBuffer:
    """Photons or surface points in chunks, which it grows by: kernels.photons.photon_map.Parts.

    Args:
        columns: type and width of each.
    """

    def __init__(self, columns: Columns) -> None:
        self._columns = columns
        self._chunks: list[_Chunk] = []

    def __len__(self) -> int:
        return sum(self.lengths())

    @property
    def nbytes(self) -> int:
        """Of all items, in the columns that are there."""
        return sum(chunk.column(name).nbytes for chunk in self._chunks for name in chunk.pages)

    def add(self, arrays: Arrays, rows: NDArray[np.intp] | None = None) -> None:
        """Add items.

        Args:
            arrays: with this buffer's columns; others are left out.
            rows: of them; None for all.
        """
        count = len(arrays["position"]) if rows is None else len(rows)
        begin = 0
        while begin < count:
            if not self._chunks or self._chunks[-1].count == self._chunks[-1].room:
                self._chunks.append(_Chunk({name: Pages(CHUNK, *of) for name, of in self._columns.items()}, CHUNK))
            end = min(count, begin + self._chunks[-1].room - self._chunks[-1].count)
            self._chunks[-1].add(arrays, slice(begin, end) if rows is None else rows[begin:end])
            begin = end

    def borrow(self, arrays: Arrays) -> None:
        """Add items in memory that another process lends, without a copy; ValueError if columns differ from these."""
        count = len(next(iter(arrays.values()), ()))
        expected = {name: (np.dtype(dtype), _shape(count, width)) for name, (dtype, width) in self._columns.items()}
        if {name: (array.dtype, array.shape) for name, array in arrays.items()} != expected:
            raise ValueError(f"columns {sorted(arrays)} of {count} items; expected {expected}")
        self._chunks.append(_Chunk({name: _Borrowed(array) for name, array in arrays.items()}, count, count))

    def join(self, other: ColumnBuffer) -> None:
        """Take over another buffer's items, which are not copied."""
        self._chunks = other._chunks + self._chunks  # so that the last one, which grows, stays the last
        other._chunks = []

    def lengths(self) -> Sequence[int]:
        """Items of each chunk."""
        return [chunk.count for chunk in self._chunks]

    def peek(self) -> Iterator[Arrays]:
        """The columns of each chunk."""
        for chunk in self._chunks:
            yield {name: chunk.column(name) for name in chunk.pages}

    def take(self, name: str) -> Iterator[NDArray[Any]]:
        """One column of each chunk, which is let go of when the next is asked for."""
        for chunk in self._chunks:
            column = chunk.column(name)
            del chunk.pages[name]
            yield column

    def whole(self, name: str) -> NDArray[Any]:
        """One column of all items, as a copy."""
        return self.joined(name, [chunk.column(name) for chunk in self._chunks])

    def joined(self, name: str, parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Parts of a column, one after another, as a copy."""
        dtype, width = self._columns[name]
        return np.concatenate([np.empty(_shape(0, width), dtype), *parts])


def _shape(count: int, width: int) -> tuple[int, ...]:
    return (count,) if width == 1 else (count, width)


class MapBuffers:
    """A buffer for each photon map, filled with batches that say in a column of which map each row is.

    Args:
        kind: of photons or of points.
    """

    def __init__(self, kind: Kind) -> None:
        self._kind = kind
        columns = PHOTON_COLUMNS if "id" in SCHEMAS[kind] else POINT_COLUMNS
        self._columns = columns
        self.clear()

    def clear(self) -> None:
        """Let go of everything."""
        self._of_map = [ColumnBuffer(self._columns) for _ in range(MAPS)]

    def __getitem__(self, number: int) -> ColumnBuffer:
        return self._of_map[number]

    @property
    def nbytes(self) -> int:
        """Of all items."""
        return sum(buffer.nbytes for buffer in self._of_map)

    def add(self, arrays: Arrays) -> None:
        """Add what a batch brought."""
        numbers = arrays["map"]
        for number in range(MAPS):
            rows = np.flatnonzero(numbers == number)
            if len(rows):
                self._of_map[number].add(arrays, None if len(rows) == len(numbers) else rows)

    def columns(self) -> dict[str, NDArray[Any]]:
        """All columns of all items, by the number of their map and their names, as `borrow` takes them."""
        return {
            f"{number} {name}": buffer.whole(name)
            for number, buffer in enumerate(self._of_map)
            if len(buffer)
            for name in self._columns
        }

    def borrow(self, columns: Arrays) -> NDArray[np.int64]:
        """Add items in memory that another process lends, as `columns` gives them. Returns how many, by map.

        Raises:
            ValueError: they are not what `columns` gives.
        """
        counts = np.zeros(MAPS, np.int64)
        of_map: dict[int, dict[str, NDArray[Any]]] = {}
        for key, column in columns.items():
            number, _, name = key.partition(" ")
            of_map.setdefault(int(number), {})[name] = column
        for map_number, arrays in of_map.items():
            if not 0 <= map_number < MAPS:
                raise ValueError(f"there is no map {map_number}")
            self._of_map[map_number].borrow(arrays)
            counts[map_number] = len(arrays["id"])
        return counts

    def join(self, other: MapBuffers) -> None:
        """Take over what others hold."""
        for own, others in zip(self._of_map, other._of_map, strict=True):
            own.join(others)

    def chosen(self, rows_of: Callable[[int, Arrays], NDArray[np.intp]]) -> Arrays:
        """Some items as a batch brings them.

        Args:
            rows_of: (number of a map, columns of some of its items) -> the rows that are chosen.
        """
        parts = [
            self._as_batch(number, take(columns, rows_of(number, columns)))
            for number, buffer in enumerate(self._of_map)
            for columns in buffer.peek()
        ]
        return concatenate(parts, self._kind)

    def whole(self) -> Arrays:
        """All items as a batch brings them."""
        parts = [
            self._as_batch(number, columns) for number, buffer in enumerate(self._of_map) for columns in buffer.peek()
        ]
        return concatenate(parts, self._kind)

    def _as_batch(self, number: int, columns: Arrays) -> Arrays:
        count = len(columns["position"])
        return {
            name: np.full(count, number, field.dtype)
            if name == "map"
            else columns[name].astype(field.dtype, copy=False)
            for name, field in SCHEMAS[self._kind].items()
        }


class Numbered:
    """The photons of a buffer in the order of their ids. Columns that no tree has (edges, front) are taken out of it.

    Attributes:
        ranks: of each chunk's photons: places in that order.
        edges: of the photons' paths, in that order.
    """

    def __init__(self, buffer: ColumnBuffer) -> None:
        self.ranks = photon_map.ranks_of(buffer)
        self.edges = np.empty(len(buffer), np.int32)
        for edges, rank in zip(buffer.take("edges"), self.ranks, strict=True):
            self.edges[rank] = edges
        for _ in buffer.take("front"):
            pass  # no tree has it


@dataclass(frozen=True, eq=False)
class PositionsOf:
    """Positions of a buffer's items as cluster.work.tree_orders wants them, made when they are asked for.

    Attributes:
        numbered: the order in which they are wanted; None for that of the buffer.
    """

    buffer: ColumnBuffer
    numbered: Numbered | None = None

    def __len__(self) -> int:
        return len(self.buffer)

    def __array__(self, *, copy: bool | None = None) -> NDArray[np.float32]:
        if self.numbered is None:
            return self.buffer.whole("position")
        position = np.empty((len(self.buffer), 3), np.float32)
        for columns, rank in zip(self.buffer.peek(), self.numbered.ranks, strict=True):
            position[rank] = columns["position"]
        return position
