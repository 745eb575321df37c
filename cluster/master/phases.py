"""The phases that a master leads its slaves through, session after session.

A phase ends when every slave has said so. That is what keeps slaves from talking to a peer that is not as far: a batch
of a bucket cannot reach a slave that has not seen its view.

    joining -> idle -> setup -> photons -> maps -> view -> buckets -> statistics -> idle
                  \\-> (forget -> photons) or view, if the cluster has the world already

Views with an irradiance cache pass through (records -> sharing) once a round, between view and buckets: the records of
a round are made without knowledge of each other, and all slaves have them before the next begins.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from enum import Enum

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.cells import CellQueue, partition_is_gone, parts_of
from wdpm.cluster.master.events import Advanced, Finished, Instruction, MakePartition, Send, Started
from wdpm.cluster.master.members import Member, Members
from wdpm.cluster.master.observing import bucket_done, frame_begun
from wdpm.cluster.master.records import RecordRounds
from wdpm.cluster.master.statistics import check_statistics
from wdpm.cluster.master.tasks import Tasks
from wdpm.cluster.messages import protocol
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.task import TaskResult
from wdpm.cluster.world import PhotonPlan
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.arrays import Triangles

TASKS_A_PROCESS = 8
"""Photon tasks for each of several processes: so many that they end together, ..."""

PHOTON_TASK_LEAST = 4096
"""... and paths of each, so that what a launch costs the interpreter does not count."""


class Phase(Enum):
    """What the master waits for."""

    JOINING = "joining"
    IDLE = "idle"
    SETUP = "setup"
    FORGET = "forget"
    PHOTONS = "photons"
    MAPS = "maps"
    VIEW = "view"
    RECORDS = "records"
    SHARING = "sharing"
    BUCKETS = "buckets"
    STATISTICS = "statistics"
    ENDED = "ended"


class Phases:
    """What a cluster does for one session after another.

    Args:
        dropped: counts messages that are not used, by reason.

    Attributes:
        phase: what is waited for.
        epoch: number of the setup that messages must be of.
        session: what is rendered, or waits for slaves to join.
    """

    def __init__(self, members: Members, limits: ClusterLimits, dropped: Counter[str]) -> None:
        self.phase = Phase.JOINING
        self.epoch = 0
        self.session: Session | None = None
        self._members = members
        self._limits = limits
        self._dropped = dropped
        self._waiting: set[int] = set()
        self._phase_at = 0.0
        self._seconds: dict[str, float] = {}
        self._digest: str | None = None
        self._plan: PhotonPlan | None = None
        self._cells = CellQueue()
        self._tasks = Tasks()

    def begin(self, session: Session, now: float) -> list[Instruction]:
        """Render a session, as soon as all slaves have joined."""
        if self.phase not in (Phase.JOINING, Phase.IDLE) or self.session is not None:
            raise AssertionError(f"a session began in phase {self.phase.value}")
        cells, slaves = session.world.top_tree.cells, self._members.expected
        if len(session.holders) != cells or not all(0 <= holder < slaves for holder in session.holders):
            raise AssertionError(f"holders {session.holders} for {cells} cells on {slaves} slaves")
        self.session = session
        return self._start_session(session, now) if self.phase is Phase.IDLE else []

    def all_joined(self, now: float) -> list[Instruction]:
        """All slaves have joined."""
        self.phase = Phase.IDLE
        return [] if self.session is None else self._start_session(self.session, now)

    def end(self) -> None:
        """Wait for nothing any more."""
        self.phase = Phase.ENDED
        self.session = self._tasks.film = None

    def partition_made(self, cell: int, triangles: Triangles) -> list[Instruction]:
        """Send a cell that was asked for to its holder."""
        session = self.session
        if session is None or self.phase is not Phase.SETUP or not self._cells.on_its_way(cell):
            raise AssertionError(f"the partition of cell {cell} was not asked for")
        holder = self._members.number(session.holders[cell])
        parts = parts_of(self.epoch, cell, triangles, self._limits.part_triangles)
        return [Send(holder.identity, part) for part in parts]

    def progressed(
        self,
        member: Member,
        message: protocol.PartitionReceived
        | protocol.Ready
        | protocol.TaskDone
        | protocol.MapsBuilt
        | protocol.ViewSet
        | protocol.RecordsSet
        | protocol.PhotonsForgotten
        | protocol.Statistics,
        now: float,
    ) -> list[Instruction]:
        """A slave says how far it is, or what came of a task; ProtocolError where that cannot be."""
        session = self.session
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
                return out + (self._start_view(session, now) if self._all(Phase.MAPS, member, message) else [])
            case protocol.ViewSet():
                return self._start_records(session, now) if self._all(Phase.VIEW, member, message) else []
            case protocol.RecordsSet():
                return self._next_round(session, now) if self._all(Phase.SHARING, member, message) else []
            case protocol.Statistics(_, values):
                all_have = self._all(Phase.STATISTICS, member, message)
                check_statistics(values, session.world)
                member.statistics = values
                return self._finish() if all_have else []

    def _all(self, phase: Phase, member: Member, message: protocol.FromSlave) -> bool:
        """Note that a slave has done what a phase waits for; tell whether all have."""
        if self.phase is not phase or member.number not in self._waiting:
            raise ProtocolError(f"{type(message).__name__} is not expected from it in phase {self.phase.value}")
        self._waiting.remove(member.number)
        return not self._waiting

    # From one to the next.

    def _start_session(self, session: Session, now: float) -> list[Instruction]:
        self._seconds = {}
        self._phase_at = now
        if session.digest != self._digest:
            return self._start_setup(session)
        plan = session.world.photon_plan
        if session.retrace or plan != self._plan:
            self._wait_for_all(Phase.FORGET)
            return self._to_all(protocol.ForgetPhotons(self.epoch, plan))
        return self._start_view(session, now)

    def _start_setup(self, session: Session) -> list[Instruction]:
        self._wait_for_all(Phase.SETUP)
        self.epoch += 1
        self._digest = None
        self._cells.begin(len(session.holders))
        peers = tuple(member.hello.peers for member in self._members)
        out: list[Instruction] = [Started("partition", self._members.expected)]
        out += self._to_all(protocol.Setup(self.epoch, session.world, session.holders, peers))
        for _ in range(self._limits.cells_in_flight):
            out += self._next_cell()
        return out

    def _next_cell(self) -> list[Instruction]:
        cell = self._cells.next()
        return [] if cell is None else [MakePartition(cell)]

    def _cell_received(self, member: Member, cell: int) -> list[Instruction]:
        session = self.session
        expected = session is not None and self._cells.on_its_way(cell) and session.holders[cell] == member.number
        if not expected:
            raise ProtocolError(f"it says that it got cell {cell}, which was not sent to it")
        self._cells.arrived(cell)
        return self._next_cell()

    def _start_photons(self, session: Session, now: float) -> list[Instruction]:
        if self.phase is Phase.SETUP:
            self._end_phase("partition", now)
        # Nothing here needs the triangles again, and they may be most of this process's memory.
        self.session = session = replace(session, partition=partition_is_gone)
        self.phase = Phase.PHOTONS
        paths = session.world.paths
        size = self._limits.photon_task_paths
        if self._at_once > 1:
            size = min(size, max(-(-paths // (TASKS_A_PROCESS * self._at_once)), PHOTON_TASK_LEAST))
        self._tasks.trace(paths, size)
        out: list[Instruction] = [Started("photons", paths)]
        return out + (self._hand_out() if self._tasks.waiting else self._start_maps(now))

    def _start_maps(self, now: float) -> list[Instruction]:
        self._end_phase("photons", now)
        self._wait_for_all(Phase.MAPS)
        return [Started("map", self._members.expected), *self._to_all(protocol.BuildMaps(self.epoch))]

    def _start_view(self, session: Session, now: float) -> list[Instruction]:
        if self.phase is Phase.MAPS:
            self._end_phase("map", now)
            self._digest, self._plan = session.digest, session.world.photon_plan
        self._wait_for_all(Phase.VIEW)
        return self._to_all(protocol.SetView(self.epoch, session.view))

    def _start_records(self, session: Session, now: float) -> list[Instruction]:
        """The first round of irradiance records, or those that are there already."""
        self._phase_at = now
        rounds = self._tasks.rounds = RecordRounds(session.view, session.records)
        if len(rounds.records):
            return self._set_records(rounds)
        if rounds.finished:
            return self._start_buckets(session)
        return [Started("records", rounds.total), *self._start_round(rounds)]

    def _start_round(self, rounds: RecordRounds) -> list[Instruction]:
        self.phase = Phase.RECORDS
        self._tasks.make_records(rounds, max(len(self._members), self._at_once), self._limits)
        return self._hand_out() if self._tasks.waiting else self._end_round(rounds)

    def _end_round(self, rounds: RecordRounds) -> list[Instruction]:
        rounds.end_round()
        return self._set_records(rounds)

    def _set_records(self, rounds: RecordRounds) -> list[Instruction]:
        """Send all records to all slaves: a few megabytes at most, and each keeps those that reach its cells."""
        self._wait_for_all(Phase.SHARING)
        return self._to_all(protocol.SetRecords(self.epoch, rounds.shared()))

    def _next_round(self, session: Session, now: float) -> list[Instruction]:
        rounds = self._tasks.rounds
        if rounds is not None and not rounds.finished:
            return self._start_round(rounds)
        self._end_phase("records", now)
        return self._start_buckets(session)

    def _start_buckets(self, session: Session) -> list[Instruction]:
        self.phase = Phase.BUCKETS
        buckets = self._tasks.render(session.view, session.layers)
        return [Started("render", buckets), frame_begun(session, self._members), *self._hand_out()]

    def _start_statistics(self, now: float) -> list[Instruction]:
        self._end_phase("render", now)
        self._wait_for_all(Phase.STATISTICS)
        return self._to_all(protocol.ReadStatistics(self.epoch))

    def _finish(self) -> list[Instruction]:
        film, rounds = self._tasks.film, self._tasks.rounds
        if film is None or rounds is None:
            raise AssertionError("a session ended without a film")
        result = SessionResult(
            film.layers,
            [member.statistics for member in self._members],
            self._tasks.photons,
            self._seconds,
            dict(self._dropped),
            rounds.records,
            rounds.rays,
        )
        self.phase = Phase.IDLE
        self.session = self._tasks.film = self._tasks.rounds = None
        return [Finished(result)]

    # Tasks.

    def _hand_out(self) -> list[Instruction]:
        """Hand out tasks, as far as the slaves' limits allow."""
        buckets = self.phase is Phase.BUCKETS
        limit = self._limits.buckets_in_flight if buckets else self._limits.photon_tasks_in_flight
        handed_out = self._tasks.hand_out(self._members, limit * self._processes)
        return [Send(member.identity, protocol.StartTask(self.epoch, task)) for member, task in handed_out]

    def _task_done(self, member: Member, result: TaskResult, now: float) -> list[Instruction]:
        amount = self._tasks.take(member, result)
        if amount is None:
            self._dropped["repeated result"] += 1
            return []
        out: list[Instruction] = [Advanced(amount), *bucket_done(member, result), *self._hand_out()]
        if self._tasks.waiting or any(other.in_flight for other in self._members):
            return out
        return out + self._all_tasks_done(now)

    def _all_tasks_done(self, now: float) -> list[Instruction]:
        if self.phase is Phase.PHOTONS:
            return self._start_maps(now)
        rounds = self._tasks.rounds
        if self.phase is Phase.RECORDS and rounds is not None:
            return self._end_round(rounds)
        return self._start_statistics(now)

    @property
    def _processes(self) -> int:
        """Most tasks that a slave does at once: only where tasks need no other slave."""
        if self.session is None or len(self.session.holders) > 1:
            return 1
        return max(member.hello.processes for member in self._members)

    @property
    def _at_once(self) -> int:
        """Tasks that are done at once by processes of slaves."""
        return self._processes * len(self._members) if self._processes > 1 else 1

    # Helpers.

    def _to_all(self, message: protocol.FromMaster) -> list[Instruction]:
        return [Send(member.identity, message) for member in self._members]

    def _wait_for_all(self, phase: Phase) -> None:
        self.phase = phase
        self._waiting = set(range(self._members.expected))

    def _end_phase(self, name: str, now: float) -> None:
        self._seconds[name] = now - self._phase_at
        self._phase_at = now
