"""The master as a state machine: events in, instructions out. It touches no socket and no clock.

A session passes through phases, and a phase ends when every slave has said so. That is what keeps slaves from talking
to a peer that is not as far: a batch of a bucket cannot reach a slave that has not seen its view.

    joining -> idle -> setup -> photons -> exchange -> view -> buckets -> statistics -> idle
                  \\-> (forget -> photons) or view, if the cluster has the world already

Views with an irradiance cache pass through (records -> sharing) once a round, between view and buckets: the records of
a round are made without knowledge of each other, and all slaves have them before the next begins.

In this version a slave that is lost ends the cluster.
"""

from __future__ import annotations

import uuid
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

from wdpm.cluster import protocol
from wdpm.cluster.cluster_settings import ClusterSettings
from wdpm.cluster.film import Film, spiral
from wdpm.cluster.master_events import (
    Abort,
    Advanced,
    Begin,
    Broken,
    Close,
    Event,
    Finished,
    Instruction,
    MakePartition,
    Noted,
    PartitionMade,
    ProcessEnded,
    Send,
    SlaveLost,
    SlaveSaid,
    Started,
    Tick,
    Unreadable,
)
from wdpm.cluster.record_clamp import clamped
from wdpm.cluster.records import NO_RECORDS, candidates, check_records, equal, joined
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
from wdpm.cluster.world import PhotonPlan
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.geometry import Triangles


class Phase(Enum):
    """What the master waits for."""

    JOINING = "joining"
    IDLE = "idle"
    SETUP = "setup"
    FORGET = "forget"
    PHOTONS = "photons"
    EXCHANGE = "exchange"
    VIEW = "view"
    RECORDS = "records"
    SHARING = "sharing"
    BUCKETS = "buckets"
    STATISTICS = "statistics"
    ENDED = "ended"


@dataclass(eq=False)
class Member:
    """A slave as the master knows it."""

    number: int
    identity: bytes
    hello: protocol.Hello
    heard_at: float
    in_flight: dict[int, Task] = field(default_factory=dict)
    statistics: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"slave {self.number} ({self.hello.host}, process {self.hello.process})"


class Master:
    """The state of a cluster.

    Args:
        slaves: how many it waits for.
        versions: what the image's bits depend on, by name; slaves must have the same.
    """

    def __init__(self, slaves: int, versions: Mapping[str, str], settings: ClusterSettings | None = None) -> None:
        self._expected = slaves
        self._versions = dict(versions)
        self._settings = settings or ClusterSettings()
        self._cluster = uuid.uuid4().hex
        self._phase = Phase.JOINING
        self._members: dict[bytes, Member] = {}
        self._waiting: set[int] = set()
        self._ticked_at: float | None = None
        self._beat_at = 0.0
        self._phase_at = 0.0
        self._peer_gone: tuple[float, str] | None = None
        self._seconds: dict[str, float] = {}
        self._dropped: Counter[str] = Counter()
        self._session: Session | None = None
        self._epoch = 0
        self._digest: str | None = None
        self._plan: PhotonPlan | None = None
        self._cells: deque[int] = deque()
        self._cells_in_flight: set[int] = set()
        self._tasks: deque[Task] = deque()
        self._next_number = 0
        self._done: dict[int, Task] = {}
        self._photons: dict[int, PhotonsTraced] = {}
        self._film: Film | None = None
        self._round = 0
        self._made: list[RecordsMade] = []
        self._records = NO_RECORDS

    @property
    def phase(self) -> Phase:
        """What the master waits for."""
        return self._phase

    @property
    def dropped(self) -> dict[str, int]:
        """Messages that were not used, by reason."""
        return dict(self._dropped)

    @property
    def members(self) -> list[protocol.Hello]:
        """The slaves that have joined, by number."""
        return [member.hello for member in self._ordered()]

    def handle(self, event: Event, now: float) -> list[Instruction]:
        """What to do about an event.

        Args:
            now: any clock that grows [s].
        """
        if self._phase is Phase.ENDED:
            return self._after_end(event)
        match event:
            case SlaveSaid(identity, message):
                return self._slave_said(identity, message, now)
            case Tick():
                return self._tick(now)
            case PartitionMade(cell, triangles):
                return self._partition_made(cell, triangles)
            case Begin(session):
                return self._begin(session, now)
            case SlaveLost(identity, reason):
                member = self._members.get(identity)
                return [] if member is None else self._break(f"{member} is lost: {reason}")
            case ProcessEnded(process, reason):
                return self._process_ended(process, reason)
            case Unreadable(identity, reason):
                return self._unreadable(identity, reason)
            case Close(reason):
                return self._stop_all(reason)
            case Abort(reason):
                return self._break(reason)
        raise AssertionError(f"unknown event {event}")

    # Joining, living and leaving.

    def _after_end(self, event: Event) -> list[Instruction]:
        if isinstance(event, Begin):
            return [Broken("the cluster has ended; start another")]
        if isinstance(event, SlaveSaid) and isinstance(event.message, protocol.Hello):
            return [Send(event.identity, protocol.Refuse("the cluster has ended"))]
        return []

    def _stop_all(self, reason: str) -> list[Instruction]:
        self._phase = Phase.ENDED
        self._session = self._film = None
        return [Send(member.identity, protocol.Stop(reason)) for member in self._ordered()]

    def _break(self, reason: str) -> list[Instruction]:
        return [*self._stop_all(reason), Broken(reason)]

    def _tick(self, now: float) -> list[Instruction]:
        slept, self._ticked_at = now - (now if self._ticked_at is None else self._ticked_at), now
        for member in self._ordered():
            if slept > self._settings.liveness_s / 2:
                member.heard_at = now  # this process itself stood still (a laptop's lid): silence says nothing
            silence = now - member.heard_at
            if silence > self._settings.liveness_s:
                return self._break(f"{member} has been silent for {silence:.0f} s; it may have died")
        if self._peer_gone is not None and now >= self._peer_gone[0]:
            return self._break(self._peer_gone[1])
        if now < self._beat_at:
            return []
        self._beat_at = now + self._settings.heartbeat_s
        return self._to_all(protocol.Heartbeat())

    def _process_ended(self, process: int, reason: str) -> list[Instruction]:
        for member in self._ordered():
            if member.hello.process == process:
                return self._break(f"{member} is lost: {reason}")
        return self._break(f"a slave (process {process}) ended before it joined: {reason}")

    def _join(self, identity: bytes, hello: protocol.Hello, now: float) -> list[Instruction]:
        member = self._members.get(identity)
        if member is None:
            reason = self._reason_to_refuse(hello)
            if reason is not None:
                self._dropped["refused slaves"] += 1
                return [
                    Send(identity, protocol.Refuse(reason)),
                    Noted(f"refused {hello.host}, process {hello.process}: {reason}"),
                ]
            member = self._members[identity] = Member(len(self._members), identity, hello, now)
        elif self._phase is not Phase.JOINING:
            return self._break(f"{member} lost its connection and came back, which this version does not survive")
        welcome = protocol.Welcome(member.number, self._cluster, self._settings.heartbeat_s, self._settings.liveness_s)
        out: list[Instruction] = [
            Send(identity, welcome),
            Noted(f"{member} joined, {hello.threads} threads ({len(self._members)} of {self._expected})"),
        ]
        if self._phase is Phase.JOINING and len(self._members) == self._expected:
            self._phase = Phase.IDLE
            if self._session is not None:
                out += self._start_session(self._session, now)
        return out

    def _reason_to_refuse(self, hello: protocol.Hello) -> str | None:
        differing = sorted(
            name
            for name in self._versions.keys() | hello.versions.keys()
            if self._versions.get(name) != hello.versions.get(name)
        )
        if differing:
            listed = "; ".join(
                f"{name}: master {self._versions.get(name, 'none')}, slave {hello.versions.get(name, 'none')}"
                for name in differing
            )
            return f"versions differ ({listed}), so the image's bits could; install the same on both machines"
        if len(self._members) >= self._expected:
            return f"all {self._expected} slaves that this master waits for have joined"
        return None

    # Messages.

    def _slave_said(self, identity: bytes, message: protocol.FromSlave, now: float) -> list[Instruction]:
        if isinstance(message, protocol.Hello):
            return self._join(identity, message, now)
        member = self._members.get(identity)
        if member is None:
            self._dropped["message before Hello"] += 1
            return [Send(identity, protocol.Rejected(f"{type(message).__name__} before Hello"))]
        member.heard_at = now
        match message:
            case protocol.Heartbeat():
                return []
            case protocol.PeerGone(number):
                text = f"the connection from slave {member.number} to slave {number} broke"
                self._peer_gone = self._peer_gone or (now + self._settings.peer_gone_s, text)
                return []
            case protocol.Note(text):
                return [Noted(f"slave {member.number} {text}")]
            case protocol.Failed(text):
                return self._break(f"{member} failed: {text}")
            case protocol.Goodbye(reason):
                return self._break(f"{member} left: {reason}")
            case protocol.Rejected(reason):
                return self._break(f"{member} could not read a message of the master: {reason}")
        if message.epoch != self._epoch:
            self._dropped[f"{type(message).__name__} of another epoch"] += 1
            return []
        try:
            return self._progressed(member, message, now)
        except ProtocolError as error:
            return self._break(f"{member} broke the protocol: {error}")

    def _progressed(
        self,
        member: Member,
        message: protocol.PartitionReceived
        | protocol.Ready
        | protocol.TaskDone
        | protocol.MapsBuilt
        | protocol.ViewSet
        | protocol.RecordsTaken
        | protocol.PhotonsForgotten
        | protocol.Statistics,
        now: float,
    ) -> list[Instruction]:
        session = self._session
        if session is None:
            raise ProtocolError(f"{type(message).__name__} came while nothing is rendered")
        match message:
            case protocol.PartitionReceived(_, cell):
                return self._cell_received(member, cell)
            case protocol.TaskDone(_, result):
                return self._task_done(member, result, now)
            case protocol.Ready():
                out: list[Instruction] = [Advanced(1)]
                return out + (self._start_photons(session, now) if self._all(Phase.SETUP, member, message) else [])
            case protocol.PhotonsForgotten():
                return self._start_photons(session, now) if self._all(Phase.FORGET, member, message) else []
            case protocol.MapsBuilt():
                out = [Advanced(1)]
                return out + (self._start_view(session, now) if self._all(Phase.EXCHANGE, member, message) else [])
            case protocol.ViewSet():
                return self._start_records(session, now) if self._all(Phase.VIEW, member, message) else []
            case protocol.RecordsTaken():
                return self._next_round(session, now) if self._all(Phase.SHARING, member, message) else []
            case protocol.Statistics(_, values):
                member.statistics = values
                return self._finish() if self._all(Phase.STATISTICS, member, message) else []

    def _all(self, phase: Phase, member: Member, message: protocol.FromSlave) -> bool:
        """Note that a slave has done what a phase waits for; tell whether all have."""
        if self._phase is not phase or member.number not in self._waiting:
            raise ProtocolError(f"{type(message).__name__} is not expected from it in phase {self._phase.value}")
        self._waiting.remove(member.number)
        return not self._waiting

    def _unreadable(self, identity: bytes, reason: str) -> list[Instruction]:
        member = self._members.get(identity)
        if member is not None:
            return self._break(f"{member} broke the protocol: {reason}")
        self._dropped["unreadable message"] += 1
        return [Send(identity, protocol.Rejected(reason))]

    # Phases.

    def _begin(self, session: Session, now: float) -> list[Instruction]:
        if self._phase not in (Phase.JOINING, Phase.IDLE) or self._session is not None:
            raise AssertionError(f"a session began in phase {self._phase.value}")
        cells = session.world.top_tree.cells
        if len(session.holders) != cells or not all(0 <= holder < self._expected for holder in session.holders):
            raise AssertionError(f"holders {session.holders} for {cells} cells on {self._expected} slaves")
        self._session = session
        return self._start_session(session, now) if self._phase is Phase.IDLE else []

    def _start_session(self, session: Session, now: float) -> list[Instruction]:
        self._seconds = {}
        self._phase_at = now
        if session.digest != self._digest:
            return self._start_setup(session)
        plan = session.world.photon_plan
        if session.retrace or plan != self._plan:
            self._wait_for_all(Phase.FORGET)
            return self._to_all(protocol.ForgetPhotons(self._epoch, plan))
        return self._start_view(session, now)

    def _start_setup(self, session: Session) -> list[Instruction]:
        self._wait_for_all(Phase.SETUP)
        self._epoch += 1
        self._digest = None
        self._cells = deque(range(len(session.holders)))
        peers = tuple(member.hello.peers for member in self._ordered())
        out: list[Instruction] = [Started("partition", self._expected)]
        out += self._to_all(protocol.Setup(self._epoch, session.world, session.holders, peers))
        for _ in range(self._settings.cells_in_flight):
            out += self._next_cell()
        return out

    def _next_cell(self) -> list[Instruction]:
        if not self._cells:
            return []
        cell = self._cells.popleft()
        self._cells_in_flight.add(cell)
        return [MakePartition(cell)]

    def _partition_made(self, cell: int, triangles: Triangles) -> list[Instruction]:
        session = self._session
        if session is None or self._phase is not Phase.SETUP or cell not in self._cells_in_flight:
            raise AssertionError(f"the partition of cell {cell} was not asked for")
        holder = self._ordered()[session.holders[cell]]
        size = self._settings.part_triangles
        parts = max(1, -(-len(triangles) // size))
        messages = [
            protocol.Partition(self._epoch, cell, part, parts, rows(triangles, part * size, size))
            for part in range(parts)
        ]
        return [Send(holder.identity, message) for message in messages]

    def _cell_received(self, member: Member, cell: int) -> list[Instruction]:
        session = self._session
        expected = session is not None and cell in self._cells_in_flight and session.holders[cell] == member.number
        if not expected:
            raise ProtocolError(f"it says that it got cell {cell}, which was not sent to it")
        self._cells_in_flight.remove(cell)
        return self._next_cell()

    def _start_photons(self, session: Session, now: float) -> list[Instruction]:
        if self._phase is Phase.SETUP:
            self._end_phase("partition", now)
        # Nothing here needs the triangles again, and they may be most of this process's memory.
        self._session = session = replace(session, partition=_partition_is_gone)
        self._phase = Phase.PHOTONS
        self._photons = {}
        size, paths = self._settings.photon_task_paths, session.world.paths
        self._queue([(start, min(start + size, paths)) for start in range(0, paths, size)])
        out: list[Instruction] = [Started("photons", paths)]
        return out + (self._hand_out() if self._tasks else self._start_exchange(now))

    def _queue(self, ranges: list[tuple[int, int]]) -> None:
        self._done = {}
        self._tasks = deque(
            PhotonTask(self._next_number + index, start, stop) for index, (start, stop) in enumerate(ranges)
        )
        self._next_number += len(ranges)

    def _start_exchange(self, now: float) -> list[Instruction]:
        self._end_phase("photons", now)
        self._wait_for_all(Phase.EXCHANGE)
        return [Started("map", self._expected), *self._to_all(protocol.Exchange(self._epoch))]

    def _start_view(self, session: Session, now: float) -> list[Instruction]:
        if self._phase is Phase.EXCHANGE:
            self._end_phase("map", now)
            self._digest, self._plan = session.digest, session.world.photon_plan
        self._wait_for_all(Phase.VIEW)
        return self._to_all(protocol.Look(self._epoch, session.view))

    def _start_records(self, session: Session, now: float) -> list[Instruction]:
        """The first round of irradiance records, or those that are there already."""
        self._phase_at = now
        self._round, self._made, self._records = 0, [], session.records
        if len(self._records):
            self._round = session.view.cache.rounds
            return self._share_records()
        if not session.view.cache.rounds:
            return self._start_buckets(session)
        camera, cache = session.view.camera, session.view.cache
        total = sum(len(candidates(camera.width, camera.height, cache, n)) for n in range(cache.rounds))
        return [Started("records", total), *self._start_round(session)]

    def _start_round(self, session: Session) -> list[Instruction]:
        self._phase = Phase.RECORDS
        camera, size = session.view.camera, self._settings.record_task_candidates
        count = len(candidates(camera.width, camera.height, session.view.cache, self._round))
        starts = range(0, count, size)
        self._done = {}
        self._tasks = deque(
            RecordTask(self._next_number + index, self._round, start, min(start + size, count))
            for index, start in enumerate(starts)
        )
        self._next_number += len(starts)
        return self._hand_out() if self._tasks else self._end_round()

    def _end_round(self) -> list[Instruction]:
        self._round += 1
        self._records = joined([made.records for made in self._made])
        return self._share_records()

    def _share_records(self) -> list[Instruction]:
        """Send all records to all slaves: a few megabytes at most, and each keeps those that reach its cells."""
        self._wait_for_all(Phase.SHARING)
        shared = replace(self._records, radius=clamped(self._records.position, self._records.radius))
        return self._to_all(protocol.ShareRecords(self._epoch, shared))

    def _next_round(self, session: Session, now: float) -> list[Instruction]:
        if self._round < session.view.cache.rounds:
            return self._start_round(session)
        self._end_phase("records", now)
        return self._start_buckets(session)

    def _start_buckets(self, session: Session) -> list[Instruction]:
        view = session.view
        self._phase = Phase.BUCKETS
        self._film = Film(view.camera.width, view.camera.height, session.layers)
        buckets = spiral(view.camera.width, view.camera.height, view.bucket, self._next_number)
        self._next_number += len(buckets)
        self._done = {}
        self._tasks = deque(buckets)
        return [Started("render", len(buckets)), *self._hand_out()]

    def _start_statistics(self, now: float) -> list[Instruction]:
        self._end_phase("render", now)
        self._wait_for_all(Phase.STATISTICS)
        return self._to_all(protocol.AskStatistics(self._epoch))

    def _finish(self) -> list[Instruction]:
        film = self._film
        if film is None:
            raise AssertionError("a session ended without a film")
        result = SessionResult(
            film.layers,
            [member.statistics for member in self._ordered()],
            tuple(self._photons[number] for number in sorted(self._photons)),
            self._seconds,
            self.dropped,
            self._records,
            sum(made.rays for made in self._made),
        )
        self._phase = Phase.IDLE
        self._session = self._film = None
        self._made, self._records = [], NO_RECORDS
        return [Finished(result)]

    # Tasks.

    def _hand_out(self) -> list[Instruction]:
        """Hand out tasks, one each in turn, as far as the slaves' limits allow."""
        buckets = self._phase is Phase.BUCKETS
        limit = self._settings.buckets_in_flight if buckets else self._settings.photon_tasks_in_flight
        out: list[Instruction] = []
        for depth in range(limit):
            for member in self._ordered():
                if self._tasks and len(member.in_flight) == depth:
                    task = self._tasks.popleft()
                    member.in_flight[task.number] = task
                    out.append(Send(member.identity, protocol.DoTask(self._epoch, task)))
        return out

    def _task_done(self, member: Member, result: TaskResult, now: float) -> list[Instruction]:
        task = member.in_flight.get(result.number)
        if task is None:
            return self._repeated(result)
        if isinstance(task, PhotonTask) and isinstance(result, PhotonsTraced):
            paths = task.stop - task.start
            if result.paths != paths:
                raise ProtocolError(f"photon task {task.number} has {paths} paths; it says {result.paths}")
            self._photons[task.number] = result
            amount = result.paths
        elif isinstance(task, BucketTask) and isinstance(result, BucketRendered) and self._film is not None:
            self._film.put(task, result)
            amount = 1
        elif isinstance(task, RecordTask) and isinstance(result, RecordsMade):
            check_records(result.records, task.round, task.start, task.stop)
            self._made.append(result)
            amount = task.stop - task.start
        else:
            raise ProtocolError(f"{type(result).__name__} came for {task}")
        del member.in_flight[task.number]
        self._done[task.number] = task
        out: list[Instruction] = [Advanced(amount), *self._hand_out()]
        if self._tasks or any(other.in_flight for other in self._members.values()):
            return out
        return out + self._all_tasks_done(now)

    def _all_tasks_done(self, now: float) -> list[Instruction]:
        if self._phase is Phase.PHOTONS:
            return self._start_exchange(now)
        return self._end_round() if self._phase is Phase.RECORDS else self._start_statistics(now)

    def _repeated(self, result: TaskResult) -> list[Instruction]:
        """A result of a task that is not in flight: harmless if it says the same again."""
        task = self._done.get(result.number)
        if isinstance(task, BucketTask) and isinstance(result, BucketRendered) and self._film is not None:
            same = self._film.holds(task, result)
        elif isinstance(task, PhotonTask) and isinstance(result, PhotonsTraced):
            same = self._photons[task.number] == result
        elif isinstance(task, RecordTask) and isinstance(result, RecordsMade):
            same = any(made.number == task.number and equal(made.records, result.records) for made in self._made)
        else:
            raise ProtocolError(f"a result came for task {result.number}, which it was not handed")
        if not same:
            raise ProtocolError(f"two results of task {result.number} differ")
        self._dropped["repeated result"] += 1
        return []

    # Helpers.

    def _ordered(self) -> list[Member]:
        return sorted(self._members.values(), key=lambda member: member.number)

    def _to_all(self, message: protocol.FromMaster) -> list[Instruction]:
        return [Send(member.identity, message) for member in self._ordered()]

    def _wait_for_all(self, phase: Phase) -> None:
        self._phase = phase
        self._waiting = set(range(self._expected))

    def _end_phase(self, name: str, now: float) -> None:
        self._seconds[name] = now - self._phase_at
        self._phase_at = now


def rows(triangles: Triangles, start: int, count: int) -> Triangles:
    """A run of triangles, without a copy."""
    part = slice(start, start + count)
    return Triangles(
        triangles.ids[part],
        triangles.positions[part],
        triangles.normals[part],
        triangles.uvs[part],
        triangles.material[part],
        triangles.emitter[part],
        triangles.colors[part] if len(triangles.colors) else triangles.colors,
    )


def _partition_is_gone(cell: int) -> Triangles:
    raise AssertionError(f"cell {cell} was asked for after all cells were sent")
