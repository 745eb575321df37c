"""Cells on their way from the master to the slaves that hold them: a few at once, in parts."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from wdpm.cluster.messages import protocol
from wdpm.scenes.flat.arrays import Triangles


@dataclass(frozen=True)
class Delivery:
    """A cell that a slave is to get, in an epoch of its team."""

    epoch: int
    slave: int
    cell: int


class CellQueue:
    """Which cells wait, which are being made, and which are on their way: sent, and not yet received.

    Args:
        limit: most that are made or on their way at once.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._waiting: deque[Delivery] = deque()
        self._made_for: deque[Delivery] = deque()
        self._on_their_way: set[Delivery] = set()

    def add(self, delivery: Delivery) -> None:
        """A cell waits."""
        self._waiting.append(delivery)

    def forget(self, epoch: int) -> None:
        """Nothing of an epoch is wanted any more. What is being made will find nobody."""
        self._waiting = deque(each for each in self._waiting if each.epoch != epoch)
        self._made_for = deque(each for each in self._made_for if each.epoch != epoch)
        self._on_their_way = {each for each in self._on_their_way if each.epoch != epoch}

    def next(self) -> list[int]:
        """The cells that are to be made now, once for each delivery that sets out."""
        cells = []
        while self._waiting and len(self._made_for) + len(self._on_their_way) < self._limit:
            self._made_for.append(self._waiting.popleft())
            cells.append(self._made_for[-1].cell)
        return cells

    def made(self, cell: int) -> Delivery | None:
        """A cell was made: for whom; None if nobody wants it any more."""
        for delivery in self._made_for:
            if delivery.cell == cell:
                self._made_for.remove(delivery)
                self._on_their_way.add(delivery)
                return delivery
        return None

    def arrived(self, delivery: Delivery) -> bool:
        """A slave says that it has a cell; False if that was not on its way to it."""
        if delivery not in self._on_their_way:
            return False
        self._on_their_way.remove(delivery)
        return True


def parts_of(epoch: int, cell: int, triangles: Triangles, size: int) -> list[protocol.Partition]:
    """The triangles of a cell as messages of at most `size` each, and at least one; instances are in the first."""
    parts = max(1, -(-len(triangles) // size))
    runs = [rows(triangles, part * size, size) for part in range(parts)]
    runs[0] = runs[0].with_instances(triangles.instances)
    return [protocol.Partition(epoch, cell, part, parts, run) for part, run in enumerate(runs)]


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
        triangles.area_before[part],
    )
