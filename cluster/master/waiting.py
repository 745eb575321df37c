"""Tasks that wait to be handed out, by the cell with whose holder they are best at home."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence

from wdpm.cluster.master.homes import ANYWHERE
from wdpm.cluster.task import Task


class Waiting:
    """Queues of tasks, one for each cell that some of them are about, in which they keep their order.

    Args:
        cell_of: the cell that a task is about, or ANYWHERE.
    """

    def __init__(self, tasks: Iterable[Task] = (), cell_of: Callable[[Task], int] = lambda _: ANYWHERE) -> None:
        self._cell_of = cell_of
        self._queues: dict[int, deque[Task]] = {}
        for task in tasks:
            self._queues.setdefault(cell_of(task), deque()).append(task)

    def __len__(self) -> int:
        return sum(map(len, self._queues.values()))

    def put_back(self, tasks: Sequence[Task]) -> None:
        """Some of them wait again, before all others."""
        for task in reversed(tasks):
            self._queues.setdefault(self._cell_of(task), deque()).appendleft(task)

    def next_for(self, cells: Collection[int], *, idle: bool) -> Task | None:
        """The task that who holds these cells is to be handed next, if there is one for it.

        One about its own cells if there is one, then one about none. Only who is idle is handed one about another's
        cell, the one that most tasks are about: of such a task it can do little but put it together.

        Args:
            idle: whether it has no task.
        """
        queue = self._queue_for(cells, idle)
        return self._queues[queue][0] if queue is not None else None

    def take(self, task: Task) -> None:
        """It waits no longer; it is the first about its cell."""
        cell = self._cell_of(task)
        queue = self._queues[cell]
        if queue.popleft() is not task:
            raise AssertionError(f"{task} is not the first about cell {cell}")
        if not queue:
            del self._queues[cell]

    def _queue_for(self, cells: Collection[int], idle: bool) -> int | None:
        own = [cell for cell in self._queues if cell in cells]
        if not own and ANYWHERE in self._queues:
            return ANYWHERE
        return max(own or (self._queues if idle else ()), key=lambda cell: len(self._queues[cell]), default=None)
