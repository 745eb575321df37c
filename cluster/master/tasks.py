"""The tasks of a master: handed out to slaves in turn, and what came of them. It knows no phases and no messages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from wdpm.cluster.kept import BucketKept
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.buckets import buckets, rectangle_of
from wdpm.cluster.master.film import Film
from wdpm.cluster.master.homes import ANYWHERE, cell_of_bucket
from wdpm.cluster.master.members import Member, Members
from wdpm.cluster.master.records import RecordRounds
from wdpm.cluster.master.task_sizes import Capacity, equally_fast, parallel_record_tasks, record_limits
from wdpm.cluster.master.waiting import Waiting
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.task import (
    BucketRendered,
    BucketTask,
    PhotonsTraced,
    PhotonTask,
    RecordsMade,
    RecordTask,
    Task,
    TaskResult,
)
from wdpm.scenes.errors import ProtocolError

LATE = 4.0
"""A task is late if it takes so many times the mean of those that are done ..."""

LATE_S = 10.0
"""... and at least so long [s]: another slave that has nothing to do is given it, too."""


@dataclass
class _InFlight:
    """A task that slaves are at.

    Attributes:
        since: when it was handed out first [s].
        slaves: their numbers.
    """

    task: Task
    since: float
    slaves: set[int]


class Tasks:
    """Tasks of one kind after another: photon paths, rounds of records, buckets.

    A task whose slave is lost waits again. Its result has the same bits whoever brings it, so it may also be with two
    slaves at once; the first result counts.

    Attributes:
        film: the image, from its first bucket until the session ends.
        rounds: of records, from the first until the session ends.
        counted: of the photons that the maps are of, as `statistics.all_photons_counted`.
        ever_done: tasks that were done in all sessions.
        retried: tasks that had to be handed out again.
    """

    def __init__(self) -> None:
        self.film: Film | None = None
        self.rounds: RecordRounds | None = None
        self.counted: dict[str, Any] = {}
        self._went_on = False
        self._photons: dict[int, PhotonsTraced] = {}  # by first path
        self._paths: list[tuple[int, int]] = []
        self._waiting = Waiting()
        self._in_flight: dict[int, _InFlight] = {}
        self._done: dict[int, Task] = {}
        self._seconds: list[float] = []  # that each of those took
        self._next_number = 0
        self._total = 0
        self._left = 0  # size of the tasks that are not done
        self.ever_done = self.retried = 0

    @property
    def waiting(self) -> bool:
        """Whether tasks wait to be handed out."""
        return len(self._waiting) > 0

    @property
    def total(self) -> int:
        """Tasks of the phase."""
        return self._total

    @property
    def finished(self) -> bool:
        """Whether none waits, and slaves are at none."""
        return not len(self._waiting) and not self._in_flight

    @property
    def late_after(self) -> float:
        """How long a task of the phase takes that is late [s]."""
        return max(LATE_S, LATE * sum(self._seconds) / max(len(self._seconds), 1))

    @property
    def begun(self) -> float:
        """The share of the tasks that were handed out."""
        return 1.0 - len(self._waiting) / max(self._total, 1)

    @property
    def photons(self) -> tuple[PhotonsTraced, ...]:
        """What came of the photon paths that the maps are of, in the order of the paths."""
        return tuple(self._photons[start] for start in sorted(self._photons))

    def trace(self, paths: int, size: int) -> None:
        """Photon paths are to be traced, `size` a task."""
        self._photons = {}
        self._paths = [(start, min(start + size, paths)) for start in range(0, paths, size)]
        self._begin(self.photon_tasks())

    def photon_tasks(self) -> list[PhotonTask]:
        """The tasks of that trace, under new numbers: for all teams together, or once more for one by itself."""
        tasks = [PhotonTask(self._next_number + index, *paths) for index, paths in enumerate(self._paths)]
        self._next_number += len(tasks)
        return tasks

    def make_records(
        self, rounds: RecordRounds, session: Session, members: Members, teams: int, limits: ClusterLimits
    ) -> None:
        """The records of the round that is next are to be made."""
        self.rounds = rounds
        limits = record_limits(session, limits)
        at_once = parallel_record_tasks(session, members, teams, rounds.rays_expected, limits)
        if session.sight.size:
            tasks, cells = rounds.tasks_by_cell(session, at_once, self._next_number)
        else:
            alike = equally_fast(members)
            tasks, cells = rounds.tasks(at_once, limits, self._next_number, alike=alike), {}
        self._next_number += len(tasks)
        self._begin(tasks, cells)

    def render(self, session: Session, at_once: int = 1) -> list[BucketKept]:
        """An image is to be rendered, but for buckets that were kept. Returns those of them that belong to it.

        Args:
            at_once: buckets that are rendered at a time, without waiting for each other.
        """
        view = session.view
        self.film = Film(view.camera.width, view.camera.height, session.layers)
        there = {rectangle_of(each.task): each for each in session.kept.buckets}
        tasks = buckets(view, at_once, self._next_number, there)
        self._next_number += len(tasks)
        used = [there[rectangle_of(task)] for task in tasks if rectangle_of(task) in there]
        self._went_on = bool(used)
        for each in used:
            self.film.put(each.task, each.result)
        cells = {task.number: cell_of_bucket(session, task) for task in tasks}
        self._begin([task for task in tasks if rectangle_of(task) not in there], cells)
        return used

    def _begin(self, tasks: Sequence[Task], cells: Mapping[int, int] | None = None) -> None:
        """Have tasks wait.

        Args:
            cells: that they are about, by task; None if about none.
        """
        about = cells or {}
        self._in_flight, self._done, self._seconds = {}, {}, []
        self._waiting = Waiting(tasks, lambda task: about.get(task.number, ANYWHERE))
        self._total = len(tasks)
        self._left = sum(map(size_of, tasks))

    def hand_out(self, capacities: Sequence[Capacity], now: float) -> Iterator[tuple[Member, Task]]:
        """Tasks, one each in turn, as far as they go."""
        for depth in range(max((capacity.most for capacity in capacities), default=0)):
            for capacity in capacities:
                member = capacity.member
                if depth >= capacity.most or len(member.in_flight) != depth:
                    continue
                task = self._waiting.next_for(member.cells, idle=not depth)
                if task is not None and self._goes_to(capacity, task):
                    self._waiting.take(task)
                    self._in_flight[task.number] = _InFlight(task, now, {member.number})
                    member.in_flight[task.number] = task
                    yield member, task

    def _goes_to(self, capacity: Capacity, task: Task) -> bool:
        """Whether a task is for this slave: to begin with now, or to wait there."""
        at_hand = capacity.member.in_flight
        size = sum(map(size_of, at_hand.values()))
        return len(at_hand) < capacity.at_once or capacity.takes(size_of(task), size, self._left)

    def hand_out_late(self, idle: Sequence[Member], now: float) -> Iterator[tuple[Member, Task]]:
        """For slaves that have nothing to do: tasks that others take very long for, each to one more slave.

        Whoever was given one that was late may be slow as well, or stand still: after as long again another is.
        """
        if self.waiting or not self._seconds:
            return
        limit = self.late_after
        late = [
            each
            for each in self._in_flight.values()
            if now - each.since > limit * len(each.slaves) and not isinstance(each.task, PhotonTask)
        ]
        for member, running in zip(idle, sorted(late, key=lambda each: each.since), strict=False):
            running.slaves.add(member.number)
            member.in_flight[running.task.number] = running.task
            yield member, running.task

    def hand_out_own_trace(
        self, members: Sequence[Member], tasks: list[PhotonTask], limit: int
    ) -> Iterator[tuple[Member, Task]]:
        """Tasks of a team's own trace, at most so many with each of its slaves."""
        for member in members:
            while tasks and len(member.in_flight) < limit:
                task = tasks.pop(0)
                member.in_flight[task.number] = task
                yield member, task

    def give_back(self, member: Member) -> None:
        """What a slave was at waits again, unless another one is at it, too."""
        again = []
        for number, task in member.in_flight.items():
            running = self._in_flight.get(number)
            if running is not None:
                running.slaves.discard(member.number)
                if not running.slaves:
                    del self._in_flight[number]
                    again.append(task)
        self._waiting.put_back(again)
        self.retried += len(again)
        member.in_flight.clear()

    def lose_photons(self, traced: Sequence[PhotonTask]) -> None:
        """What tasks brought is lost with the slaves that had it: they wait again."""
        for task in traced:
            del self._photons[task.start], self._done[task.number]
        self._waiting.put_back(traced)
        self._left += sum(map(size_of, traced))

    def take(self, member: Member, result: TaskResult, now: float) -> Task | None:
        """Keep what came of a task. Returns the task; None if its result is there, or is not wanted any more."""
        handed = member.in_flight.get(result.number)
        running = self._in_flight.get(result.number)
        if handed is None or running is None:
            self._check_repeated(result, handed)
            member.in_flight.pop(result.number, None)
            return None
        self._keep(handed, result)
        self._seconds.append(now - running.since)
        member.done += 1
        member.busy_s += now - running.since
        del member.in_flight[handed.number], self._in_flight[handed.number]
        self._done[handed.number] = handed
        self._left -= size_of(handed)
        self.ever_done += 1
        return handed

    def take_own_trace(self, member: Member, result: TaskResult) -> None:
        """A slave has done a task of a trace of its own: what it brings is known, or as good as that of the others."""
        task = member.in_flight.get(result.number)
        if not (isinstance(task, PhotonTask) and isinstance(result, PhotonsTraced)):
            raise ProtocolError(f"{type(result).__name__} came for {task}")
        _check_paths(task, result)
        self._photons[task.start] = result
        self.ever_done += 1
        del member.in_flight[task.number]

    def end(
        self,
        statistics: list[dict[str, Any]],
        seconds: dict[str, float],
        dropped: Mapping[str, int],
        lost: tuple[str, ...],
        unheard: tuple[str, ...] = (),
    ) -> SessionResult:
        """All is done: what came of the session. Image, records and tasks are let go of.

        A slave may still be at a task that another was faster with: there is nothing left to compare its result with.

        Args:
            See SessionResult.
        """
        film, rounds = self.film, self.rounds
        if film is None or rounds is None:
            raise AssertionError("a session ended without a film")
        self.film = self.rounds = None
        self._begin(())
        return SessionResult(
            film.layers,
            statistics,
            self.photons,
            self.counted,
            seconds,
            dict(dropped),
            rounds.records,
            rounds.rays,
            lost,
            unheard,
            self._went_on or rounds.kept > 0,
        )

    def _keep(self, task: Task, result: TaskResult) -> None:
        if isinstance(task, PhotonTask) and isinstance(result, PhotonsTraced):
            _check_paths(task, result)
            self._photons[task.start] = result
        elif isinstance(task, BucketTask) and isinstance(result, BucketRendered) and self.film is not None:
            self.film.put(task, result)
        elif isinstance(task, RecordTask) and isinstance(result, RecordsMade) and self.rounds is not None:
            self.rounds.put(task, result)
        else:
            raise ProtocolError(f"{type(result).__name__} came for {task}")

    def _check_repeated(self, result: TaskResult, handed: Task | None) -> None:
        """A result that is there already: harmless if it says the same again."""
        task = self._done.get(result.number)
        if task is None:
            if handed is None:
                raise ProtocolError(f"a result came for task {result.number}, which it was not handed")
            return  # of a phase that has ended: another slave was faster
        if isinstance(task, BucketTask) and isinstance(result, BucketRendered) and self.film is not None:
            same = self.film.holds(task, result)
        elif isinstance(task, PhotonTask) and isinstance(result, PhotonsTraced):
            same = replace(self._photons[task.start], number=result.number) == result
        elif isinstance(task, RecordTask) and isinstance(result, RecordsMade) and self.rounds is not None:
            same = self.rounds.holds(task, result)
        else:
            raise ProtocolError(f"{type(result).__name__} came for {task}")
        if not same:
            raise ProtocolError(f"two results of task {result.number} differ")


def units(task: Task) -> int:
    """How much work a task is, as progress counts it: paths, candidates, buckets."""
    return 1 if isinstance(task, BucketTask) else size_of(task)


def size_of(task: Task) -> int:
    """How much work a task is, compared with others of its phase: paths, candidates, pixels."""
    match task:
        case BucketTask():
            return (task.x1 - task.x0) * (task.y1 - task.y0)
        case RecordTask():
            return task.count
        case PhotonTask():
            return task.stop - task.start


def _check_paths(task: PhotonTask, result: PhotonsTraced) -> None:
    paths = task.stop - task.start
    if result.paths != paths:
        raise ProtocolError(f"photon task {task.number} has {paths} paths; it says {result.paths}")
