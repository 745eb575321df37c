"""The shell of the master: a ROUTER, a clock, and the state machine of `master` between them.

A thread owns the socket and the state, so that heartbeats go on while the caller computes a partition, or thinks.
Partitions and progress are the caller's thread's business: `render` waits there, and Ctrl-C reaches it.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from types import TracebackType
from typing import Self

import zmq

from wdpm.cluster.cluster_settings import ClusterSettings
from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Master
from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.progress import Progress, report
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.transport import address, keys
from wdpm.cluster.transport.zmq_sockets import (
    POLL_MS,
    TURN_MESSAGES,
    Mailbox,
    Socket,
    bind,
    make_socket,
    read,
    receive,
    send,
)
from wdpm.cluster.versions import versions
from wdpm.scenes.errors import ClusterError, ProtocolError

FROM_SLAVE = packing.by_name(protocol.FromSlave)

SEE_OFF_S = 5.0
"""How long a master that ends waits for the Goodbye of slaves that it has told to stop; they answer at once."""

Watch = Callable[[], Iterable[tuple[int, str]]]
"""Local slave processes that have ended: (process number, why)."""


def nobody() -> Iterable[tuple[int, str]]:
    """Watches no process."""
    return ()


class SocketMaster:
    """A master that listens at an address; renders any number of sessions with the slaves that join.

    Args:
        listen_at: tcp://HOST:PORT; port 0 takes a free one.
        slaves: how many it waits for.
        security: keys of the cluster, or None.
        watch: tells of slave processes that were started here and have ended.
        agreed: what slaves must have in common with it; None for this process's versions.

    Raises:
        ClusterError: it cannot listen there.
    """

    def __init__(
        self,
        listen_at: str,
        slaves: int,
        *,
        security: keys.Keys | None = None,
        settings: ClusterSettings | None = None,
        watch: Watch = nobody,
        agreed: Mapping[str, str] | None = None,
    ) -> None:
        self._slaves = slaves
        self._told_to_wait = False
        self._closed = False
        self._answers: queue.SimpleQueue[m.Instruction | BaseException] = queue.SimpleQueue()
        self._stack = ExitStack()
        try:
            context = self._stack.enter_context(zmq.Context())
            self._stack.enter_context(keys.admission(context, security))
            router = self._stack.enter_context(make_socket(context, zmq.ROUTER))
            router.router_mandatory = True  # a message to a slave that is gone is an error instead of nothing
            router.router_handover = True  # a slave that had to connect again is the same slave
            if security is not None:
                keys.serve(router, security.master)
            self.endpoint = _listen(router, listen_at)
            self._mailbox = Mailbox()
            self._stack.callback(self._mailbox.close)
            state = Master(slaves, versions() if agreed is None else agreed, settings)
            self._loop = _Loop(state, router, self._mailbox, watch, self._answers)
            self._thread = threading.Thread(target=self._loop.run, name="wdpm master", daemon=True)
            self._thread.start()
        except BaseException:
            self._stack.close()
            raise

    @property
    def dropped(self) -> dict[str, int]:
        """Messages that were not used so far, by reason."""
        return self._loop.state.dropped

    def render(self, session: Session, progress: Progress | None = None) -> SessionResult:
        """Render a session as soon as all slaves have joined.

        Raises:
            ClusterError: the cluster has ended because of an error, and cannot be used any more.
        """
        if self._closed:
            raise ClusterError("the cluster has been closed; start another")
        try:
            if progress is not None and not self._told_to_wait:
                self._told_to_wait = True
                progress.note(f"waiting for {self._slaves} slaves at {self.endpoint}")
            self._mailbox.put(m.Begin(session))
            return self._follow(session, progress)
        except BaseException as error:
            self.close(f"the master was interrupted ({type(error).__name__})")
            raise

    def _follow(self, session: Session, progress: Progress | None) -> SessionResult:
        while True:
            match self._answers.get():
                case m.Finished(result):
                    return result
                case m.Broken(reason):
                    raise ClusterError(reason)
                case m.MakePartition(cell):
                    self._mailbox.put(m.PartitionMade(cell, session.partition(cell)))
                case BaseException() as error:
                    raise error
                case m.Send():
                    raise AssertionError("the loop sends by itself")
                case other:
                    report(other, progress)

    def close(self, reason: str = "all is rendered") -> None:
        """Have all slaves stop, and let go of the sockets; may be called again."""
        if self._closed:
            return
        self._closed = True
        if self._thread.is_alive():
            self._mailbox.put(m.Close(reason))
            self._thread.join()
        self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close("all is rendered" if error is None else f"the master was interrupted ({type(error).__name__})")


class _Loop:
    """What the master's thread runs until the cluster ends."""

    def __init__(
        self,
        state: Master,
        router: Socket,
        mailbox: Mailbox,
        watch: Watch,
        answers: queue.SimpleQueue[m.Instruction | BaseException],
    ) -> None:
        self.state = state
        self._router = router
        self._mailbox = mailbox
        self._watch = watch
        self._answers = answers
        self._closing = False
        self._ticked = 0.0
        self._poller = zmq.Poller()
        self._poller.register(router, zmq.POLLIN)
        self._poller.register(mailbox.fd, zmq.POLLIN)

    def run(self) -> None:
        """Bring events, carry out instructions."""
        try:
            while not self._closing:
                self._turn()
            # ZeroMQ throws away what a slave has not yet read when the connection ends: the last words have to be
            # answered before the socket closes.
            deadline = time.monotonic() + SEE_OFF_S
            while not self.state.all_left and time.monotonic() < deadline:
                self._turn()
        except BaseException as error:  # whoever waits in `render` must hear of it, whatever it is
            for instruction in self.state.handle(m.Abort(f"the master failed: {error}"), time.monotonic()):
                if isinstance(instruction, m.Send):
                    self._send(instruction)
            self._answers.put(error)

    def _turn(self) -> None:
        self._poller.poll(POLL_MS)
        for event in self._mailbox.take():
            self._closing = self._closing or isinstance(event, m.Close)
            self._handle(event)
        self._receive()
        now = time.monotonic()
        if now - self._ticked >= POLL_MS / 1000:
            self._ticked = now
            for process, reason in self._watch():
                self._handle(m.ProcessEnded(process, reason))
            self._handle(m.Tick())

    def _receive(self) -> None:
        for _ in range(TURN_MESSAGES):
            frames = receive(self._router)
            if frames is None:
                return
            identity = bytes(frames[0])
            message = read(frames[1:], FROM_SLAVE)
            if isinstance(message, ProtocolError):
                self._handle(m.Unreadable(identity, str(message)))
            else:
                self._handle(m.SlaveSaid(identity, message))

    def _handle(self, event: m.Event) -> None:
        lost: list[bytes] = []
        for instruction in self.state.handle(event, time.monotonic()):
            if not isinstance(instruction, m.Send):
                self._answers.put(instruction)
            elif not self._send(instruction):
                lost.append(instruction.identity)
        for identity in lost:
            self._handle(m.SlaveLost(identity, "its connection is gone; it may have died"))

    def _send(self, instruction: m.Send) -> bool:
        """Whether the message could be sent."""
        try:
            send(self._router, instruction.message, instruction.identity)
        except zmq.ZMQError as error:
            if error.errno != zmq.EHOSTUNREACH:
                raise
            return False
        return True


def _listen(router: Socket, where: str) -> str:
    resolved = address.resolve(where)
    number, port = address.split(resolved)
    try:
        return bind(router, address.join(number, port or "*"))
    except zmq.ZMQError as error:
        if error.errno == zmq.EADDRINUSE:
            raise ClusterError(f"cannot listen at {where}: another program uses port {port}; choose another") from None
        reason = f"{error.strerror}; it must be an address of this machine"
        raise ClusterError(f"cannot listen at {where}: {reason}") from None
