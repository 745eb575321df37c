"""A cluster in one process: the same master and slaves, and queues in place of sockets.

This is `wdpm render` without slaves (one worker), and how nearly every distributed test runs. Messages of one sender to
one receiver keep their order, as on a socket; all else may be shuffled, and no bit of the image may change.
"""

from __future__ import annotations

import random
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wdpm.cluster.cluster_settings import ClusterSettings
from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Master
from wdpm.cluster.messages import protocol
from wdpm.cluster.progress import Progress, report
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave.jobs import Compute, Worker, WorkerFactory
from wdpm.cluster.slave.machine import Slave
from wdpm.scenes.errors import ClusterError
from wdpm.scenes.flat.arrays import Triangles

MASTER = -1
"""Stands for the master among the numbers of slaves."""


@dataclass(frozen=True)
class Channel:
    """What keeps its order: messages from one process to another, or the jobs of one slave."""

    sender: int
    receiver: int


class Post:
    """Deliveries that wait, in the order of their arrival or in a shuffled one.

    Args:
        shuffle: picks the channel that delivers next; None delivers in the order of arrival.
    """

    def __init__(self, shuffle: random.Random | None) -> None:
        self._shuffle = shuffle
        self._in_order: deque[Callable[[], None]] = deque()
        self._channels: dict[Channel, deque[Callable[[], None]]] = {}

    def put(self, channel: Channel, delivery: Callable[[], None]) -> None:
        """Add a delivery behind all others of its channel."""
        if self._shuffle is None:
            self._in_order.append(delivery)
        else:
            self._channels.setdefault(channel, deque()).append(delivery)

    def deliver(self) -> bool:
        """Make one delivery; False if there was none."""
        if self._in_order:
            self._in_order.popleft()()
            return True
        if self._shuffle is None or not self._channels:
            return False
        channel = self._shuffle.choice(list(self._channels))
        waiting = self._channels[channel]
        delivery = waiting.popleft()
        if not waiting:
            del self._channels[channel]
        delivery()
        return True


class MemoryCluster:
    """A master and its slaves in this process; renders any number of sessions.

    Args:
        make_worker: makes the compute object of each slave.
        slaves: how many.
        shuffle: shuffles deliveries and jobs, for tests that order does not matter.
    """

    def __init__(
        self,
        make_worker: WorkerFactory,
        slaves: int,
        *,
        settings: ClusterSettings | None = None,
        shuffle: random.Random | None = None,
    ) -> None:
        self._post = Post(shuffle)
        self._master = Master(slaves, {}, settings)
        self._slaves: list[Slave] = []
        self._computes = [Compute(make_worker) for _ in range(slaves)]
        self._session: Session | None = None
        self._progress: Progress | None = None
        self._result: SessionResult | None = None
        for number in range(slaves):
            hello = protocol.Hello({}, "this process", number, 0, 0, f"memory:{number}")
            self._slaves.append(Slave(hello, "memory", patience=float("inf"), settings=settings))
            self._tell_slave(number, s.Start())
            # They join one by one, so that the master's numbers are the places in the list of workers.
            while self._post.deliver():
                pass

    def render(self, session: Session, progress: Progress | None = None) -> SessionResult:
        """Render a session; ClusterError if a slave fails, and whatever a worker raises."""
        self._session, self._progress, self._result = session, progress, None
        self._tell_master(m.Begin(session))
        while self._result is None:
            if not self._post.deliver():
                raise AssertionError(f"the cluster waits for nothing in phase {self._master.phase.value}")
        self._session = None
        return self._result

    def _tell_master(self, event: m.Event) -> None:
        for instruction in self._master.handle(event, time.perf_counter()):
            self._obey_master(instruction)

    def _obey_master(self, instruction: m.Instruction) -> None:
        match instruction:
            case m.Send(identity, message):
                number = int.from_bytes(identity)
                event = s.MasterSaid(message)
                self._post.put(Channel(MASTER, number), lambda: self._tell_slave(number, event))
            case m.MakePartition(cell):
                if self._session is None:
                    raise AssertionError("a partition was asked for outside a session")
                self._tell_master(m.PartitionMade(cell, self._session.partition(cell)))
            case m.Finished(result):
                self._result = result
            case m.Broken(reason):
                raise ClusterError(reason)
            case _:
                report(instruction, self._progress)

    def _tell_slave(self, number: int, event: s.Event) -> None:
        for instruction in self._slaves[number].handle(event, time.perf_counter()):
            self._obey_slave(number, instruction)

    def _obey_slave(self, number: int, instruction: s.Instruction) -> None:
        identity = number.to_bytes(4)
        match instruction:
            case s.ToMaster(to_master):
                event = m.SlaveSaid(identity, to_master)
                self._post.put(Channel(number, MASTER), lambda: self._tell_master(event))
            case s.ToPeer(peer, to_peer):
                said = s.PeerSaid(identity, to_peer)
                self._post.put(Channel(number, peer), lambda: self._tell_slave(peer, said))
            case s.Run(job):
                # A worker that raises ends the render with its own exception: here nothing needs to cross a wire.
                self._post.put(
                    Channel(number, number),
                    lambda: self._tell_slave(number, s.Computed(self._computes[number].run(job))),
                )
            case s.ConnectPeers() | s.Tell() | s.Exit(None):
                pass
            case s.Exit(error):
                raise ClusterError(f"slave {number}: {error}")
            case _:
                raise AssertionError(f"no {type(instruction).__name__} is possible in memory")


def run(
    session: Session,
    workers: Sequence[Worker],
    progress: Progress | None = None,
    *,
    settings: ClusterSettings | None = None,
    shuffle: random.Random | None = None,
) -> SessionResult:
    """Render a session with workers that are built already; `session.partition` is not called.

    Args:
        workers: by number.
        shuffle: shuffles deliveries and jobs, for tests that order does not matter.
    """
    cluster = MemoryCluster(lambda number, *_: workers[number], len(workers), settings=settings, shuffle=shuffle)
    return cluster.render(replace(session, partition=lambda _: NO_TRIANGLES), progress)


NO_TRIANGLES = Triangles(
    np.empty(0, np.int32),
    np.empty((0, 3, 3), np.float32),
    np.empty((0, 3, 3), np.float32),
    np.empty((0, 3, 2), np.float32),
    np.empty(0, np.int32),
    np.empty(0, np.int32),
    np.empty((0, 3, 3), np.float32),
)
"""What a worker that is built already is sent."""
