"""Cells on their way from the master to the slaves that hold them: a few at once, in parts."""

from __future__ import annotations

from collections import deque

from wdpm.cluster.messages import protocol
from wdpm.scenes.flat.arrays import Triangles


class CellQueue:
    """Which cells wait, and which are on their way: asked for, and not yet received."""

    def __init__(self) -> None:
        self._waiting: deque[int] = deque()
        self._in_flight: set[int] = set()

    def begin(self, cells: int) -> None:
        """All cells of a scene wait."""
        self._waiting = deque(range(cells))

    def next(self) -> int | None:
        """The next cell sets out; None if no more waits."""
        if not self._waiting:
            return None
        cell = self._waiting.popleft()
        self._in_flight.add(cell)
        return cell

    def on_its_way(self, cell: int) -> bool:
        """Whether a cell has set out, and not arrived."""
        return cell in self._in_flight

    def arrived(self, cell: int) -> None:
        """A cell's holder has it."""
        self._in_flight.remove(cell)


def parts_of(epoch: int, cell: int, triangles: Triangles, size: int) -> list[protocol.Partition]:
    """The triangles of a cell as messages of at most `size` triangles each, and at least one."""
    parts = max(1, -(-len(triangles) // size))
    return [protocol.Partition(epoch, cell, part, parts, rows(triangles, part * size, size)) for part in range(parts)]


def rows(triangles: Triangles, start: int, count: int) -> Triangles:
    """A run of triangles, without a copy."""
    part = slice(start, start + count)
    return Triangles(
        triangles.ids[part],
        triangles.positions[part],
        triangles.normals[part],
        triangles.uvs[part],
        triangles.material[part],
        triangles.emitter[part],
        triangles.colors[part] if len(triangles.colors) else triangles.colors,
    )


def partition_is_gone(cell: int) -> Triangles:
    """In the place of a session's partition once nobody may ask for it."""
    raise AssertionError(f"cell {cell} was asked for after all cells were sent")
