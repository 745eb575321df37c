"""Batches that wait, joined with others of the same kind and destination."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate
from typing import Final

import numpy as np

from wdpm.cluster.batch import TO_HOME, Batch, Kind, joined
from wdpm.cluster.runs import TASK, Runs

Key = tuple[Kind, int]

CREDIT_FLIES_WITH: Final = frozenset({Kind.PHOTON, Kind.LANDED})
"""Kinds of which a cell keeps any credit beyond one for each row until it can go on with others: see PhotonPaths."""


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
        """Take out about so many rows, of one queue after another: batches are not cut, and one at least is taken."""
        taken: list[Batch] = []
        while self._waiting and rows > 0:
            taken.append(self.pop(rows))
            rows -= len(taken[-1])
        return tuple(taken)

    def pop(self, rows: int | None = None) -> Batch:
        """Take out a queue: results for homes before rays, then the longest.

        Args:
            rows: of a longer one as many of the batches that came first as have no more than these; None for all.
        """
        key = max(self._size, key=lambda k: (k[0] in TO_HOME, self._size[k]))
        waiting = self._waiting[key]
        if rows is None or self._size[key] <= rows:
            del self._size[key]
            return joined(self._waiting.pop(key))
        ends = list(accumulate(map(len, waiting)))
        count = max(1, bisect_right(ends, rows))
        if count == len(waiting):
            del self._size[key]
            return joined(self._waiting.pop(key))
        self._size[key] -= ends[count - 1]
        self._waiting[key] = waiting[count:]
        return joined(waiting[:count])


def without_bare_credit(batches: Sequence[Batch]) -> list[Batch]:
    """The same batches, but that credit which brings nothing along travels with others.

    That is a batch to the same home, or photons of the same task that fly on: they bring it home when they end.
    """
    owed: dict[int, dict[int, int]] = {}  # by home and task
    cell = 0
    for batch in batches:
        if batch.kind is Kind.ENDED:
            cell, of_home = batch.cell, owed.setdefault(batch.home, {})
            for _, task, _, credit in batch.runs.table.tolist():
                of_home[task] = of_home.get(task, 0) + credit
    if not owed:
        return list(batches)
    kept = [_with_credit_of(batch, owed) for batch in batches if batch.kind is not Kind.ENDED]
    out = []
    for batch in kept:
        if batch.kind in TO_HOME and (of_home := owed.pop(batch.home, {})):
            batch = replace(batch, runs=batch.runs.added(_bare(batch.home, of_home)))
        out.append(batch)
    return out + [Batch(Kind.ENDED, cell, _bare(home, of_home), {}) for home, of_home in owed.items() if of_home]


def _with_credit_of(batch: Batch, owed: dict[int, dict[int, int]]) -> Batch:
    """Photons that take the credit of their tasks with them, which is owed no more; any other batch as it is."""
    if batch.kind not in CREDIT_FLIES_WITH:
        return batch
    more = [owed.get(home, {}).pop(task, 0) for home, task in batch.runs.table[:, : TASK + 1].tolist()]
    return replace(batch, runs=batch.runs.with_credit(batch.runs.credit + more)) if any(more) else batch


def _bare(home: int, of_tasks: Mapping[int, int]) -> Runs:
    """Credit alone, by task."""
    return Runs(np.array([[home, task, 0, credit] for task, credit in sorted(of_tasks.items())], np.int64))
