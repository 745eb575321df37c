"""How long a render would take on so many cores: its critical path, from the CPU times of its parts.

A render is what its first process does while no other is at a task, and, between that, phases in which as many
processes as there are cores do tasks. All times are CPU seconds, so other programs do not count. What is not reckoned:
that cores share memory and its bandwidth, and a clock that falls as more of them work.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from wdpm.cluster.work.processes.fork_tree import divided


@dataclass(frozen=True)
class Path:
    """A critical path, or a part of it, by what takes the time [s].

    Attributes:
        alone: one thread of the first process.
        launches: launches that are cut for its threads, as long as their chunks take on all cores.
        even: tasks, and what else all cores can share, if none ever had to wait.
        waiting: of processes for their fork, and for the longest tasks.
    """

    alone: float = 0.0
    launches: float = 0.0
    even: float = 0.0
    waiting: float = 0.0

    @property
    def seconds(self) -> float:
        """All of it."""
        return self.alone + self.launches + self.even + self.waiting

    def __add__(self, other: Path) -> Path:
        return Path(*(mine + others for mine, others in zip(self._parts, other._parts, strict=True)))

    def __sub__(self, other: Path) -> Path:
        return Path(*(mine - others for mine, others in zip(self._parts, other._parts, strict=True)))

    @property
    def _parts(self) -> tuple[float, ...]:
        return self.alone, self.launches, self.even, self.waiting


@dataclass(frozen=True)
class Alone:
    """What the first process does while no other is at a task [CPU s].

    Attributes:
        thread: its one thread.
        launches: of each launch that was cut for threads the time of each chunk.
        beside: other threads, but for those chunks. They are taken to be done by the time that they are waited for, if
            there are cores enough for all together.
    """

    thread: float
    launches: tuple[tuple[float, ...], ...] = ()
    beside: float = 0.0

    def path(self, cores: int) -> Path:
        """What it takes on so many cores."""
        launches = sum(last_end(chunks, [0.0] * cores) for chunks in self.launches)
        together = (self.thread + sum(map(sum, self.launches)) + self.beside) / cores
        return Path(alone=self.thread, launches=launches, even=max(0.0, together - self.thread - launches))


@dataclass(frozen=True)
class Phase:
    """Tasks that processes did, until none was left [CPU s].

    Attributes:
        tasks: in the order in which they were handed out.
        there: processes that were forked before.
        forked: how many were forked for them.
        fork: what forking one takes whoever does it.
        together: whether those that were forked forked others.
        first_process: its own work meanwhile: it hands out tasks, and takes in what comes of them.
    """

    tasks: tuple[float, ...]
    there: int = 0
    forked: int = 0
    fork: float = 0.0
    together: bool = True
    first_process: float = 0.0

    def path(self, cores: int) -> Path:
        """What it takes on so many cores, which have a process each."""
        there = max(0, min(self.there, cores - self.forked))  # others have ended meanwhile
        ready = [0.0] * there + arrivals(self.forked, self.fork, together=self.together)
        even = (sum(self.tasks) + self.first_process) / cores
        return Path(even=even, waiting=max(0.0, last_end(self.tasks, ready) - even))


@dataclass
class Render:
    """The parts of a render, in their order."""

    parts: list[Alone | Phase] = field(default_factory=list)

    @property
    def tasks(self) -> int:
        """How many tasks processes did."""
        return sum(len(part.tasks) for part in self.parts if isinstance(part, Phase))

    def path(self, cores: int) -> Path:
        """Its critical path on so many cores."""
        return sum((part.path(cores) for part in self.parts), Path())


def last_end(durations: Iterable[float], ready: Sequence[float]) -> float:
    """When the last of some tasks ends, each of which is done by whoever is free first; 0 if there are none.

    Args:
        durations: in the order in which tasks are handed out [s].
        ready: from when each of those who do them is free, at least one [s].
    """
    free, last = list(ready), 0.0
    heapq.heapify(free)
    for duration in durations:
        end = free[0] + duration
        heapq.heapreplace(free, end)
        last = max(last, end)
    return last


def arrivals(count: int, fork: float, *, together: bool) -> list[float]:
    """When each of so many processes begins with tasks that are forked from now on [s].

    Args:
        fork: what forking one takes [s].
        together: whether they fork each other, as cluster.work.processes.fork_tree has it. Then each begins when it has
            forked what it was given.
    """
    if not together:
        return [fork * (place + 1) for place in range(count)]
    begins = [0.0] * count

    def fork_all(places: range, now: float) -> float:
        """When whoever forks these is done with it."""
        while places:
            places, given = divided(places)
            now += fork
            begins[given[0]] = fork_all(given[1:], now)
        return now

    fork_all(range(count), 0.0)
    return begins
