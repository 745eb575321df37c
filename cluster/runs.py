"""Whose the rows of a batch are: runs of rows that belong to one task, with the credit that travels with them.

What waits for a cell is computed in one launch, whichever tasks it belongs to. So rows of several tasks lie in one
batch, those of a task one after another: a few numbers for each task say whose all rows are. Rows that are chosen keep
their order, so what follows of them is runs of the same tasks, some of them empty.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.int64]

HOME: Final = 0
TASK: Final = 1
ROWS: Final = 2
CREDIT: Final = 3
COLUMNS: Final = 4

FEW_RUNS: Final = 32
"""Runs that are joined one by one."""


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of rows, one after another.

    Attributes:
        table: of each run the number of the worker that was handed its task (of what maps are built of: of the worker
            that it comes from), the number of the task (-1 where there is none), how many rows it has, and the share
            of the task's credit that travels with it (Mattern 1989): int64, shape [runs, 4]. A run may have credit
            alone, or nothing at all.
    """

    table: NDArray[np.int64]

    @classmethod
    def one(cls, home: int, task: int, rows: int, credit: int) -> Runs:
        """All rows belong to one task."""
        return cls(np.array([[home, task, rows, credit]], np.int64))

    def __len__(self) -> int:
        return len(self.table)

    @property
    def home(self) -> Numbers:
        """Of each run, shape [runs]."""
        return self.table[:, HOME]

    @property
    def task(self) -> Numbers:
        """Of each run, shape [runs]."""
        return self.table[:, TASK]

    @property
    def rows(self) -> Numbers:
        """Of each run, shape [runs]."""
        return self.table[:, ROWS]

    @property
    def credit(self) -> Numbers:
        """Of each run, shape [runs]."""
        return self.table[:, CREDIT]

    @cached_property
    def bounds(self) -> Numbers:
        """Where each run begins, and where the last one ends, shape [runs + 1]."""
        bounds = np.zeros(len(self.table) + 1, np.int64)
        self.table[:, ROWS].cumsum(out=bounds[1:])
        return bounds

    def among(self, rows: NDArray[np.intp]) -> Runs:
        """Runs of the same tasks that some rows are, without credit.

        Args:
            rows: ascending.
        """
        table = self.table.copy()
        table[:, ROWS] = len(rows) if len(table) == 1 else _steps(rows.searchsorted(self.bounds))
        table[:, CREDIT] = 0
        return Runs(table)

    def times(self, each: int) -> Runs:
        """Runs of the same tasks with so many rows in the place of each one."""
        if each == 1:
            return self
        table = self.table.copy()
        table[:, ROWS] *= each
        return Runs(table)

    def with_credit(self, credit: Numbers | int) -> Runs:
        """The same runs with other credit, shape [runs]; or with so much of each."""
        table = self.table.copy()
        table[:, CREDIT] = credit
        return Runs(table)

    def with_unit(self, unit: int = 1) -> Runs:
        """The same runs with so much credit for each row."""
        return self.with_credit(self.table[:, ROWS] * unit)

    def without_rows(self, credit: Numbers) -> Runs:
        """Runs of the same tasks that have credit alone, shape [runs]."""
        table = self.table.copy()
        table[:, ROWS], table[:, CREDIT] = 0, credit
        return Runs(table)

    def sums(self, values: NDArray[Any]) -> Numbers:
        """Sum of a whole number of each row, run by run, shape [runs]."""
        if len(self.table) == 1:
            return np.array([values.sum(dtype=np.int64)])
        total = np.zeros(len(values) + 1, np.int64)
        values.cumsum(out=total[1:])
        return _steps(total[self.bounds])

    def numbers(self) -> Numbers:
        """Of each row the number of its run, shape [rows]."""
        return np.repeat(np.arange(len(self.table)), self.table[:, ROWS])

    def occupied(self) -> Runs:
        """Those that have rows or credit."""
        if len(self.table) == 1:
            _, _, rows, credit = self.table[0].tolist()
            return self if rows or credit else Runs(self.table[:0])
        some = (self.table[:, ROWS] | self.table[:, CREDIT]) != 0
        return self if np.count_nonzero(some) == len(some) else Runs(self.table[some])

    def slices(self, column: int) -> Iterator[tuple[int, Runs, slice]]:
        """The runs of each home (column HOME), or of each task (TASK), and their rows.

        What has the same number there must stand together.
        """
        numbers = self.table[:, column]
        if len(numbers) == 1 or np.count_nonzero(numbers != numbers[0]) == 0:
            yield int(numbers[0]), self, slice(None)
            return
        begins = [0, *((numbers[1:] != numbers[:-1]).nonzero()[0] + 1).tolist(), len(numbers)]
        for first, last in pairwise(begins):
            rows = slice(int(self.bounds[first]), int(self.bounds[last]))
            yield int(numbers[first]), Runs(self.table[first:last]), rows

    def added(self, other: Runs) -> Runs:
        """The same runs with the credit of others, which have no rows."""
        joined, _ = join([self, other])
        return joined


def join(parts: Sequence[Runs]) -> tuple[Runs, list[int] | None]:
    """One run for each task of several batches, ascending by home and task.

    Returns:
        The runs, and the order in which the runs of the parts, one part after another, make them up; None if that is
        the order in which they are.
    """
    if sum(map(len, parts)) <= FEW_RUNS:
        return _join_few([run for part in parts for run in part.table.tolist()])
    table = np.concatenate([part.table for part in parts])
    order = np.lexsort((table[:, TASK], table[:, HOME]))
    ascending = bool((order[1:] > order[:-1]).all())
    if not ascending:
        table = table[order]
    first = np.concatenate([[0], (table[1:, :ROWS] != table[:-1, :ROWS]).any(axis=1).nonzero()[0] + 1])
    whole = table[first]
    whole[:, ROWS:] = np.add.reduceat(table[:, ROWS:], first, axis=0)
    return Runs(whole), None if ascending else order.tolist()


def _join_few(runs: list[list[int]]) -> tuple[Runs, list[int] | None]:
    """The same as join, of runs as lists: NumPy's calls take as long as a hundred numbers do."""
    order = sorted(range(len(runs)), key=lambda number: runs[number][:ROWS])  # equal ones as they come
    whole: list[list[int]] = []
    for number in order:
        home, task, rows, credit = runs[number]
        if whole and whole[-1][HOME] == home and whole[-1][TASK] == task:
            whole[-1][ROWS] += rows
            whole[-1][CREDIT] += credit
        else:
            whole.append([home, task, rows, credit])
    ascending = all(before < after for before, after in pairwise(order))
    return Runs(np.array(whole, np.int64).reshape(-1, COLUMNS)), None if ascending else order


def _steps(numbers: Numbers) -> Numbers:
    """What each is over the one before."""
    return numbers[1:] - numbers[:-1]
