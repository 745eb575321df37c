"""A slave as a state machine: events in, instructions out. It touches no socket, no clock and no kernel.

A slave joins, gets its cells, and then does what comes: batches for its homes first, then batches for its cells, then
new tasks. Finishing before starting bounds what is in memory, since a task that has not begun holds nothing. Batches
that go the same way are joined while they wait. They are handled one by one, not all that wait at once: what follows
from one is on its way to the peers while the next is computed (measured: half the time for photons over 4 slaves).

The shell in loop.py brings events and carries out instructions.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence

import numpy as np

from wdpm.cluster.batch import GHOSTS, TO_HOME, Batch
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.messages import checks, protocol
from wdpm.cluster.queues import Queues
from wdpm.cluster.slave import jobs
from wdpm.cluster.slave.events import (
    AnswerPeer,
    Computed,
    ComputeFailed,
    ConnectPeers,
    Event,
    Exit,
    Instruction,
    Leave,
    MasterLost,
    MasterRefused,
    MasterSaid,
    PeerAnswered,
    PeerLost,
    PeerSaid,
    Reconnect,
    Run,
    Start,
    Tell,
    Tick,
    ToMaster,
    ToPeer,
    Unreadable,
)
from wdpm.cluster.slave.jobs import Job, Outcome
from wdpm.cluster.slave.peers import Peers
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.arrays import Triangles

SLOW_BUILD_S = 3.0
"""A build that takes longer than this is worth a word to the person who waits."""


QUEUED = 2
"""Tasks of each process that does some: the one that it is at, and one more, so that it need not wait for orders."""


class Slave:
    """The state of one slave.

    Args:
        hello: how it introduces itself.
        endpoint: of the master, for messages.
        patience: how long it waits for the master's first answer [s].
        limits: of joining; the master's heartbeats hold once it has joined.
    """

    def __init__(
        self, hello: protocol.Hello, endpoint: str, patience: float, limits: ClusterLimits | None = None
    ) -> None:
        self._hello = hello
        self._endpoint = endpoint
        self._patience = patience
        self._limits = limits or ClusterLimits()
        self._welcome: protocol.Welcome | None = None
        self._wait = self._limits.join_first_s
        self._give_up_at = self._retry_at = 0.0
        self._refused = False
        self._heard_at = self._ticked_at = self._beat_at = 0.0
        self._epoch = 0
        self._setup: protocol.Setup | None = None
        self._parts: dict[int, list[Triangles]] = {}
        self._partition: dict[int, Triangles] = {}
        self._missing: set[int] = set()
        self._peers = Peers(self._limits.peer_answer_s)
        self._orders: deque[Job] = deque()
        self._ghosts: deque[Batch] = deque()
        self._batches = Queues()
        self._tasks: deque[jobs.StartTask] = deque()
        self._running: list[tuple[int, Job]] = []  # with the epoch of each
        self._running_since = 0.0
        self._slow_build_told = False
        self._ghosts_handled = 0
        self._ghosts_expected: int | None = None
        self._dropped: Counter[str] = Counter()
        self._ended = False

    @property
    def number(self) -> int:
        """The slave's number, -1 before it has joined."""
        return -1 if self._welcome is None else self._welcome.number

    @property
    def ended(self) -> bool:
        """Whether it has told its shell to exit."""
        return self._ended

    @property
    def dropped(self) -> dict[str, int]:
        """Messages that were not used, by reason."""
        return dict(self._dropped)

    def handle(self, event: Event, now: float) -> list[Instruction]:
        """What to do about an event.

        Args:
            now: any clock that grows [s].
        """
        if self._ended:
            return []
        try:
            out = self._dispatch(event, now)
        except ProtocolError as error:
            return self._fail(str(error))
        if not self._ended:
            out += self._next_jobs(now)
        return out

    def _dispatch(self, event: Event, now: float) -> list[Instruction]:
        match event:
            case MasterSaid(message):
                self._heard_at = now
                return self._master_said(message, now)
            case PeerSaid(identity, message):
                return self._peer_said(identity, message)
            case PeerAnswered(number, message):
                return self._peers.answered(number, message)
            case Computed(outcome):
                return self._computed(outcome)
            case Tick():
                return self._tick(now)
            case Start():
                self._give_up_at = now + self._patience
                self._retry_at = now + self._wait
                self._ticked_at = now
                return [ToMaster(self._hello)]
            case Unreadable(None, reason):
                return self._fail(f"cannot read a message of the master: {reason}")
            case Unreadable(bytes(identity), reason):
                return self._unreadable_peer(identity, reason)
            case ComputeFailed(text):
                return self._fail(text)
            case PeerLost(number):
                # Not this slave's to judge: the peer may have died, or have been told to stop a moment earlier.
                self._peers.lost(number)
                return [ToMaster(protocol.PeerGone(number))]
            case MasterLost():
                if self._welcome is None:
                    return []  # it does not listen yet
                return self._exit(f"lost the connection to the master at {self._endpoint}", elsewhere=True)
            case MasterRefused():
                self._refused = True
                return []
            case Leave(reason):
                return self._leave(reason)
        raise AssertionError(f"unknown event {event}")

    # Joining, living and leaving.

    def _tick(self, now: float) -> list[Instruction]:
        slept, self._ticked_at = now - self._ticked_at, now
        if self._welcome is None:
            return self._try_again(now)
        if slept > self._welcome.liveness_s / 2:
            self._heard_at = now  # this process itself stood still (a laptop's lid): silence says nothing
            self._peers.stood_still(slept)
        silence = now - self._heard_at
        if silence > self._welcome.liveness_s:
            text = f"the master at {self._endpoint} has been silent for {silence:.0f} s; it may have died"
            return self._exit(text, elsewhere=True)
        out = self._peers.overdue(now)
        if now >= self._beat_at:
            self._beat_at = now + self._welcome.heartbeat_s
            out.append(ToMaster(protocol.Heartbeat()))
        building = any(isinstance(job, jobs.Build) for _, job in self._running)
        building = building and now - self._running_since > SLOW_BUILD_S
        if building and not self._slow_build_told:
            self._slow_build_told = True
            text = "builds its cells and compiles kernels; the first time that takes about half a minute"
            out += [ToMaster(protocol.Note(text)), Tell(text)]
        return out

    def _try_again(self, now: float) -> list[Instruction]:
        if now >= self._give_up_at:
            if self._refused:
                return self._exit(
                    f"the master at {self._endpoint} does not accept this slave's keys; "
                    "give --keys with the folder that the master has, or none if it has none"
                )
            return self._exit(
                f"no master answered at {self._endpoint} within {self._patience:g} s; "
                "check that `wdpm master` runs there, and its address, port and firewall"
            )
        if now < self._retry_at:
            return []
        self._wait = min(2 * self._wait, self._limits.join_longest_s)
        self._retry_at = now + self._wait
        return [
            Tell(f"no answer from {self._endpoint} yet; next try in {self._wait:g} s"),
            Reconnect(),
            ToMaster(self._hello),
        ]

    def _leave(self, reason: str) -> list[Instruction]:
        return [ToMaster(protocol.Goodbye(reason)), *self._exit(reason)]

    def _fail(self, text: str) -> list[Instruction]:
        return [ToMaster(protocol.Failed(text)), *self._exit(text)]

    def _exit(self, error: str | None, *, elsewhere: bool = False) -> list[Instruction]:
        self._ended = True
        return [Exit(error, elsewhere)]

    # Messages.

    def _master_said(self, message: protocol.FromMaster, now: float) -> list[Instruction]:
        match message:
            case protocol.Heartbeat():
                return []
            case protocol.Welcome():
                if self._welcome is None:
                    self._beat_at = now + message.heartbeat_s
                    self._welcome = message
                    out: list[Instruction] = [Tell(f"joined {self._endpoint} as slave {message.number}")]
                    for identity, hello in self._peers.take_early():
                        out += self._peer_said(identity, hello)
                    return out
                return []  # the answer to a second Hello
            case protocol.Refuse(reason):
                return self._exit(f"the master at {self._endpoint} refused: {reason}")
            case protocol.Stop(reason, completed):
                goodbye = ToMaster(protocol.Goodbye("stopped"))
                if completed:
                    return [goodbye, Tell(f"stopped: {reason}"), *self._exit(None)]
                return [goodbye, *self._exit(f"the render ended without an image: {reason}", elsewhere=True)]
            case protocol.Rejected(reason):
                return self._fail(f"the master could not read a message of this slave: {reason}")
        if self._welcome is None:
            raise ProtocolError(f"{type(message).__name__} came before Welcome")
        if isinstance(message, protocol.Setup):
            return self._set_up(message, self._welcome, now)
        if message.epoch != self._epoch:
            return self._drop(f"{type(message).__name__} of another epoch")
        return self._ordered(message)

    def _ordered(
        self,
        message: protocol.Partition
        | protocol.StartTask
        | protocol.BuildMaps
        | protocol.SetView
        | protocol.SetRecords
        | protocol.ForgetPhotons
        | protocol.ReadStatistics,
    ) -> list[Instruction]:
        match message:
            case protocol.Partition():
                return self._receive(message)
            case protocol.StartTask(_, task):
                self._tasks.append(jobs.StartTask(task))
            case protocol.BuildMaps():
                self._orders.append(jobs.ExchangeGhosts())
            case protocol.SetView(_, view):
                self._orders.append(jobs.SetView(view))
            case protocol.SetRecords(_, records):
                self._orders.append(jobs.SetRecords(records))
            case protocol.ForgetPhotons(_, plan):
                self._orders.append(jobs.ForgetPhotons(plan))
            case protocol.ReadStatistics():
                self._orders.append(jobs.ReadStatistics())
        return []

    def _set_up(self, setup: protocol.Setup, welcome: protocol.Welcome, now: float) -> list[Instruction]:
        if setup.epoch <= self._epoch:
            return self._drop("Setup of an older epoch")
        self._check_setup(setup, welcome)
        self._epoch = setup.epoch
        self._setup = setup
        self._parts, self._partition = {}, {}
        self._missing = {cell for cell, holder in enumerate(setup.holders) if holder == welcome.number}
        self._orders.clear()
        self._ghosts.clear()
        self._batches = Queues()
        self._tasks.clear()
        self._ghosts_handled, self._ghosts_expected = 0, None
        out: list[Instruction] = []
        if self._peers.set_up(setup.peers, welcome.number, now):
            out.append(ConnectPeers(welcome.number, setup.peers))
            greeting = protocol.PeerHello(welcome.cluster, welcome.number)
            out += [ToPeer(peer, greeting) for peer in range(len(setup.peers)) if peer != welcome.number]
        self._build_if_complete()
        return out

    def _check_setup(self, setup: protocol.Setup, welcome: protocol.Welcome) -> None:
        cells = setup.world.top_tree.cells
        if len(setup.holders) != cells:
            raise ProtocolError(f"Setup names holders of {len(setup.holders)} cells; its top tree has {cells}")
        if not all(0 <= holder < len(setup.peers) for holder in setup.holders):
            raise ProtocolError(f"Setup names a holder outside 0 to {len(setup.peers) - 1}")
        if not welcome.number < len(setup.peers):
            raise ProtocolError(f"Setup has no endpoint for slave {welcome.number}")

    def _receive(self, message: protocol.Partition) -> list[Instruction]:
        if self._setup is None or message.cell not in self._missing:
            raise ProtocolError(f"the master sent cell {message.cell}, which is not expected here")
        parts = self._parts.setdefault(message.cell, [])
        if message.part != len(parts) or message.parts <= message.part:
            raise ProtocolError(f"part {message.part} of {message.parts} of cell {message.cell} is out of order")
        parts.append(message.triangles)
        if len(parts) < message.parts:
            return []
        triangles = join(self._parts.pop(message.cell))
        checks.check_triangles(triangles, self._setup.world, f"cell {message.cell}")
        self._partition[message.cell] = triangles
        self._missing.remove(message.cell)
        self._build_if_complete()
        return [ToMaster(protocol.PartitionReceived(self._epoch, message.cell))]

    def _build_if_complete(self) -> None:
        if self._setup is not None and not self._missing:
            partition, self._partition = self._partition, {}
            self._orders.append(jobs.Build(self.number, self._setup.world, partition, self._setup.holders))

    def _peer_said(self, identity: bytes, message: protocol.FromPeer) -> list[Instruction]:
        if isinstance(message, protocol.PeerHello):
            if self._welcome is None:
                kept = self._peers.keep_early(identity, message)
                return [] if kept else self._stranger(identity, "too many PeerHello before Welcome")
            if message.cluster != self._welcome.cluster:
                return self._stranger(identity, "PeerHello of another cluster")
            return self._peers.greeted(identity, message, self._welcome.number)
        peer = self._peers.number_of(identity)
        if peer is None:
            return self._stranger(identity, "PeerBatch without PeerHello")
        if message.epoch != self._epoch:
            return self._drop("PeerBatch of another epoch")
        self._check_destination(message.batch, f"slave {peer}")
        if self._setup is not None:
            checks.check_batch(message.batch, self._setup.world)
        self._enqueue(message.batch)
        return []

    def _unreadable_peer(self, identity: bytes, reason: str) -> list[Instruction]:
        peer = self._peers.number_of(identity)
        if peer is not None:
            return self._fail(f"cannot read a message of slave {peer}: {reason}")
        return self._stranger(identity, "unreadable")

    def _stranger(self, identity: bytes, reason: str) -> list[Instruction]:
        return [*self._drop(reason), AnswerPeer(identity, protocol.Rejected(reason))]

    def _drop(self, reason: str) -> list[Instruction]:
        self._dropped[reason] += 1
        return []

    # Jobs.

    def _destination(self, batch: Batch, source: str) -> int:
        holders = () if self._setup is None else self._setup.holders
        slaves = 0 if self._setup is None else len(self._setup.peers)
        least_home = -1 if batch.kind in GHOSTS else 0
        if not (0 <= batch.cell < len(holders) and least_home <= batch.home < slaves):
            raise ProtocolError(
                f"a {batch.kind.value} batch of {source} is for cell {batch.cell} and home {batch.home}; "
                f"there are {len(holders)} cells and {slaves} slaves"
            )
        return batch.home if batch.kind in TO_HOME else holders[batch.cell]

    def _check_destination(self, batch: Batch, source: str) -> None:
        if self._destination(batch, source) != self.number:
            raise ProtocolError(f"a {batch.kind.value} batch of {source} is not for slave {self.number}")

    def _enqueue(self, batch: Batch) -> None:
        if batch.kind in GHOSTS:
            self._ghosts.append(batch)  # counted, so they must not be joined
        else:
            self._batches.add(batch)

    def _next_jobs(self, now: float) -> list[Instruction]:
        out: list[Instruction] = []
        while (job := self._next_job()) is not None:
            self._running.append((self._epoch, job))
            self._running_since = now
            out.append(Run(job))
        return out

    def _next_job(self) -> Job | None:
        """One job at a time; but tasks that need no other slave are done several at once, where that is possible."""
        if self._running:
            tasks_alone = self._holds_all and all(isinstance(job, jobs.StartTask) for _, job in self._running)
            room = self._hello.processes > 1 and len(self._running) < QUEUED * self._hello.processes
            if not (tasks_alone and room and self._tasks) or self._orders:
                return None
            return self._tasks.popleft()
        if self._orders:
            return self._orders.popleft()
        if self._ghosts:
            return jobs.HandleBatch(self._ghosts.popleft())
        if self._batches:
            return jobs.HandleBatch(self._batches.pop())
        return self._tasks.popleft() if self._tasks else None

    @property
    def _holds_all(self) -> bool:
        """Whether the scene is one cell, which this slave holds."""
        return self._setup is not None and len(self._setup.holders) == 1

    def _computed(self, outcome: Outcome) -> list[Instruction]:
        job, epoch = self._end_job(outcome.job)
        if epoch != self._epoch:
            return self._drop("outcome of another epoch")  # a Setup came while the worker was busy
        out: list[Instruction] = []
        for batch in outcome.batches:
            destination = self._destination(batch, "this slave")
            if destination == self.number:
                self._enqueue(batch)
            else:
                out.append(ToPeer(destination, protocol.PeerBatch(self._epoch, batch)))
        out += [ToMaster(protocol.TaskDone(self._epoch, result)) for result in outcome.results]
        return out + self._acknowledge(job, outcome)

    def _end_job(self, done: Job) -> tuple[Job, int]:
        """The job that has ended, as it was ordered, and its epoch."""
        if not self._running:
            raise AssertionError("an outcome without a job")
        place = 0
        if len(self._running) > 1:  # tasks, which end in any order
            place = next(place for place, (_, job) in enumerate(self._running) if job is done)
        epoch, job = self._running.pop(place)
        return job, epoch

    def _acknowledge(self, job: Job, outcome: Outcome) -> list[Instruction]:
        match job:
            case jobs.Build():
                return [ToMaster(protocol.Ready(self._epoch))]
            case jobs.SetView():
                return [ToMaster(protocol.ViewSet(self._epoch))]
            case jobs.SetRecords():
                return [ToMaster(protocol.RecordsSet(self._epoch))]
            case jobs.ForgetPhotons():
                return [ToMaster(protocol.PhotonsForgotten(self._epoch))]
            case jobs.BuildMaps():
                return [ToMaster(protocol.MapsBuilt(self._epoch))]
            case jobs.ReadStatistics():
                values = {**(outcome.statistics or {}), "dropped": self.dropped}
                return [ToMaster(protocol.Statistics(self._epoch, values))]
            case jobs.ExchangeGhosts():
                self._ghosts_expected = outcome.ghosts_expected
                self._build_maps_if_complete()
            case jobs.HandleBatch(batch) if batch.kind in GHOSTS:
                self._ghosts_handled += 1
                self._build_maps_if_complete()
        return []

    def _build_maps_if_complete(self) -> None:
        if self._ghosts_expected is None or self._ghosts_handled < self._ghosts_expected:
            return
        if self._ghosts_handled > self._ghosts_expected:
            raise ProtocolError(
                f"{self._ghosts_handled} batches of ghosts and points came; expected {self._ghosts_expected}"
            )
        self._ghosts_handled, self._ghosts_expected = 0, None
        self._orders.append(jobs.BuildMaps())


def join(parts: Sequence[Triangles]) -> Triangles:
    """Triangles of several parts of a cell as one."""
    whole = parts[0]
    if len(parts) > 1:
        names = ("ids", "positions", "normals", "uvs", "material", "emitter", "colors")
        whole = Triangles(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
    return whole
