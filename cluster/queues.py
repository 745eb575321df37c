"""Batches that wait, joined with others of the same kind, task and destination."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from wdpm.cluster.batch import TO_HOME, Batch, Kind, concatenate

Key = tuple[Kind, int, int, int]


class Queues:
    """Waiting batches, one queue for each kind, task, home and cell. A queue is taken out as one batch."""

    def __init__(self) -> None:
        self._waiting: dict[Key, list[Batch]] = {}
        self._size: dict[Key, int] = {}

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, batch: Batch) -> None:
        """Let a batch wait."""
        key = (batch.kind, batch.task, batch.home, batch.cell)
        self._waiting.setdefault(key, []).append(batch)
        self._size[key] = self._size.get(key, 0) + len(batch)

    def extend(self, batches: Iterable[Batch]) -> None:
        """Let several batches wait."""
        for batch in batches:
            self.add(batch)

    def pop(self) -> Batch:
        """Take out a queue: results for homes before rays, then the longest."""
        key = max(self._size, key=lambda k: (k[0] in TO_HOME, self._size[k]))
        del self._size[key]
        parts = self._waiting.pop(key)
        if len(parts) == 1:
            return parts[0]
        arrays = concatenate([part.arrays for part in parts], parts[0].kind)
        return Batch(*key, sum(part.credit for part in parts), arrays)


def without_bare_credit(batches: Sequence[Batch]) -> list[Batch]:
    """The same batches, but that credit which brings nothing along travels with what goes to the same home."""
    bare: dict[tuple[int, int], int] = {}
    for batch in batches:
        if batch.kind is Kind.ENDED:
            bare[batch.task, batch.home] = bare.get((batch.task, batch.home), 0) + batch.credit
    out, ended = [], []
    for batch in batches:
        if batch.kind is Kind.ENDED:
            ended.append(batch)
        elif batch.kind in TO_HOME and (more := bare.pop((batch.task, batch.home), 0)):
            out.append(replace(batch, credit=batch.credit + more))
        else:
            out.append(batch)
    left = ((batch, bare.pop((batch.task, batch.home), 0)) for batch in ended)
    return out + [replace(batch, credit=credit) for batch, credit in left if credit]
