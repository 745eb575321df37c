"""The tasks of a master: handed out to slaves in turn, and what came of them. It knows no phases and no messages."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.film import Film, spiral
from wdpm.cluster.master.members import Member, Members
from wdpm.cluster.master.records import RecordRounds
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
from wdpm.cluster.world import View
from wdpm.scenes.errors import ProtocolError


class Tasks:
    """Tasks of one kind after another: photon paths, rounds of records, buckets.

    Attributes:
        film: the image, from its first bucket until the session ends.
        rounds: of records, from the first until the session ends.
    """

    def __init__(self) -> None:
        self.film: Film | None = None
        self.rounds: RecordRounds | None = None
        self._photons: dict[int, PhotonsTraced] = {}
        self._waiting: deque[Task] = deque()
        self._done: dict[int, Task] = {}
        self._next_number = 0

    @property
    def waiting(self) -> bool:
        """Whether tasks wait to be handed out."""
        return bool(self._waiting)

    @property
    def photons(self) -> tuple[PhotonsTraced, ...]:
        """What came of the photon paths that the maps are of, by task."""
        return tuple(self._photons[number] for number in sorted(self._photons))

    def trace(self, paths: int, size: int) -> None:
        """Photon paths are to be traced, `size` a task."""
        self._photons = {}
        self._begin(
            [
                PhotonTask(self._next_number + index, start, min(start + size, paths))
                for index, start in enumerate(range(0, paths, size))
            ]
        )

    def make_records(self, rounds: RecordRounds, slaves: int, limits: ClusterLimits) -> None:
        """The records of a round are to be made."""
        self.rounds = rounds
        self._begin(rounds.tasks(slaves, limits, self._next_number))

    def render(self, view: View, layers: Mapping[str, int]) -> int:
        """An image is to be rendered. Returns how many buckets it has."""
        self.film = Film(view.camera.width, view.camera.height, layers)
        buckets = spiral(view.camera.width, view.camera.height, view.bucket, self._next_number)
        self._begin(buckets)
        return len(buckets)

    def _begin(self, tasks: Sequence[Task]) -> None:
        self._done = {}
        self._waiting = deque(tasks)
        self._next_number += len(tasks)

    def hand_out(self, members: Members, limit: int) -> Iterator[tuple[Member, Task]]:
        """Tasks, one each in turn, as far as they and the limit of tasks in flight go."""
        for depth in range(limit):
            for member in members:
                if self._waiting and len(member.in_flight) == depth:
                    task = self._waiting.popleft()
                    member.in_flight[task.number] = task
                    yield member, task

    def take(self, member: Member, result: TaskResult) -> int | None:
        """Keep what came of a task. Returns the units of work that it was; None if the same has come before."""
        task = member.in_flight.get(result.number)
        if task is None:
            self._check_repeated(result)
            return None
        if isinstance(task, PhotonTask) and isinstance(result, PhotonsTraced):
            paths = task.stop - task.start
            if result.paths != paths:
                raise ProtocolError(f"photon task {task.number} has {paths} paths; it says {result.paths}")
            self._photons[task.number] = result
            amount = result.paths
        elif isinstance(task, BucketTask) and isinstance(result, BucketRendered) and self.film is not None:
            self.film.put(task, result)
            amount = 1
        elif isinstance(task, RecordTask) and isinstance(result, RecordsMade) and self.rounds is not None:
            self.rounds.put(task, result)
            amount = task.stop - task.start
        else:
            raise ProtocolError(f"{type(result).__name__} came for {task}")
        del member.in_flight[task.number]
        self._done[task.number] = task
        return amount

    def _check_repeated(self, result: TaskResult) -> None:
        """A result of a task that is not in flight: harmless if it says the same again."""
        task = self._done.get(result.number)
        if isinstance(task, BucketTask) and isinstance(result, BucketRendered) and self.film is not None:
            same = self.film.holds(task, result)
        elif isinstance(task, PhotonTask) and isinstance(result, PhotonsTraced):
            same = self._photons[task.number] == result
        elif isinstance(task, RecordTask) and isinstance(result, RecordsMade) and self.rounds is not None:
            same = self.rounds.holds(task, result)
        else:
            raise ProtocolError(f"a result came for task {result.number}, which it was not handed")
        if not same:
            raise ProtocolError(f"two results of task {result.number} differ")
