"""The shell of a slave: its sockets, a clock, and the state machine of `slave` between them.

The calling thread owns the sockets: a DEALER to the master, a ROUTER for its peers, a DEALER to each peer. One other
thread computes, so that heartbeats go on during long kernels.
"""

from __future__ import annotations

import os
import platform
import queue
import sys
import threading
import time
import traceback
import uuid
from collections.abc import Callable, Mapping
from contextlib import ExitStack

import zmq
from zmq.utils.monitor import recv_monitor_message

from wdpm.cluster.cluster_settings import ClusterSettings
from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave.jobs import Compute, Job, WorkerFactory
from wdpm.cluster.slave.machine import Slave
from wdpm.cluster.transport import address, keys
from wdpm.cluster.transport.zmq_sockets import (
    POLL_MS,
    TURN_MESSAGES,
    Mailbox,
    Socket,
    bind,
    connect,
    make_socket,
    read,
    receive,
    send,
)
from wdpm.cluster.versions import versions
from wdpm.scenes.errors import ClusterError, ProtocolError, WdpmError

FROM_MASTER = packing.by_name(protocol.FromMaster)
FROM_PEER = packing.by_name(protocol.FromPeer)

LEAVE_S = 1.0
"""How long a slave that ends waits for the worker's last job."""

PATIENCE_S = 60.0
"""How long a slave waits for a master's first answer unless told otherwise: people start slaves first, too."""

Tell = Callable[[str], None]


def run_slave(
    master: str,
    make_worker: WorkerFactory,
    *,
    threads: int = 1,
    memory: int | None = None,
    security: keys.Keys | None = None,
    patience: float = PATIENCE_S,
    life_line: int | None = None,
    tell: Tell | None = None,
    settings: ClusterSettings | None = None,
    agreed: Mapping[str, str] | None = None,
) -> None:
    """Compute for a master until it says stop.

    Args:
        master: tcp://HOST:PORT.
        threads: cores, as told to the master.
        memory: main memory that it may use, as told to the master [bytes]; None for the machine's.
        patience: how long it waits for the master's first answer [s].
        life_line: file descriptor of a pipe whose other end the process that started it holds; when that closes,
            it ends.
        tell: shows a line to a person; None for standard error.

    Raises:
        ClusterError: no master answered, it refused, or something failed.
    """
    resolved = address.resolve(master)
    with ExitStack() as stack:
        shell = _Shell(stack, resolved, make_worker, security, life_line, tell or _to_stderr)
        hello = protocol.Hello(
            dict(versions() if agreed is None else agreed),
            platform.node() or "unknown",
            os.getpid(),
            threads,
            machine_memory() if memory is None else memory,
            shell.endpoint,
        )
        shell.run(Slave(hello, master, patience, settings))


def machine_memory() -> int:
    """Main memory of this machine [bytes]."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _to_stderr(text: str) -> None:
    print(f"wdpm slave: {text}", file=sys.stderr, flush=True)


class _Connection:
    """A DEALER to someone, and the socket on which ZeroMQ tells that it broke."""

    def __init__(self, context: zmq.Context[Socket], security: keys.Keys | None, server: bytes | None) -> None:
        self.socket = make_socket(context, zmq.DEALER)
        self.monitor: Socket = self.socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        if security is not None and server is not None:
            keys.connect(self.socket, security.slave, server)

    def broke(self) -> bool:
        """Whether the connection has been closed by the other end since this was last asked."""
        if not self.monitor.poll(0):
            return False
        recv_monitor_message(self.monitor)
        return True

    def close(self, linger: int | None = None) -> None:
        self.socket.disable_monitor()
        self.monitor.close(linger=0)
        self.socket.close(linger)


class _Shell:
    """Carries events to the state machine and instructions from it."""

    def __init__(
        self,
        stack: ExitStack,
        master: str,
        make_worker: WorkerFactory,
        security: keys.Keys | None,
        life_line: int | None,
        tell: Tell,
    ) -> None:
        self._master_address = master
        self._security = security
        self._life_line = life_line
        self._tell = tell
        self._identity = uuid.uuid4().bytes
        self._error: str | None = None
        self._peers: dict[int, _Connection] = {}
        self._context: zmq.Context[Socket] = stack.enter_context(zmq.Context())
        stack.enter_context(keys.admission(self._context, security))
        self._router = stack.enter_context(make_socket(self._context, zmq.ROUTER))
        if security is not None:
            keys.serve(self._router, security.slave)
        self.endpoint = bind(self._router, address.join(address.interface_towards(master), "*"))
        self._master = self._connect_master()
        stack.callback(self._close_connections)
        self._mailbox = Mailbox()
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        computer = _Computer(Compute(make_worker), self._jobs, self._mailbox)
        self._thread = threading.Thread(target=computer.run, name="wdpm compute", daemon=True)

    def run(self, state: Slave) -> None:
        """Until the state machine says Exit; ClusterError if that is a failure."""
        self._thread.start()
        try:
            self._loop(state)
        except KeyboardInterrupt:
            self._handle(state, s.Leave("interrupted"))
            raise
        except Exception as error:  # a fault of the program: the master should not have to guess
            self._send_to_master(protocol.Failed(f"{type(error).__name__}: {error}"))
            raise
        finally:
            self._jobs.put(None)
            self._thread.join(LEAVE_S)
            # A long kernel or a compilation cannot be interrupted. It is left behind, to die with the process.
            if not self._thread.is_alive():
                self._mailbox.close()
        if self._error is not None:
            raise ClusterError(self._error)

    def _loop(self, state: Slave) -> None:
        poller = zmq.Poller()
        poller.register(self._router, zmq.POLLIN)
        poller.register(self._mailbox.fd, zmq.POLLIN)
        if self._life_line is not None:
            poller.register(self._life_line, zmq.POLLIN)
        ticked = 0.0
        self._handle(state, s.Start())
        while not state.ended:
            # The socket to the master may be another than the last time.
            poller.register(self._master.socket, zmq.POLLIN)
            ready = dict(poller.poll(POLL_MS))
            poller.unregister(self._master.socket)
            if self._life_line in ready:
                self._handle(state, s.Leave("the process that started it has ended"))
            for event in self._mailbox.take():
                self._handle(state, event)
            self._receive_from_master(state)
            self._receive_from_peers(state)
            now = time.monotonic()
            if now - ticked >= POLL_MS / 1000:
                ticked = now
                self._find_broken_connections(state)
                self._handle(state, s.Tick())

    def _receive_from_master(self, state: Slave) -> None:
        for _ in range(TURN_MESSAGES):
            frames = receive(self._master.socket)
            if frames is None:
                return
            message = read(frames, FROM_MASTER)
            if isinstance(message, ProtocolError):
                self._handle(state, s.Unreadable(None, str(message)))
            else:
                self._handle(state, s.MasterSaid(message))

    def _receive_from_peers(self, state: Slave) -> None:
        for _ in range(TURN_MESSAGES):
            frames = receive(self._router)
            if frames is None:
                return
            identity = bytes(frames[0])
            message = read(frames[1:], FROM_PEER)
            if isinstance(message, ProtocolError):
                self._handle(state, s.Unreadable(identity, str(message)))
            else:
                self._handle(state, s.PeerSaid(identity, message))

    def _find_broken_connections(self, state: Slave) -> None:
        if self._master.broke():
            # Its last words come before the news that it hung up.
            self._receive_from_master(state)
            self._handle(state, s.MasterLost())
        for number, connection in list(self._peers.items()):
            if connection.broke():
                self._lose_peer(state, number)

    def _lose_peer(self, state: Slave, number: int) -> None:
        self._peers.pop(number).close(0)
        self._handle(state, s.PeerLost(number))

    def _handle(self, state: Slave, event: s.Event) -> None:
        for instruction in state.handle(event, time.monotonic()):
            self._obey(state, instruction)

    def _obey(self, state: Slave, instruction: s.Instruction) -> None:
        match instruction:
            case s.ToPeer(number, message):
                self._send_to_peer(state, number, message)
            case s.Run(job):
                self._jobs.put(job)
            case s.ToMaster(message):
                self._send_to_master(message)
            case s.ConnectPeers(own, peers):
                self._connect_peers(own, peers)
            case s.AnswerStranger(identity, message):
                send(self._router, message, identity)  # a ROUTER drops what nobody takes
            case s.Reconnect():
                self._master.close(0)
                self._master = self._connect_master()
            case s.Tell(text):
                self._tell(text)
            case s.Exit(error):
                self._error = error

    def _send_to_master(self, message: protocol.FromSlave) -> None:
        try:
            send(self._master.socket, message)
        except zmq.Again:
            return  # the connection is gone; its monitor says so within a tick, and the state machine decides

    def _send_to_peer(self, state: Slave, number: int, message: protocol.FromPeer) -> None:
        connection = self._peers.get(number)
        if connection is None:
            return  # lost before, and the master knows
        try:
            send(connection.socket, message)
        except zmq.Again:
            self._lose_peer(state, number)

    def _connect_master(self) -> _Connection:
        server = None if self._security is None else self._security.master.public
        connection = _Connection(self._context, self._security, server)
        connection.socket.routing_id = self._identity  # so that a second connection is known for the same slave
        connect(connection.socket, self._master_address)
        return connection

    def _connect_peers(self, own: int, peers: tuple[str, ...]) -> None:
        for connection in self._peers.values():
            connection.close()
        self._peers = {}
        server = None if self._security is None else self._security.slave.public
        for number, endpoint in enumerate(peers):
            if number != own:
                connection = self._peers[number] = _Connection(self._context, self._security, server)
                connect(connection.socket, endpoint)

    def _close_connections(self) -> None:
        self._master.close()
        for connection in self._peers.values():
            connection.close(0)


class _Computer:
    """What the compute thread runs."""

    def __init__(self, compute: Compute, jobs: queue.SimpleQueue[Job | None], mailbox: Mailbox) -> None:
        self._compute = compute
        self._jobs = jobs
        self._mailbox = mailbox

    def run(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._mailbox.put(self._outcome(job))

    def _outcome(self, job: Job) -> s.Computed | s.ComputeFailed:
        try:
            return s.Computed(self._compute.run(job))
        except WdpmError as error:
            return s.ComputeFailed(str(error))
        except MemoryError:
            return s.ComputeFailed("it has not enough memory; use more slaves, or fewer photons or triangles")
        except Exception as error:  # a fault of the program: its place goes to the log here, one line to the master
            traceback.print_exc()
            return s.ComputeFailed(f"{type(error).__name__} in {type(job).__name__}: {error}")
