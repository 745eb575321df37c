"""What a slave has its worker do: each job is one call. The state machine orders jobs; a shell runs them.

A slave process runs jobs on a thread of their own, so that heartbeats go on during long kernels, and short ones in
line; a cluster in one process runs all in line. Either way there is one job at a time.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Batch
from wdpm.cluster.host_memory import return_free_memory
from wdpm.cluster.messages.protocol import Copy
from wdpm.cluster.outbox import Outbox
from wdpm.cluster.records import NO_RECORDS, Records
from wdpm.cluster.task import PhotonTask, Task, TaskResult
from wdpm.cluster.world import NO_REGIONS, PhotonPlan, View, World
from wdpm.scenes.flat.arrays import Triangles


class Worker(Protocol):
    """The compute object that a slave drives; `work.worker.CellWorker` is the real one, tests bring their own."""

    def set_view(self, view: View) -> None: ...

    def start(self, task: Task) -> Outbox: ...

    def handle(self, batches: Sequence[Batch]) -> Outbox: ...

    def regroup(self, world: World, partition: Mapping[int, Triangles], holders: Sequence[int]) -> None: ...

    def copies(self, cells: Sequence[int], part: int, regions: NDArray[np.float32]) -> Sequence[Batch]: ...

    def exchange_ghosts(self) -> Sequence[Batch]: ...

    def ghosts_expected(self) -> int: ...

    def sort_trees(self, part: int, parts: int, cells: Sequence[int]) -> Sequence[Batch]: ...

    def build_maps(self, part: int, parts: int, cells: Sequence[int]) -> Sequence[Batch]: ...

    def finish_maps(self) -> None: ...

    def photon_counts(self) -> dict[str, Any]: ...
    def statistics(self) -> dict[str, Any]: ...

    def await_records(self) -> None: ...

    def set_records(self, records: Records) -> None: ...

    def go_on(self) -> Outbox: ...

    def begin_points(self) -> None: ...

    def forget_photons(self, plan: PhotonPlan) -> None: ...


WorkerFactory = Callable[[int, World, Mapping[int, Triangles], Sequence[int]], Worker]
"""(number, world, cell -> triangles, cell -> number of its holder) -> worker."""


class TaskProcesses(Protocol):
    """Processes that share a worker, and do its tasks; forked_tasks.ForkedTasks is the real one."""

    def start(self, task: Task) -> None: ...

    def wait(self, seconds: float | None) -> Sequence[TaskResult]: ...

    def set_view(self, view: View) -> None: ...

    def set_records(self, records: Records) -> None: ...

    def let_go(self) -> None: ...

    def stop(self) -> None: ...


Share = Callable[[Worker], TaskProcesses | None]
"""worker -> the processes that do its tasks, if it is to be shared."""


@dataclass(frozen=True)
class Build:
    """Make the worker, or go on with the one that there is; may compile kernels.

    Attributes:
        kept: cells of this world that the worker has from before. It is made anew if there are none.
        scene: its name, as protocol.Setup has it.
    """

    number: int
    world: World
    partition: Mapping[int, Triangles]
    holders: tuple[int, ...]
    kept: tuple[int, ...] = ()
    scene: str = ""


@dataclass(frozen=True)
class SetView:
    view: View


@dataclass(frozen=True)
class StartTask:
    task: Task


@dataclass(frozen=True)
class HandleBatches:
    """Work off some batches, at least one: of what maps are built of one alone."""

    batches: tuple[Batch, ...]


@dataclass(frozen=True)
class SendCopies:
    """Send what landed here to other teams: one batch for each of `copies`, in their order.

    Attributes:
        part, regions: as protocol.BuildMaps has them.
    """

    copies: tuple[Copy, ...]
    part: int = 0
    regions: NDArray[np.float32] = field(default_factory=lambda: NO_REGIONS)


@dataclass(frozen=True)
class ExchangeGhosts:
    """Send ghosts, copies of photons and surface points, to the neighbours' overlap bands; BuildMaps follows."""


@dataclass(frozen=True)
class SortTrees:
    """Sort a part of the trees of photons and points for all who hold the same, where that is worth it.

    Attributes:
        copies: for whom: one batch for each, in their order, or none at all.
        part, parts: which part, from 0, and of how many.
    """

    copies: tuple[Copy, ...]
    part: int
    parts: int


@dataclass(frozen=True)
class BuildMaps:
    """Build the maps, of which all is here, and send the part of the irradiance at photons that is worked out here.

    Attributes:
        copies: to whom: one batch for each, in their order.
        part, parts: which part, from 0, and of how many.
    """

    copies: tuple[Copy, ...] = ()
    part: int = 0
    parts: int = 1


@dataclass(frozen=True)
class FinishMaps:
    """All parts of the irradiance at photons are here."""


@dataclass(frozen=True)
class AwaitRecords:
    """Have what reads irradiance records wait for those that SetRecords brings."""


@dataclass(frozen=True)
class SetRecords:
    """Have these irradiance records, in place of those before."""

    records: Records


@dataclass(frozen=True)
class ForgetPhotons:
    """Let go of all photons; those to come are traced by this plan."""

    plan: PhotonPlan


@dataclass(frozen=True)
class ReadStatistics:
    pass


Job = (
    Build
    | SetView
    | StartTask
    | HandleBatches
    | SendCopies
    | ExchangeGhosts
    | SortTrees
    | BuildMaps
    | FinishMaps
    | AwaitRecords
    | SetRecords
    | ForgetPhotons
    | ReadStatistics
)


@dataclass(frozen=True)
class Outcome:
    """What a job left behind.

    Attributes:
        batches: for other workers, or for this one.
        results: for the master.
        ghosts_expected: after ExchangeGhosts: batches of GHOSTS to handle before the maps can be built.
        statistics: after ReadStatistics; after FinishMaps what was counted of photons.
    """

    job: Job
    batches: Sequence[Batch] = ()
    results: Sequence[TaskResult] = ()
    ghosts_expected: int = 0
    statistics: Mapping[str, Any] | None = None


class Compute:
    """Runs jobs: one at a time here, but tasks in other processes, several at once, where the worker can be shared.

    Photons are traced here even so, by threads: a task of them is one launch, after which they are where maps are built
    of them, and other processes would have to be forked for what takes less time than to fork them.

    Args:
        make_worker: makes the compute object of a world.
        share: gives the processes that do a worker's tasks; None if it does them itself.
        tell_scene: is told the name of each scene before a worker is made of it.
    """

    def __init__(
        self, make_worker: WorkerFactory, share: Share | None = None, tell_scene: Callable[[str], None] | None = None
    ) -> None:
        self._make_worker = make_worker
        self._tell_scene = tell_scene
        self._share = share
        self._worker: Worker | None = None
        self._elsewhere: TaskProcesses | None = None
        self._tasks: dict[int, StartTask] = {}

    def start(self, job: Job) -> Outcome | None:
        """Run a job and return what it left behind; None if it is under way in another process: see `wait`.

        Raises what the worker raises.
        """
        if self._elsewhere is None:
            return self.run(job)
        if isinstance(job, StartTask) and not isinstance(job.task, PhotonTask):
            self._tasks[job.task.number] = job
            self._elsewhere.start(job.task)
            return None
        _tell(self._elsewhere, job)
        if isinstance(job, StartTask) and self._worker is not None:
            self._worker.begin_points()
        return self.run(job)

    @property
    def under_way(self) -> int:
        """Tasks that other processes are at."""
        return len(self._tasks)

    def wait(self, seconds: float | None = None) -> list[Outcome]:
        """What came of tasks that are done, as soon as there is one; raises what they raised.

        Args:
            seconds: to wait at most; None for as long as it takes.
        """
        if self._elsewhere is None or not self._tasks:
            return []
        results = self._elsewhere.wait(seconds)
        return [Outcome(self._tasks.pop(result.number), (), (result,)) for result in results]

    def stop(self) -> None:
        """End other processes; may be called again."""
        self._tasks.clear()
        if self._elsewhere is not None:
            self._elsewhere.stop()

    def run(self, job: Job) -> Outcome:
        """Run a job here, whatever it is."""
        if isinstance(job, Build):
            return self._build(job)
        if self._worker is None:
            raise AssertionError(f"{type(job).__name__} before Build")
        return self._run(self._worker, job)

    def _build(self, job: Build) -> Outcome:
        if job.kept and self._worker is not None:
            self._worker.regroup(job.world, job.partition, job.holders)
        else:
            if self._worker is not None:
                self._worker = None  # frees the world before, so that the two are never in memory together
                gc.collect()  # of what refers to itself in a circle, too
                return_free_memory()
            if self._tell_scene is not None:
                self._tell_scene(job.scene)
            self._worker = self._make_worker(job.number, job.world, job.partition, job.holders)
            self._elsewhere = None if self._share is None else self._share(self._worker)
        # The job is not kept: it would keep triangles that the worker may have let go.
        return Outcome(Build(job.number, job.world, {}, job.holders, job.kept))

    def _run(self, worker: Worker, job: Job) -> Outcome:
        match job:
            case StartTask(task):
                outbox = worker.start(task)
                return Outcome(job, outbox.batches, outbox.results)
            case HandleBatches(batches):
                outbox = worker.handle(batches)
                return Outcome(job, outbox.batches, outbox.results)
            case SetView(view):
                worker.set_view(view)
            case SendCopies(copies, part, regions):
                return Outcome(job, worker.copies([copy.cell for copy in copies], part, regions))
            case ExchangeGhosts():
                return Outcome(job, worker.exchange_ghosts(), ghosts_expected=worker.ghosts_expected())
            case SortTrees(copies, part, parts):
                return Outcome(job, worker.sort_trees(part, parts, [copy.cell for copy in copies]))
            case BuildMaps(copies, part, parts):
                return Outcome(job, worker.build_maps(part, parts, [copy.cell for copy in copies]))
            case FinishMaps():
                worker.finish_maps()
                return Outcome(job, statistics=worker.photon_counts())
            case SetRecords(records):
                worker.set_records(records)
                outbox = worker.go_on()
                # The job is not kept: the worker keeps those that reach its cells.
                return Outcome(SetRecords(NO_RECORDS), outbox.batches, outbox.results)
            case AwaitRecords():
                worker.await_records()
            case ForgetPhotons(plan):
                worker.forget_photons(plan)
            case ReadStatistics():
                return_free_memory()  # a session has ended, and what was on its way is gone
                return Outcome(job, statistics=worker.statistics())
        return Outcome(job)


def _tell(processes: TaskProcesses, job: Job) -> None:
    """Have processes that share a worker change with it, or end where they cannot."""
    match job:
        case SetView(view):
            processes.set_view(view)
        case SetRecords(records):
            processes.set_records(records)
        case ReadStatistics():
            pass  # changes nothing
        case _:
            processes.let_go()
