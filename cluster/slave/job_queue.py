"""What a slave has to do, and in which order it does it.

Orders of the master come first, then what maps are built of, then batches, then new tasks. In one turn as many batches
are handled as have some thousand rows together, not all that wait: what follows from some is on its way to the peers
while the next are computed (measured: half the time for photons over 4 slaves). Rays that the worker's own tasks send
into its own cells wait here like those of others, in pieces. A few rows take as long as the
interpreter takes for a turn however few there are, so they wait a moment for more, and new tasks, of which many rays
come at once, are begun before them.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, TypeGuard

from wdpm.cluster.batch import OF_MAPS, TO_HOME, Batch
from wdpm.cluster.queues import Queues
from wdpm.cluster.slave import jobs
from wdpm.cluster.slave.jobs import Job
from wdpm.cluster.slave.map_inputs import MapInputs

ROWS_A_TURN: Final = 1 << 14
"""Rows of the batches that are handled in one turn, unless the first has more."""

FEW_ROWS: Final = 1 << 11
"""Rows that take less time than a turn takes however few there are."""

HOLD_S: Final = 0.002
"""How long those wait for more at least, in a process of its own [s]: some ten times as long as a message is on its way
between two slaves of one machine, so that what several send comes together."""

MOST_HOLD_S: Final = 0.05
"""How long they wait at most, however few cores there are [s]."""

TURNS_HELD: Final = 2.0
"""How many times as long they wait as turns of few rows have waited for a core, if that is longer. Where slaves share
cores, what is on its way to this one comes that much later, and what waits leaves the cores to those that have more
to do. Where each has a core of its own, all would wait for what is held."""

_AVERAGED_TURNS: Final = 8
"""Turns over which that is averaged, about."""

SHORT_S: Final = 0.02
"""Turns of few rows that take no longer, on the average, are done by the thread that has taken the rows in [s]. To wake
another, and to be woken by it, costs as much as such a turn where slaves share cores. Heartbeats wait for no longer."""


class JobQueue:
    """Orders, batches and tasks that wait.

    Args:
        hold_s: how long few rows wait for more while there is nothing else to do, at least [s]; 0 for not at all.
    """

    def __init__(self, hold_s: float) -> None:
        self.orders: deque[Job] = deque()
        self.map_inputs = MapInputs()
        self.tasks: deque[jobs.StartTask] = deque()
        self._batches = Queues()
        self._hold_s = hold_s
        self._held_since: float | None = None
        self._late_s = 0.0  # how much longer than they should few rows have waited the last time
        self._waited_s = 0.0  # for a core, in a turn of few rows
        self._ran_s = math.inf  # such a turn

    def ended(self, job: Job, ran_s: float, waited_s: float) -> None:
        """A job has ended.

        Args:
            ran_s: how long it was computed [s].
            waited_s: of the time from when it was handed out until its outcome was here, how long nobody computed [s].
        """
        if not _has_few_rows(job):
            return
        self._waited_s += (self._late_s + waited_s - self._waited_s) / _AVERAGED_TURNS
        self._ran_s = ran_s if math.isinf(self._ran_s) else self._ran_s + (ran_s - self._ran_s) / _AVERAGED_TURNS

    def is_short(self, job: Job) -> bool:
        """Whether a job takes no longer than SHORT_S, by what others like it have taken.

        What comes home may be the last that a home waits for, which then does what it can do with all.
        """
        return self._ran_s <= SHORT_S and _has_few_rows(job) and not any(b.kind in TO_HOME for b in job.batches)

    @property
    def _hold(self) -> float:
        """How long few rows wait now [s]."""
        return max(self._hold_s, min(TURNS_HELD * self._waited_s, MOST_HOLD_S)) if self._hold_s > 0.0 else 0.0

    def add(self, batch: Batch) -> None:
        """Let a batch wait."""
        if batch.kind in OF_MAPS:
            self.map_inputs.add(batch)
        else:
            self._batches.add(batch)

    def clear(self) -> None:
        """Nothing is to be done any more."""
        self.orders.clear()
        self.map_inputs = MapInputs()
        self.tasks.clear()
        self._batches = Queues()
        self._held_since = None

    @property
    def wake_at(self) -> float | None:
        """When few rows will have waited for long enough; None if none wait."""
        return None if self._held_since is None else self._held_since + self._hold

    def next_job(self, now: float) -> Job | None:
        """What is to be done next, if the worker is at nothing.

        Args:
            now: any clock that grows [s].
        """
        held, self._held_since = self._held_since, None
        if self.orders:
            return self.orders.popleft()
        if self.map_inputs:
            return jobs.HandleBatches((self.map_inputs.pop(),))
        few = self._batches.rows < FEW_ROWS and self._hold_s > 0.0
        if self._batches and not few:
            return jobs.HandleBatches(self._batches.take(ROWS_A_TURN))
        if self.tasks:
            return self.tasks.popleft()
        if not self._batches:
            return None
        since = now if held is None else held
        if now < since + self._hold:
            self._held_since = since
            return None
        self._late_s = now - since - self._hold
        return jobs.HandleBatches(self._batches.take(ROWS_A_TURN))


def _has_few_rows(job: Job) -> TypeGuard[jobs.HandleBatches]:
    """Whether it is a turn of few rows of rays and what comes home."""
    if not isinstance(job, jobs.HandleBatches) or job.batches[0].kind in OF_MAPS:
        return False
    return sum(map(len, job.batches)) < FEW_ROWS
