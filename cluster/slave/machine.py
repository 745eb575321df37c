"""A slave as a state machine: events in, instructions out. It touches no socket, no clock and no kernel.

A slave joins, gets its cells, and then does what comes: batches for its homes first, then batches for its cells, then
new tasks. Finishing before starting bounds what is in memory, since a task that has not begun holds nothing. Batches
that go the same way are joined while they wait, whichever tasks they belong to; job_queue.py says how many are
handled in a turn.

The shell in loop.py brings events and carries out instructions.
"""

from __future__ import annotations

from collections import Counter

from wdpm.cluster.batch import OF_MAPS, Batch
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.messages import checks, endpoints, protocol
from wdpm.cluster.slave import jobs
from wdpm.cluster.slave.attempts import Attempts
from wdpm.cluster.slave.cells import ArrivingCells
from wdpm.cluster.slave.destination import destination_of
from wdpm.cluster.slave.events import (
    JOINED,
    AnswerPeer,
    Computed,
    ComputeFailed,
    ConnectPeers,
    Event,
    Exit,
    Instruction,
    Leave,
    MasterLost,
    MasterReached,
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
    Wake,
)
from wdpm.cluster.slave.job_queue import JobQueue
from wdpm.cluster.slave.jobs import Job, Outcome
from wdpm.cluster.slave.peers import Peers
from wdpm.scenes.errors import ProtocolError

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
        rejoin: how long it waits for a master that it has lost; None for as long as for the first answer.
        hold_s: how long a few rows wait for more: see JobQueue.
    """

    def __init__(
        self,
        hello: protocol.Hello,
        endpoint: str,
        patience: float,
        limits: ClusterLimits | None = None,
        rejoin: float | None = None,
        hold_s: float = 0.0,
    ) -> None:
        self._hello = hello
        self._endpoint = endpoint
        self._limits = limits or ClusterLimits()
        self._welcome: protocol.Welcome | None = None
        self._attempts = Attempts(patience, rejoin, self._limits)
        self._refused = False
        self._master_late = False
        self._heard_at = self._ticked_at = self._beat_at = 0.0
        self._epoch = 0
        self._setup: protocol.Setup | None = None
        self._arriving: ArrivingCells | None = None
        self._had: frozenset[int] = frozenset()  # cells of the worker that was built last
        self._peers = Peers(self._limits.peer_answer_s, self._limits.dead_s)
        self._work = JobQueue(hold_s)
        self._running: list[tuple[int, Job]] = []  # with the epoch of each
        self._running_since = 0.0
        self._slow_build_noted = False
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

    @property
    def computes(self) -> bool:
        """Whether its worker is at something."""
        return bool(self._running)

    @property
    def wake_at(self) -> float | None:
        """When it wants an event Wake, since something waits until then; None if nothing does."""
        return self._work.wake_at

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
        more = isinstance(event, PeerSaid) and event.more
        if not (self._ended or more):
            out += self._next_jobs(now)
        return out

    def _dispatch(self, event: Event, now: float) -> list[Instruction]:
        match event:
            case MasterSaid(message):
                self._heard_at = now
                return self._master_said(message, now)
            case PeerSaid(identity, message, _):
                return self._peer_said(identity, message)
            case PeerAnswered(number, message):
                return self._peers.answered(number, message)
            case Computed(outcome, ran_s):
                self._work.ended(outcome.job, ran_s, now - self._running_since - ran_s)
                return self._computed(outcome)
            case Tick():
                return self._tick(now)
            case Wake():
                return []  # what is held may begin
            case Start():
                self._attempts.begin(now)
                self._ticked_at = now
                return [ToMaster(self._hello)]
            case Unreadable(None, reason):
                return self._fail(f"cannot read a message of the master: {reason}")
            case Unreadable(bytes(identity), reason):
                return self._unreadable_peer(identity, reason)
            case ComputeFailed(text):
                return self._fail(text)
            case PeerLost(number, reason):
                # Not this slave's to judge: the peer may have died, or have been told to stop a moment earlier.
                self._peers.lost(number)
                return [*([ToMaster(protocol.Note(reason))] if reason else []), ToMaster(protocol.PeerGone(number))]
            case MasterLost(reason):
                if self._welcome is None:
                    self._attempts.wait_for_nobody()
                    return []  # it does not listen yet
                return self._join_again(reason, now)
            case MasterReached():
                self._refused = False  # another try was not accepted, or cut off before keys were agreed on
                self._attempts.wait_for_answer(now)
                return []
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
        if slept > self._limits.slept_s:
            self._heard_at = now  # this process itself stood still (a laptop's lid): silence says nothing
            self._peers.stood_still(slept)
        silence = now - self._heard_at
        if silence > self._welcome.liveness_s:
            return self._join_again(f"it has been silent for {silence:.0f} s", now)
        out = self._news_of_silence(silence) + self._peers.overdue(now)
        if now >= self._beat_at:
            self._beat_at = now + self._welcome.heartbeat_s
            out.append(ToMaster(protocol.Heartbeat()))
        slow = now - self._running_since > SLOW_BUILD_S
        if slow and any(isinstance(job, jobs.Build) for _, job in self._running) and not self._slow_build_noted:
            self._slow_build_noted = True
            text = "builds its cells and compiles kernels; the first time that takes about half a minute"
            out += [ToMaster(protocol.Note(text)), Tell(text)]
        return out

    def _news_of_silence(self, silence: float) -> list[Instruction]:
        late, self._master_late = self._master_late, silence > self._limits.late_s
        if self._master_late == late:
            return []
        return [
            Tell("the master is back" if late else f"the master has been silent for {silence:.0f} s; it is waited for")
        ]

    def _join(self, welcome: protocol.Welcome, now: float) -> list[Instruction]:
        """The master has let it in; or again, as another slave, if it took a second Hello for one that came back."""
        if self._welcome is not None:
            if welcome.number == self._welcome.number:
                return []  # the answer to a second Hello
            self._setup = self._arriving = None
            self._clear(epoch=0)
        self._beat_at = now + welcome.heartbeat_s
        self._welcome = welcome
        out: list[Instruction] = [Tell(f"{JOINED} {self._endpoint} as slave {welcome.number}")]
        for identity, hello in self._peers.take_early():
            out += self._peer_said(identity, hello)
        return out

    def _try_again(self, now: float) -> list[Instruction]:
        within = f"within {self._attempts.patience:g} s"
        if self._attempts.over(now):
            if self._refused and not self._attempts.again:  # keys that did for a master do for the next
                return self._exit(
                    f"the master at {self._endpoint} does not accept this slave's keys; "
                    "give --keys with the folder that `wdpm keys add` made for it, or none if the master has none"
                )
            if self._attempts.again:
                return self._exit(
                    f"lost the master at {self._endpoint}, and none answered there {within}", elsewhere=True
                )
            return self._exit(
                f"no master answered at {self._endpoint} {within}; "
                + endpoints.check_reach(
                    self._endpoint, "check that `wdpm master` runs there, and its address, port and firewall"
                )
            )
        if (wait := self._attempts.due(now)) is None:
            return []
        return [
            *([] if self._attempts.again else [Tell(f"no answer from {self._endpoint} yet; next try in {wait:g} s")]),
            Reconnect(),
            ToMaster(self._hello),
        ]

    def _join_again(self, reason: str, now: float) -> list[Instruction]:
        """The master is lost: it, or another one at its address, may be back soon. What was begun is forgotten."""
        self._welcome, self._setup, self._arriving = None, None, None
        self._clear(epoch=0)
        self._peers.forget()
        self._attempts.begin(now, again=True)
        text = f"lost the master at {self._endpoint} ({reason}); tries to join again for {self._attempts.patience:g} s"
        return [Tell(text), ConnectPeers(()), Reconnect(fresh=True), ToMaster(self._hello)]

    def _clear(self, epoch: int) -> None:
        """Begin an epoch: what was ordered and came before is void, and so is what a running job will bring."""
        self._epoch = epoch
        self._work.clear()
        self._running = [(-1, job) for _, job in self._running]

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
                return self._join(message, now)
            case protocol.Refuse(reason):
                if self._attempts.again:
                    self._attempts.wait_for_nobody()
                    # The master may not have missed it yet, and have no room for it until it does.
                    return [Tell(f"the master at {self._endpoint} refuses this slave so far: {reason}")]
                return self._exit(f"the master at {self._endpoint} refused: {reason}")
            case protocol.Stop(reason, completed):
                goodbye = ToMaster(protocol.Goodbye("stopped"))
                if completed:
                    return [goodbye, Tell(f"stopped: {reason}"), *self._exit(None)]
                return [goodbye, *self._exit(f"the render ended without an image: {reason}", elsewhere=True)]
            case protocol.Dismissed(reason):
                return self._join_again(f"it takes this slave for lost: {reason}", now)
            case protocol.Rejected(reason):
                return self._fail(f"the master could not read a message of this slave: {reason}")
        if self._welcome is None:
            raise ProtocolError(f"{type(message).__name__} came before Welcome")
        if isinstance(message, protocol.Setup):
            return self._set_up(message, self._welcome, now)
        if message.epoch != self._epoch:
            return self._drop(f"{type(message).__name__} of another epoch")
        return self._ordered(message, now)

    def _ordered(self, message: protocol.Ordered, now: float) -> list[Instruction]:
        match message:
            case protocol.Partition():
                return self._receive(message)
            case protocol.StartTask(_, task):
                self._work.tasks.append(jobs.StartTask(task))
            case protocol.BuildMaps():
                return self._build_maps(message, now)
            case protocol.SetView(_, view):
                self._work.orders.append(jobs.SetView(view))
            case protocol.AwaitRecords():
                self._work.orders.append(jobs.AwaitRecords())
            case protocol.SetRecords(_, records):
                self._work.orders.append(jobs.SetRecords(records))
            case protocol.ForgetPhotons(_, plan):
                self._work.orders.append(jobs.ForgetPhotons(plan))
            case protocol.ReadStatistics():
                self._work.orders.append(jobs.ReadStatistics())
        return []

    def _set_up(self, setup: protocol.Setup, welcome: protocol.Welcome, now: float) -> list[Instruction]:
        if setup.epoch <= self._epoch:
            return self._drop("Setup of an older epoch")
        self._arriving = ArrivingCells(setup, welcome.number, self._had)
        self._setup = setup
        self._clear(setup.epoch)
        team = {number: peer for number, peer in enumerate(setup.peers) if peer and number != welcome.number}
        out = self._connect(team, welcome, now)
        self._build_if_complete(self._arriving, setup)
        return out

    def _connect(self, peers: dict[int, str], welcome: protocol.Welcome, now: float) -> list[Instruction]:
        """Be connected with these peers and no others."""
        new = self._peers.set_up(peers, now)
        greeting = protocol.PeerHello(welcome.cluster, welcome.number)
        return [ConnectPeers(tuple(sorted(peers.items()))), *(ToPeer(peer, greeting) for peer in new)]

    def _build_maps(self, order: protocol.BuildMaps, now: float) -> list[Instruction]:
        """Other teams may be needed for that, which this slave has no connection with."""
        if self._setup is None or self._welcome is None:
            raise ProtocolError("BuildMaps came before Setup")
        for copy in order.copies:
            if not (copy.cell < len(self._setup.holders) and self._setup.holders[copy.cell] == self.number):
                raise ProtocolError(f"BuildMaps asks for copies of cell {copy.cell}, which is not held here")
        self._work.orders += self._work.map_inputs.ordered(order)
        others = {copy.slave: copy.endpoint for copy in order.copies}
        return self._connect({**self._peers.endpoints, **others}, self._welcome, now) if others else []

    def _receive(self, message: protocol.Partition) -> list[Instruction]:
        if self._setup is None or self._arriving is None:
            raise ProtocolError(f"the master sent cell {message.cell}, which is not expected here")
        if not self._arriving.receive(message):
            return []
        self._build_if_complete(self._arriving, self._setup)
        return [ToMaster(protocol.PartitionReceived(self._epoch, message.cell))]

    def _build_if_complete(self, arriving: ArrivingCells, setup: protocol.Setup) -> None:
        if arriving.complete:
            self._arriving = None
            cells = arriving.take()
            self._work.orders.append(
                jobs.Build(self.number, setup.world, cells, setup.holders, setup.kept, setup.scene)
            )

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
            return self._stranger(identity, "PeerBatches without PeerHello")
        if message.epoch != self._epoch:
            return self._drop("PeerBatches of another epoch")
        for batch in message.batches:
            if destination_of(batch, self._setup, f"slave {peer}") != self.number:
                raise ProtocolError(f"a {batch.kind.value} batch of slave {peer} is not for slave {self.number}")
            if self._setup is not None:
                checks.check_batch(batch, self._setup.world)
            self._work.add(batch)
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

    def _next_jobs(self, now: float) -> list[Instruction]:
        out: list[Instruction] = []
        while (job := self._next_job(now)) is not None:
            self._running.append((self._epoch, job))
            self._running_since = now
            out.append(Run(job, self._work.is_short(job)))
        return out

    def _next_job(self, now: float) -> Job | None:
        """One job at a time; but tasks that need no other slave are done several at once, where that is possible."""
        if self._running:
            tasks_alone = self._holds_all and all(isinstance(job, jobs.StartTask) for _, job in self._running)
            room = self._hello.processes > 1 and len(self._running) < QUEUED * self._hello.processes
            if not (tasks_alone and room and self._work.tasks) or self._work.orders:
                return None
            return self._work.tasks.popleft()
        return self._work.next_job(now)

    @property
    def _holds_all(self) -> bool:
        """Whether the scene is one cell, which this slave holds."""
        return self._setup is not None and len(self._setup.holders) == 1

    def _computed(self, outcome: Outcome) -> list[Instruction]:
        job, epoch = self._end_job(outcome.job)
        if isinstance(job, jobs.Build):
            self._had = frozenset(cell for cell, holder in enumerate(job.holders) if holder == job.number)
        if epoch != self._epoch:
            return self._drop("outcome of another epoch")  # a Setup came while the worker was busy
        if isinstance(job, jobs.SendCopies | jobs.SortTrees | jobs.BuildMaps):
            self._work.orders += self._work.map_inputs.sent(job, len(outcome.batches))
            return [
                ToPeer(copy.slave, protocol.PeerBatches(copy.epoch, (batch,)))
                for copy, batch in zip(job.copies if outcome.batches else (), outcome.batches, strict=True)
            ]
        out: list[Instruction] = []
        leaving: dict[int, list[Batch]] = {}
        for batch in outcome.batches:
            destination = destination_of(batch, self._setup, "this slave")
            if destination == self.number:
                self._work.add(batch)
            elif batch.kind in OF_MAPS:  # large, and many
                out.append(ToPeer(destination, protocol.PeerBatches(self._epoch, (batch,))))
            else:
                leaving.setdefault(destination, []).append(batch)
        out += [ToPeer(peer, protocol.PeerBatches(self._epoch, tuple(sent))) for peer, sent in leaving.items()]
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
            case jobs.FinishMaps():
                return [ToMaster(protocol.MapsBuilt(self._epoch, dict(outcome.statistics or {})))]
            case jobs.ReadStatistics():
                values = {**(outcome.statistics or {}), "dropped": self.dropped}
                return [ToMaster(protocol.Statistics(self._epoch, values))]
            case jobs.ExchangeGhosts():
                self._work.orders += self._work.map_inputs.exchanged(outcome.ghosts_expected)
            case jobs.HandleBatches(batches) if batches[0].kind in OF_MAPS:
                self._work.orders += self._work.map_inputs.handled(batches[0])
        return []
