"""A cluster in simulated time.

Its master and slaves are the true ones: state machines that touch no clock and no socket. What they have computed is
computed, by the true workers, one job after another in this process; the processor's seconds that each job takes are
measured, and are what it takes in simulated time on its machine. Messages are packed and unpacked, which is measured
too, and go over links of a description. So what is simulated is time and wires alone: who is handed what, which batches
are joined, how many messages are sent and how large is what this very cluster would do, and the image has its bits.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from wdpm.bench.simulation.clock import Clock
from wdpm.bench.simulation.machines import Link, Machine, Thread
from wdpm.bench.simulation.message_costs import MessageCosts
from wdpm.bench.simulation.records import SETTING_UP, JobRecord, Recorder, Spent
from wdpm.cluster.in_process import MASTER
from wdpm.cluster.master import events as m
from wdpm.cluster.master.loop import FROM_SLAVE, MasterShell
from wdpm.cluster.master.machine import Master
from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.messages.frames import Frame
from wdpm.cluster.messages.protocol import Message
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave.job_queue import HOLD_S
from wdpm.cluster.slave.jobs import Compute, Job, WorkerFactory
from wdpm.cluster.slave.loop import FROM_MASTER, FROM_PEER, PEER_ANSWER, SlaveShell
from wdpm.cluster.slave.machine import Slave
from wdpm.cluster.transport.memory import Channel, MemoryTransport
from wdpm.cluster.transport.transport import Role
from wdpm.scenes.errors import ClusterError

KNOWN = {**FROM_SLAVE, **FROM_PEER, **PEER_ANSWER, **FROM_MASTER}
"""Messages that any of them unpacks."""


@dataclass(frozen=True)
class Hardware:
    """What a cluster is to run on.

    Attributes:
        slaves: how many, of one thread each.
        machines: over which they are spread in turn; the master is on the first one.
        cores: of each machine.
        link: that joins machines.
        messages: what they cost processors.
        apart: whether there is no slave on the first machine, which is the master's.
    """

    slaves: int
    machines: int
    cores: float
    link: Link
    messages: MessageCosts
    apart: bool = False


@dataclass
class Post:
    """A message on its way out of somebody."""

    channel: Channel
    size: int
    frames: list[Frame]
    deliver: Callable[[], None]


@dataclass(eq=False)
class Process:
    """A master or slave on a machine: the thread of its loop, that of ZeroMQ, and that on which it computes.

    Attributes:
        take_in: has it take in what has arrived.
        wake, wake_at: wakes it, and when it wants to be woken, if it does.
    """

    machine: Machine
    loop: Thread
    carrier: Thread
    compute: Thread
    take_in: Callable[[], object] = lambda: None
    wake: Callable[[], None] = lambda: None
    wake_at: Callable[[], float | None] = lambda: None
    arrived: list[list[Frame]] = field(default_factory=list)
    awake: bool = False


class SimulatedCluster:
    """A master and its slaves in simulated time; renders any number of sessions.

    Args:
        make_worker: makes the compute object of each slave.

    Attributes:
        clock: simulated time goes on from session to session.
        recorder: what was computed and sent in the last session.
    """

    def __init__(self, make_worker: WorkerFactory, hardware: Hardware) -> None:
        self.clock = Clock()
        self.recorder = Recorder()
        self._costs = hardware.messages
        self._machines = [Machine(self.clock, hardware.cores, hardware.link) for _ in range(hardware.machines)]
        self._leaving: list[Post] = []
        self._decided: list[Callable[[], None]] = []  # what begins when the turn is over
        self._processes: dict[object, Process] = {}
        self._slaves: list[tuple[Process, SlaveShell]] = []
        self._session: Session | None = None
        self._result: SessionResult | None = None
        self._transport = MemoryTransport(self._carry)
        network = self._transport.open(None)
        listener = network.listen(MASTER, Role.MASTER, FROM_SLAVE)
        state = Master(hardware.slaves, {}, cores={"machine 0": max(int(hardware.cores), 1)})
        self._master_shell = MasterShell(state, listener, self._answer, clock=lambda: self.clock.now, later=self._later)
        self._master = self._processes[network] = self._process(self._machines[0])
        self._master.take_in = self._master_shell.receive
        places = self._machines[1:] if hardware.apart else self._machines
        for number in range(hardware.slaves):
            self._add_slave(number, make_worker, places[number % len(places)])
            while self.clock.step():  # they join one by one, so that numbers are places in the list
                pass

    def _process(self, machine: Machine) -> Process:
        loop, carrier, compute = (Thread(machine.processor) for _ in range(3))
        return Process(machine, loop, carrier, compute)

    def _add_slave(self, number: int, make_worker: WorkerFactory, machine: Machine) -> None:
        network = self._transport.open(None)
        listener = network.listen(network.address_for_peers(MASTER), Role.SLAVE, FROM_PEER)
        hello = protocol.Hello({}, f"machine {self._machines.index(machine)}", number, 1, 0, listener.endpoint, 1)
        state = Slave(hello, "memory", patience=float("inf"), hold_s=HOLD_S)
        process = self._processes[network] = self._process(machine)
        compute = Compute(make_worker)

        def submit(job: Job) -> None:
            self._submit(number, process, shell, compute, job)

        shell = SlaveShell(state, network, listener, MASTER, submit, tell=lambda _: None, clock=lambda: self.clock.now)
        process.take_in, process.wake = shell.receive, shell.wake
        process.wake_at = lambda: state.wake_at
        self._slaves.append((process, shell))
        self._have(process, lambda: shell.handle(s.Start()))

    def render(self, session: Session) -> SessionResult:
        """Render a session; ClusterError if a slave fails, and whatever a worker raises."""
        self._session, self._result = session, None
        self.recorder = Recorder()
        self.recorder.phase(SETTING_UP, self.clock.now, self._spent())
        self._have(self._master, lambda: self._master_shell.handle(m.Begin(session)))
        while self._result is None:
            if not self.clock.step():
                raise AssertionError(f"the cluster waits for nothing in phase {self._master_shell.state.phase.value}")
            self._check()
        self.recorder.phase("", self.clock.now, self._spent())
        self._session = None
        return self._result

    def _spent(self) -> Spent:
        processes, master = [process for process, _ in self._slaves], self._master
        return Spent(
            tuple(process.compute.busy_s for process in processes),
            tuple(process.loop.busy_s + process.carrier.busy_s for process in processes),
            master.loop.busy_s + master.carrier.busy_s + master.compute.busy_s,
            tuple(machine.wire_s for machine in self._machines),
        )

    def _check(self) -> None:
        for _, shell in self._slaves:
            if shell.error is not None:
                raise ClusterError(f"slave {shell.state.number}: {shell.error}")

    # Messages.

    def _carry(self, channel: Channel, message: Message, delivery: Callable[[], None]) -> None:
        """Somebody sends, in the course of a turn of its loop: the message leaves when that is over."""
        frames = packing.encode(message)
        self._leaving.append(Post(channel, sum(memoryview(frame).nbytes for frame in frames), frames, delivery))
        self.recorder.message(type(message).__name__, self._leaving[-1].size)

    def _have(self, process: Process, turn: Callable[[], None]) -> None:
        """Have a loop do something; what it sends leaves afterwards."""

        def work() -> tuple[float, Callable[[], None]]:
            self._leaving, self._decided = [], []
            began = time.thread_time()
            arrived, process.arrived = process.arrived, []
            for frames in arrived:
                packing.decode(frames, KNOWN)
            turn()
            seconds = time.thread_time() - began
            leaving, decided = self._leaving, self._decided
            seconds += self._costs.call_s * (len(arrived) + len(leaving))
            return seconds, lambda: self._end_turn(process, leaving, decided)

        process.loop.submit(work)

    def _end_turn(self, process: Process, leaving: Sequence[Post], decided: Sequence[Callable[[], None]]) -> None:
        self._send(process, leaving)
        for begin in decided:
            begin()
        wake_at = process.wake_at()
        if wake_at is not None:
            self.clock.after(wake_at - self.clock.now, lambda: self._wake(process, wake_at))

    def _wake(self, process: Process, at: float) -> None:
        """Wake a process, unless it waits for nothing any more, or for another one."""
        if process.wake_at() == at:
            self._have(process, process.wake)

    def _send(self, process: Process, leaving: Sequence[Post]) -> None:
        for post in leaving:
            receiver = self._processes[post.channel.receiver]
            seconds = self._costs.carrying(post.size)
            there = self._delivery(receiver, post, seconds)

            def gone(receiver: Process = receiver, post: Post = post, there: Callable[[], None] = there) -> None:
                process.machine.send(receiver.machine, post.size, there)

            process.carrier.submit(lambda seconds=seconds, gone=gone: (seconds, gone))  # type: ignore[misc]

    def _delivery(self, receiver: Process, post: Post, seconds: float) -> Callable[[], None]:
        def wake() -> None:
            post.deliver()
            receiver.arrived.append(post.frames)
            if not receiver.awake:
                receiver.awake = True
                self._have(receiver, take_in)

        def take_in() -> None:
            receiver.awake = False
            receiver.take_in()

        return lambda: receiver.carrier.submit(lambda: (seconds, wake))

    # Jobs and what the master asks of its own process.

    def _submit(self, number: int, process: Process, shell: SlaveShell, compute: Compute, job: Job) -> None:
        """Have a slave compute a job once the turn is over in which it was decided on."""

        def work() -> tuple[float, Callable[[], None]]:
            began = time.thread_time()
            outcome = compute.run(job)
            seconds = time.thread_time() - began
            self.recorder.job(JobRecord.of(self.clock.now, number, job, outcome, seconds))
            return seconds, lambda: self._have(process, lambda: shell.handle(s.Computed(outcome, seconds)))

        self._decided.append(lambda: process.compute.submit(work))

    def _partition(self, session: Session, cell: int) -> None:
        """Find the triangles of a cell, on the thread that asked for the image."""

        def work() -> tuple[float, Callable[[], None]]:
            began = time.thread_time()
            made = m.PartitionMade(cell, session.partition(cell))
            return time.thread_time() - began, lambda: self._have(self._master, lambda: self._master_shell.handle(made))

        self._decided.append(lambda: self._master.compute.submit(work))

    def _later(self, do: Callable[[], None]) -> None:
        """Have the master do something in a turn of its own."""
        self._decided.append(lambda: self._have(self._master, do))

    def _finish(self, result: SessionResult) -> None:
        self._result = result

    def _answer(self, instruction: m.Instruction) -> None:
        match instruction:
            case m.MakePartition(cell):
                if self._session is None:
                    raise AssertionError("a partition was asked for outside a session")
                self._partition(self._session, cell)
            case m.Started(phase, _):
                self.recorder.phase(phase, self.clock.now, self._spent())
            case m.Finished(result):
                self._decided.append(lambda: self._finish(result))
            case m.Broken(reason):
                raise ClusterError(reason)
