"""What a simulated session did: jobs, messages, phases, and how busy everything was."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from wdpm.cluster.slave import jobs
from wdpm.cluster.slave.jobs import Job, Outcome
from wdpm.cluster.task import BucketTask, PhotonTask, RecordTask

SETTING_UP = "partition"
"""The phase that a session begins with."""


@dataclass(frozen=True)
class JobRecord:
    """One thing that a slave computed.

    Attributes:
        begun: simulated time [s].
        what: a job's name, and the kind of its task or batch.
        items: rays, photons or results of a batch; paths, candidates or pixels of a task.
        seconds: of a processor.
        batches, size: that followed, for other slaves and for itself, and their bytes.
    """

    begun: float
    slave: int
    what: str
    items: int
    seconds: float
    batches: int
    size: int

    @classmethod
    def of(cls, begun: float, slave: int, job: Job, outcome: Outcome, seconds: float) -> JobRecord:
        """What is worth remembering of a job."""
        what, items = _described(job)
        size = sum(batch.nbytes for batch in outcome.batches)
        return cls(begun, slave, what, items, seconds, len(outcome.batches), size)


def _described(job: Job) -> tuple[str, int]:
    name = type(job).__name__
    match job:
        case jobs.HandleBatches(batches):
            longest = max(batches, key=len)
            return f"{name} {longest.kind.value}", sum(len(batch) for batch in batches)
        case jobs.StartTask(BucketTask() as bucket):
            return f"{name} bucket", (bucket.x1 - bucket.x0) * (bucket.y1 - bucket.y0)
        case jobs.StartTask(PhotonTask() as part):
            return f"{name} photons", part.stop - part.start
        case jobs.StartTask(RecordTask() as part):
            return f"{name} records", part.count
    return name, 1


@dataclass(frozen=True)
class Spent:
    """Seconds that threads and wires were busy, since some moment.

    Attributes:
        computing: of each slave's thread that computes.
        messages: of each slave's other threads: orders, packing and unpacking, ZeroMQ's.
        master: of all threads of the master.
        wires: of the busier direction of each machine's interface.
    """

    computing: tuple[float, ...]
    messages: tuple[float, ...]
    master: float
    wires: tuple[float, ...]

    def __sub__(self, other: Spent) -> Spent:
        return Spent(
            _less(self.computing, other.computing),
            _less(self.messages, other.messages),
            self.master - other.master,
            _less(self.wires, other.wires),
        )

    @property
    def busy_s(self) -> float:
        """Of all processors together."""
        return sum(self.computing) + sum(self.messages) + self.master


def _less(these: Sequence[float], those: Sequence[float]) -> tuple[float, ...]:
    return tuple(now - then for now, then in zip(these, those, strict=True))


@dataclass(frozen=True)
class PhaseRecord:
    """One phase.

    Attributes:
        seconds: of simulated time.
    """

    name: str
    seconds: float
    spent: Spent


@dataclass
class Recorder:
    """Fills while a session is rendered.

    Attributes:
        jobs: in the order in which they began.
        phases: in their order.
        messages, sizes: how many of each name were sent, and their bytes; within a machine, too.
    """

    jobs: list[JobRecord] = field(default_factory=list)
    phases: list[PhaseRecord] = field(default_factory=list)
    messages: Counter[str] = field(default_factory=Counter)
    sizes: Counter[str] = field(default_factory=Counter)
    _running: tuple[str, float, Spent] | None = None

    def phase(self, name: str, now: float, spent: Spent) -> None:
        """Another phase begins, or with no name all are over."""
        if self._running is not None:
            before, since, then = self._running
            self.phases.append(PhaseRecord(before, now - since, spent - then))
        self._running = (name, now, spent) if name else None

    def job(self, record: JobRecord) -> None:
        """A slave has computed."""
        self.jobs.append(record)

    def message(self, name: str, size: int) -> None:
        """A message was sent."""
        self.messages[name] += 1
        self.sizes[name] += size
