"""A cluster of state machines whose messages go through packing, one by one, in any order that sockets allow.

Somebody in it lies: a stranger to all, one of the slaves, or the master. What honest state machines must do then is
checked by the fuzzer; here is only how messages get from one to another.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from fake_worker import FakeWorker, irradiance_records, make_session, make_view, make_world
from wire_mutations import Frames, mutate

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.loop import FROM_SLAVE
from wdpm.cluster.master.machine import Master
from wdpm.cluster.messages import packing
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave.jobs import Compute, Job
from wdpm.cluster.slave.loop import FROM_MASTER, FROM_PEER, PEER_ANSWER
from wdpm.cluster.slave.machine import Slave
from wdpm.cluster.task import RecordsMade, RecordTask
from wdpm.scenes.errors import ProtocolError

MASTER = -1
STRANGER = -2
NOBODY = -3

VERSIONS = {"code": "1"}
LIMITS = ClusterLimits(photon_task_paths=200, part_triangles=4, cells_in_flight=1)
MOST_STEPS = 4000

NEVER_SENT = (
    p.Refuse("no"),
    p.Rejected("what?"),
    p.Note("hm"),
    p.Vitals(2**30, 1.5, 1e6, 1e6),
    p.Failed("oh"),
    p.Goodbye("bye"),
    p.PeerGone(0),
    p.PeerUnreachable(1, "no answer"),
    p.TaskDone(1, RecordsMade(0, 0, irradiance_records(3), 12)),
    p.StartTask(1, RecordTask(0, 0, 0, 9)),
    p.AwaitRecords(1),
    p.SetRecords(1, irradiance_records(2)),
    p.ForgetPhotons(1, make_world(2).photon_plan),
    p.Stop("enough", False),
)
"""Messages that no quiet render sends."""

Way = tuple[int, int, bool]
"""Sender, receiver, and whether it is an answer over the connection that the receiver made to a peer."""


@dataclass
class Outcome:
    """What came of a render.

    Attributes:
        result: the image; None if there is none.
        broken: why the master ended the render.
        exits: why slaves ended, by number.
        lies: messages that were changed or made up.
        content: whether a lie was about pixels, which are believed.
    """

    result: SessionResult | None = None
    broken: str | None = None
    exits: dict[int, str | None] = field(default_factory=dict)
    lies: int = 0
    content: bool = False


class WireCluster:
    """A master and slaves with fake workers.

    Args:
        liar: MASTER, STRANGER, NOBODY, or number of a slave.
        rate: share of its messages that the liar changes; for a stranger, how many it sends beside one of the others'.
    """

    expected_failures: tuple[type[Exception], ...] = (AssertionError, KeyError, ProtocolError)
    """How workers fail of what a liar sends them; fake ones have no better errors."""

    def __init__(
        self, rng: random.Random, slaves: int, liar: int, rate: float, versions: dict[str, str] = VERSIONS
    ) -> None:
        self.outcome = Outcome()
        self.session: Session = make_session(slaves, 4, paths=800, view=make_view(40, 24, 16))
        self._rng, self._liar, self._rate = rng, liar, rate
        self._now = 0.0
        self._ways: dict[Way, deque[Frames]] = {}
        self.sent: list[Frames] = []
        self._jobs: deque[tuple[int, Job]] = deque()
        self._master = Master(slaves, versions, LIMITS)
        self._welcomed: set[bytes] = set()
        hellos = [p.Hello(versions, "host", n, 1, 0, f"tcp://10.0.0.1:{n + 1}") for n in range(slaves)]
        self._slaves = [Slave(hello, "tcp://master:1", 60.0, LIMITS) for hello in hellos]
        self._computes = [Compute(FakeWorker) for _ in hellos]
        self._numbers: dict[int, int] = {}

    def run(self) -> Outcome:
        """Render until there is an image, an error, or nothing left to do."""
        for number, slave in enumerate(self._slaves):
            self._obey_slave(number, slave.handle(s.Start(), self._now))
        self._to_master(m.Begin(self.session))
        for _ in range(MOST_STEPS):
            if self.outcome.result is not None or self.outcome.broken is not None:
                break
            self._now += 0.001
            if not self._step():
                self._now += 1.0
                self._tick()
            if self._rng.random() < 0.01:
                self._tick()
            if self._liar == STRANGER:
                for _ in range(self._rng.randint(0, round(2 * self._rate))):
                    self._intrude()
        return self.outcome

    def _step(self) -> bool:
        """Deliver a message or do a job; False if there is neither."""
        ways = [way for way, waiting in self._ways.items() if waiting]
        if self._jobs and (not ways or self._rng.random() < 0.5):
            self._compute(*self._jobs.popleft())
            return True
        if not ways:
            return False
        way = self._rng.choice(ways)
        frames = self._ways[way].popleft()
        if way[0] == self._liar and self._rng.random() < self._rate:
            frames = self._lie(frames)
        self._deliver(way, frames)
        return True

    def _lie(self, frames: Frames) -> Frames:
        self.outcome.lies += 1
        told = mutate(frames, self._rng)
        if b"BucketRendered" in frames[0] and told[1:] != frames[1:]:
            self.outcome.content = True
        return told

    def _intrude(self) -> None:
        """A stranger says something that was said in another cluster, or the like."""
        self.outcome.lies += 1
        frames = mutate(self._rng.choice(of_another_cluster()), self._rng)
        self._deliver((STRANGER, self._rng.randrange(MASTER, len(self._slaves)), False), frames)

    def _deliver(self, way: Way, frames: Frames) -> None:
        sender, receiver, answer = way
        if receiver == MASTER:
            identity = _identity(sender)
            message = _read(frames, FROM_SLAVE, stranger=identity not in self._welcomed)
            wrong = isinstance(message, ProtocolError)
            self._to_master(m.Unreadable(identity, str(message)) if wrong else m.SlaveSaid(identity, message))
            return
        self._obey_slave(receiver, self._slaves[receiver].handle(self._event(sender, answer, frames), self._now))

    def _event(self, sender: int, answer: bool, frames: Frames) -> s.Event:
        """What a slave's shell makes of a message."""
        if sender == MASTER:
            message = _read(frames, FROM_MASTER)
            return s.Unreadable(None, str(message)) if isinstance(message, ProtocolError) else s.MasterSaid(message)
        if answer:
            message = _read(frames, PEER_ANSWER)
            wrong = isinstance(message, ProtocolError)
            return s.PeerAnswered(self._numbers.get(sender, 0), p.Rejected(str(message)) if wrong else message)
        identity = _identity(sender)
        message = _read(frames, FROM_PEER, stranger=sender == STRANGER)
        return (
            s.Unreadable(identity, str(message))
            if isinstance(message, ProtocolError)
            else s.PeerSaid(identity, message)
        )

    def _tick(self) -> None:
        self._to_master(m.Tick())
        for number, slave in enumerate(self._slaves):
            self._obey_slave(number, slave.handle(s.Tick(), self._now))

    def _to_master(self, event: m.Event) -> None:
        for instruction in self._master.handle(event, self._now):
            match instruction:
                case m.Send(identity, message):
                    if isinstance(message, p.Welcome):
                        self._welcomed.add(identity)
                        self._numbers[_number(identity)] = message.number
                    if identity != _identity(STRANGER):
                        self._send((MASTER, _number(identity), False), message)
                case m.GoOnLater():
                    self._to_master(m.GoOn())
                case m.MakePartition(cell):
                    self._to_master(m.PartitionMade(cell, self.session.partition(cell)))
                case m.Finished(result):
                    self.outcome.result = result
                case m.Broken(reason):
                    self.outcome.broken = reason

    def _obey_slave(self, number: int, instructions: Sequence[s.Instruction]) -> None:
        for instruction in instructions:
            match instruction:
                case s.ToMaster(message):
                    self._send((number, MASTER, False), message)
                case s.ToPeer(peer, message):
                    place = next((place for place, known in self._numbers.items() if known == peer), None)
                    if place is not None:
                        self._send((number, place, False), message)
                case s.AnswerPeer(identity, message) if identity != _identity(STRANGER):
                    self._send((number, _number(identity), True), message)
                case s.Run(job):
                    self._jobs.append((number, job))
                case s.Exit(error, _):
                    self.outcome.exits[number] = error

    def _compute(self, number: int, job: Job) -> None:
        """Do a job, as ComputeThread does."""
        try:
            outcome: s.Event = s.Computed(self._computes[number].run(job))
        except self.expected_failures as error:
            if self._liar == STRANGER:
                raise
            outcome = s.ComputeFailed(str(error))
        self._obey_slave(number, self._slaves[number].handle(outcome, self._now))

    def _send(self, way: Way, message: Any) -> None:
        frames = _bytes(message)
        self.sent.append(frames)
        self._ways.setdefault(way, deque()).append(frames)


@cache
def of_another_cluster() -> Sequence[Frames]:
    """Messages of every kind, with the name of a cluster that is another one (it is told to members only), and other
    versions: where there are no keys, a stranger with the right ones is welcome."""
    other = WireCluster(random.Random(0), 3, NOBODY, 0.0, {"code": "another"})
    other.run()
    return [_bytes(message) for message in NEVER_SENT] + other.sent


def _bytes(message: Any) -> Frames:
    return [bytes(frame) for frame in packing.encode(message)]


def _read(frames: Frames, accepted: Any, *, stranger: bool = False) -> Any:
    try:
        return packing.decode(frames, accepted, stranger=stranger)
    except ProtocolError as error:
        return error


def _identity(number: int) -> bytes:
    return b"slave%d" % number


def _number(identity: bytes) -> int:
    return int(identity.removeprefix(b"slave"))
