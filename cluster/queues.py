"""Batches that wait, joined with others of the same kind and destination."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from wdpm.cluster.batch import TO_HOME, Batch, Kind, joined

Key = tuple[Kind, int]


class Queues:
    """Waiting batches, one queue for each kind and cell, or home for what goes to one. It is taken out as one batch."""

    def __init__(self) -> None:
        self._waiting: dict[Key, list[Batch]] = {}
        self._size: dict[Key, int] = {}

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def rows(self) -> int:
        """Of all that wait."""
        return sum(self._size.values())

    def add(self, batch: Batch) -> None:
        """Let a batch wait."""
        key = (batch.kind, batch.home if batch.kind in TO_HOME else batch.cell)
        self._waiting.setdefault(key, []).append(batch)
        self._size[key] = self._size.get(key, 0) + len(batch)

    def extend(self, batches: Iterable[Batch]) -> None:
        """Let several batches wait."""
        for batch in batches:
            self.add(batch)

    def take(self, rows: int) -> tuple[Batch, ...]:
        """Take out queues until they have so many rows together, or none is left; one at least, if there is one."""
        taken: list[Batch] = []
        while self._waiting and rows > 0:
            taken.append(self.pop())
            rows -= len(taken[-1])
        return tuple(taken)

    def pop(self) -> Batch:
        """Take out a queue: results for homes before rays, then the longest."""
        key = max(self._size, key=lambda k: (k[0] in TO_HOME, self._size[k]))
        del self._size[key]
        return joined(self._waiting.pop(key))


def without_bare_credit(batches: Sequence[Batch]) -> list[Batch]:
    """The same batches, but that credit which brings nothing along travels with what goes to the same home."""
    ended_for: dict[int, list[Batch]] = {}
    for batch in batches:
        if batch.kind is Kind.ENDED:
            ended_for.setdefault(batch.home, []).append(batch)
    bare = {home: joined(ended) for home, ended in ended_for.items()}
    out = []
    for batch in batches:
        if batch.kind is Kind.ENDED:
            continue
        if batch.kind in TO_HOME and (ended := bare.pop(batch.home, None)) is not None:
            out.append(replace(batch, runs=batch.runs.added(ended.runs)))
        else:
            out.append(batch)
    return out + list(bare.values())
