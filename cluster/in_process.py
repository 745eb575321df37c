"""A cluster in one process and on one thread: the same master and slaves, and memory in place of sockets.

This is `wdpm render` without slaves (one worker), and how nearly every distributed test runs. Messages of one sender to
one receiver keep their order, as on a socket; all else may be shuffled, and no bit of the image may change.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from wdpm.cluster.cluster_events import ClusterObserver
from wdpm.cluster.display import Display
from wdpm.cluster.kept import Keeper
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.loop import FROM_SLAVE, MasterShell
from wdpm.cluster.master.machine import Master
from wdpm.cluster.master.observing import tell_display, tell_keeper, tell_observer
from wdpm.cluster.messages import protocol
from wdpm.cluster.progress import ProgressObserver
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave.jobs import Compute, Job, Worker, WorkerFactory
from wdpm.cluster.slave.loop import FROM_PEER, SlaveShell
from wdpm.cluster.slave.machine import Slave
from wdpm.cluster.transport.memory import Channel, MemoryNetwork, MemoryTransport
from wdpm.cluster.transport.transport import Role
from wdpm.cluster.work.processes.forked_tasks import ForkedTasks, TaskObserver
from wdpm.cluster.work.worker import CellWorker
from wdpm.kernels.launch import ONE_THREAD, Launcher
from wdpm.scenes.errors import ClusterError
from wdpm.scenes.flat.arrays import NO_TRIANGLES

MASTER = "memory://master"


class Post:
    """Deliveries that wait, in the order of their arrival or in a shuffled one.

    Args:
        shuffle: picks the channel that delivers next; None delivers in the order of arrival.
    """

    def __init__(self, shuffle: random.Random | None) -> None:
        self._shuffle = shuffle
        self._in_order: deque[tuple[Channel, Callable[[], None]]] = deque()
        self._channels: dict[Channel, deque[Callable[[], None]]] = {}

    def put(self, channel: Channel, delivery: Callable[[], None]) -> None:
        """Add a delivery behind all others of its channel."""
        if self._shuffle is None:
            self._in_order.append((channel, delivery))
        else:
            self._channels.setdefault(channel, deque()).append(delivery)

    def deliver(self) -> Channel | None:
        """Make one delivery; the channel that made it, or None if there was none."""
        if self._in_order:
            channel, delivery = self._in_order.popleft()
            delivery()
            return channel
        if self._shuffle is None or not self._channels:
            return None
        channel = self._shuffle.choice(list(self._channels))
        waiting = self._channels[channel]
        delivery = waiting.popleft()
        if not waiting:
            del self._channels[channel]
        delivery()
        return channel


def _shared(worker: Worker, processes: int, observer: TaskObserver | None) -> ForkedTasks | None:
    """Processes for the tasks of a worker that has the whole scene."""
    if processes > 1 and isinstance(worker, CellWorker) and worker.holds_all:
        return ForkedTasks(worker, processes, observer)
    return None


class MemoryCluster:
    """A master and its slaves in this process; renders any number of sessions.

    Args:
        make_worker: makes the compute object of each slave.
        slaves: how many.
        shuffle: shuffles deliveries and jobs, for tests that order does not matter.
        processes: that do the tasks of a slave that has the whole scene.
        observers: are told what happens.
        task_observer: is told of the tasks of those processes.
        launcher: of the master, for what it computes itself.
    """

    def __init__(
        self,
        make_worker: WorkerFactory,
        slaves: int,
        *,
        limits: ClusterLimits | None = None,
        shuffle: random.Random | None = None,
        processes: int = 1,
        observers: Sequence[ClusterObserver] = (),
        task_observer: TaskObserver | None = None,
        launcher: Launcher = ONE_THREAD,
    ) -> None:
        self._share = partial(_shared, processes=processes, observer=task_observer)
        self._post = Post(shuffle)
        self._transport = MemoryTransport(lambda channel, _, delivery: self._post.put(channel, delivery))
        self._session: Session | None = None
        self._progress: ProgressObserver | None = None
        self._display: Display | None = None
        self._keeper: Keeper | None = None
        self._result: SessionResult | None = None
        network = self._transport.open(None)
        listener = network.listen(MASTER, Role.MASTER, FROM_SLAVE)
        self._master = MasterShell(Master(slaves, {}, limits, launcher=launcher), listener, self._answer, observers)
        self._slaves: dict[object, SlaveShell] = {}
        self._computes: dict[object, Compute] = {}
        for number in range(slaves):
            self._add_slave(number, make_worker, limits, processes)
            # They join one by one, so that the master's numbers are the places in the list of workers.
            while self._step():
                pass

    def _add_slave(self, number: int, make_worker: WorkerFactory, limits: ClusterLimits | None, processes: int) -> None:
        network = self._transport.open(None)
        listener = network.listen(network.address_for_peers(MASTER), Role.SLAVE, FROM_PEER)
        hello = protocol.Hello({}, "this process", number, 0, 0, listener.endpoint, processes)
        state = Slave(hello, "memory", patience=float("inf"), limits=limits)
        self._computes[network] = Compute(make_worker, self._share)
        submit = partial(self._submit, network)
        shell = self._slaves[network] = SlaveShell(state, network, listener, MASTER, submit, tell=lambda _: None)
        shell.handle(s.Start())

    def render(
        self,
        session: Session,
        progress: ProgressObserver | None = None,
        display: Display | None = None,
        keeper: Keeper | None = None,
    ) -> SessionResult:
        """Render a session; ClusterError if a slave fails, and whatever a worker raises."""
        self._session, self._progress, self._display, self._result = session, progress, display, None
        self._keeper = keeper
        self._master.handle(m.Begin(session))
        while self._result is None:
            if not self._step() and not self._wait_for_tasks():
                raise AssertionError(f"the cluster waits for nothing in phase {self._master.state.phase.value}")
        self._session = None
        return self._result

    def _step(self) -> bool:
        """Make one delivery, and have the receiver take it in; False if there was none."""
        channel = self._post.deliver()
        if channel is None:
            return False
        slave = self._slaves.get(channel.receiver)
        if slave is None:
            self._master.receive()
            return True
        slave.receive()
        if slave.error is not None:
            raise ClusterError(f"slave {slave.state.number}: {slave.error}")
        return True

    def _wait_for_tasks(self) -> bool:
        """Take in what came of tasks that other processes are at; False if there are none."""
        busy = [network for network, compute in self._computes.items() if compute.under_way]
        for network in busy:
            for outcome in self._computes[network].wait():
                self._slaves[network].handle(s.Computed(outcome))
        return bool(busy)

    def close(self) -> None:
        """End all processes; may be called again."""
        for compute in self._computes.values():
            compute.stop()

    def _answer(self, instruction: m.Instruction) -> None:
        tell_display(instruction, self._display)
        tell_keeper(instruction, self._keeper)
        match instruction:
            case m.MakePartition(cell):
                if self._session is None:
                    raise AssertionError("a partition was asked for outside a session")
                self._master.handle(m.PartitionMade(cell, self._session.partition(cell)))
            case m.Finished(result):
                self._result = result
            case m.Broken(reason):
                raise ClusterError(reason)
            case _:
                tell_observer(instruction, self._progress)

    def _submit(self, network: MemoryNetwork, job: Job) -> None:
        """Have a slave's job done when its turn comes."""

        # A worker that raises ends the render with its own exception: here nothing needs to cross a wire.
        def do() -> None:
            outcome = self._computes[network].start(job)
            if outcome is not None:
                self._slaves[network].handle(s.Computed(outcome))

        self._post.put(Channel(network, network), do)


def run(
    session: Session,
    workers: Sequence[Worker],
    progress: ProgressObserver | None = None,
    *,
    limits: ClusterLimits | None = None,
    shuffle: random.Random | None = None,
) -> SessionResult:
    """Render a session with workers that are built already; `session.partition` is not called.

    Args:
        workers: by number.
        shuffle: shuffles deliveries and jobs, for tests that order does not matter.
    """
    cluster = MemoryCluster(lambda number, *_: workers[number], len(workers), limits=limits, shuffle=shuffle)
    return cluster.render(replace(session, partition=lambda _: NO_TRIANGLES), progress)
