"""What lies between a slave's state machine and a network: messages come in as events, instructions go out.

`SlaveShell` takes what has come when it is told to; `SlaveLoop` waits for it, and has a clock.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable

from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave.account import Account
from wdpm.cluster.slave.computer import ComputeThread, why_unfit
from wdpm.cluster.slave.deliveries import MASTER, Deliveries
from wdpm.cluster.slave.job_queue import HOLD_S
from wdpm.cluster.slave.jobs import Job
from wdpm.cluster.slave.machine import Slave
from wdpm.cluster.slave.vital_signs import VitalSigns
from wdpm.cluster.transport.transport import (
    TURN_MESSAGES,
    TURN_S,
    TURNS_A_HEARTBEAT,
    Connection,
    Listener,
    Network,
    Received,
    Role,
)
from wdpm.scenes.errors import ClusterEndedError, ClusterError, MasterLostError, ProtocolError

FROM_MASTER = packing.by_name(protocol.FromMaster)
FROM_PEER = packing.by_name(protocol.FromPeer)

PEER_ANSWER = packing.by_name(protocol.ToPeer)
"""What comes over a connection to a peer; its own messages come over the one that it makes."""

Tell = Callable[[str], None]
"""Shows a line to a person."""

Clock = Callable[[], float]
"""Seconds, growing."""


class SlaveShell:
    """Carries events to the state machine and instructions from it.

    Args:
        listener: where peers reach the slave.
        master: resolved address of the master.
        submit: has the worker do a job.
        tell: shows a line to a person.
        clock: what the state machine takes for the time [s].
        account: is told of jobs and messages; None where nobody asks, as in a cluster of one process.
        run_here: does a short job at once; None where `submit` is to have all.

    Attributes:
        error: why the slave has ended, if that is a failure ...
        failed_elsewhere: ... and whether that was not its own.
        turn_s: how long it may sleep while nothing comes and nothing waits [s].
    """

    def __init__(
        self,
        state: Slave,
        network: Network,
        listener: Listener,
        master: str,
        submit: Callable[[Job], None],
        tell: Tell,
        clock: Clock = time.monotonic,
        account: Account | None = None,
        run_here: Callable[[Job], s.Event] | None = None,
    ) -> None:
        self.state = state
        self.error: str | None = None
        self.failed_elsewhere = False
        self.turn_s = TURN_S
        self._network = network
        self._listener = listener
        self._master_address = master
        self._submit = submit
        self._tell = tell
        self._clock = clock
        self._account = account
        self._run_here = run_here
        self._deliveries = Deliveries()
        self._identity = uuid.uuid4().bytes
        self._peers: dict[int, Connection] = {}
        self._endpoints: dict[int, str] = {}
        self._master = self._connect_master()

    def receive(self) -> bool:
        """Take in messages that have come; whether there were any of peers."""
        self._receive_from_master()
        came = self._receive_from_peers()
        if self._network.stirred:
            self._receive_answers()
        return came

    def find_broken_connections(self) -> None:
        """Tell the state machine who is lost."""
        if self._master.reached():
            self.handle(s.MasterReached())
        if self._master.broke():
            # Its last words come before the news that it hung up.
            self._receive_from_master()
            self.handle(s.MasterLost())
        if self._master.refused():
            self.handle(s.MasterRefused())
        if not self._network.stirred:
            return
        for number, connection in list(self._peers.items()):
            # What is done about one may be a short job, whose rays find that another is gone.
            if self._peers.get(number) is connection and connection.broke():
                self._lose_peer(number)

    def look_at_deliveries(self) -> None:
        """Tell peers what has come of theirs, and the state machine over which connections nothing comes any more."""
        now = self._clock()
        for identity, answer in self._deliveries.answers(now):
            self._listener.send(identity, answer)  # one that is gone needs none
        for number, reason in self._deliveries.stuck(now):
            if number == MASTER:
                self.handle(s.MasterLost(reason))
            elif number in self._peers:  # or what was done about another one has closed it
                self._lose_peer(number, reason)

    def sleep_s(self) -> float:
        """How long it may sleep now, if nothing comes [s]."""
        wake_at = self.state.wake_at
        return self.turn_s if wake_at is None else min(self.turn_s, max(0.0, wake_at - self._clock()))

    def rest_s(self, came: bool) -> float:
        """How long messages may lie where they are, though there be some, since none is wanted before that [s].

        Each that wakes this thread takes the interpreter from the one that computes, and a core, and finds the caches
        full of other things: several that are taken in at once take much less.

        Args:
            came: whether messages of peers have come in this turn.
        """
        if self.state.wake_at is not None:
            return max(0.0, self.state.wake_at - self._clock())
        return HOLD_S if came and self.state.computes else 0.0

    def wake(self) -> None:
        """Wake the state machine, if it waits for this time."""
        wake_at = self.state.wake_at
        if wake_at is not None and self._clock() >= wake_at:
            self.handle(s.Wake())

    def handle(self, event: s.Event) -> None:
        """Tell the state machine, and do what it says."""
        now = self._clock()
        if self._account is not None and isinstance(event, s.Computed):
            self._account.ended(event.outcome.job, now)
        for instruction in self.state.handle(event, now):
            self._obey(instruction)
        if self._account is not None:
            self._account.idling.sent(self._clock())

    def tell_master(self, message: protocol.FromSlave) -> None:
        """Send the master a message. If the connection is gone, `find_broken_connections` will hear of it."""
        if self._account is not None:
            message = self._account.attach_to(message)
        before = self._network.carried.sent
        self._master.send(self._deliveries.to_master(message))
        self._deliveries.sent_to_master(message, self._network.carried.sent - before)

    def close(self) -> None:
        """Let go of all connections."""
        self._master.close(deliver=True)
        for connection in self._peers.values():
            connection.close(deliver=False)

    def _receive_from_master(self) -> None:
        for _ in range(TURN_MESSAGES):
            message = self._master.receive()
            if message is None:
                return
            if isinstance(message, ProtocolError):
                self.handle(s.Unreadable(None, str(message)))
            else:
                if isinstance(message, protocol.Welcome):
                    self.turn_s = max(TURN_S, message.heartbeat_s / TURNS_A_HEARTBEAT)
                self._deliveries.master_said(message)
                self.handle(s.MasterSaid(message))

    def _receive_from_peers(self) -> bool:
        came = False
        for _ in range(TURN_MESSAGES):
            received = self._next_of_peers()
            if received is None:
                break
            came = True
            identity, message = received
            if isinstance(message, ProtocolError):
                self.handle(s.Unreadable(identity, str(message)))
            else:
                if isinstance(message, protocol.PeerBatches):
                    self._deliveries.peer_said(identity)
                self.handle(s.PeerSaid(identity, message, more=True))
        if came:
            self.handle(s.Wake())
        return came

    def _next_of_peers(self) -> tuple[bytes, Received] | None:
        before = self._network.carried.received
        received = self._listener.receive()
        if self._account is not None and received is not None and isinstance(received[1], protocol.PeerBatches):
            self._account.sent.came(self._network.carried.received - before)
        return received

    def _receive_answers(self) -> None:
        for number, connection in list(self._peers.items()):
            if self._peers.get(number) is not connection:  # lost by what was done about another's answer
                continue
            message = connection.receive()
            if isinstance(message, ProtocolError):
                self.handle(s.PeerAnswered(number, protocol.Rejected(f"what cannot be read ({message})")))
            elif isinstance(message, protocol.PeerReceived):
                self._deliveries.peer_told(number, message)
            elif message is not None:
                self.handle(s.PeerAnswered(number, message))

    def _obey(self, instruction: s.Instruction) -> None:
        match instruction:
            case s.ToPeer(number, message):
                self._send_to_peer(number, message)
            case s.Run(job, short):
                if self._account is not None:
                    self._account.idling.started(job, self._clock())
                if short and self._run_here is not None:
                    self.handle(self._run_here(job))  # the last instruction: nothing waits for it
                else:
                    self._submit(job)
            case s.ToMaster(message):
                self.tell_master(message)
            case s.ConnectPeers(peers):
                self._connect_peers(dict(peers))
            case s.AnswerPeer(identity, message):
                if isinstance(message, protocol.PeerWelcome):
                    self._listener.admit(identity)
                    self._deliveries.greeted(identity)
                if self._account is not None:
                    self._account.sent.add(message)
                self._listener.send(identity, message)  # a stranger that is gone needs no answer
            case s.Reconnect(fresh):
                self._master.close(deliver=False)
                self._identity = uuid.uuid4().bytes if fresh else self._identity
                self._master = self._connect_master()
            case s.Tell(text):
                self._tell(text)
            case s.Exit(error, elsewhere):
                self.error, self.failed_elsewhere = error, elsewhere

    def _send_to_peer(self, number: int, message: protocol.FromPeer) -> None:
        connection = self._peers.get(number)
        if connection is None:
            return  # lost before, and the master knows
        before = self._network.carried.sent
        delivered = connection.send(message)
        size = self._network.carried.sent - before
        self._deliveries.sent_to_peer(number, message, size)
        if self._account is not None:
            self._account.sent.add(message, size)
        if not delivered:
            self._lose_peer(number)

    def _lose_peer(self, number: int, reason: str = "") -> None:
        self._close_peer(number, deliver=False)
        self.handle(s.PeerLost(number, reason))

    def _close_peer(self, number: int, *, deliver: bool) -> None:
        self._peers.pop(number).close(deliver=deliver)
        self._deliveries.forget_peer(number)

    def _connect_master(self) -> Connection:
        # The same identity again, so that a second connection is known for the same slave.
        return self._network.connect(self._master_address, Role.MASTER, FROM_MASTER, self._identity)

    def _connect_peers(self, peers: dict[int, str]) -> None:
        for number in [number for number in self._peers if peers.get(number) != self._endpoints[number]]:
            self._close_peer(number, deliver=True)
        for number, endpoint in peers.items():
            if number in self._peers:
                continue
            try:
                self._peers[number] = self._network.connect(endpoint, Role.SLAVE, PEER_ANSWER)
                self._endpoints[number] = endpoint
            except ClusterError as error:
                self.handle(s.PeerAnswered(number, protocol.Rejected(str(error))))


class SlaveLoop:
    """What a slave's thread runs until the state machine says Exit.

    Args:
        life_line: file descriptor of a pipe whose other end the process that started the slave holds; None for none.
    """

    def __init__(self, shell: SlaveShell, network: Network, computer: ComputeThread, life_line: int | None) -> None:
        self._shell = shell
        self._network = network
        self._computer = computer
        self._life_line = life_line
        self._vital_signs = VitalSigns(network.carried, time.monotonic())
        network.watch(computer.mailbox.fd)
        if life_line is not None:
            network.watch(life_line)

    def run(self) -> None:
        """Bring events, carry out instructions; ClusterError if the end is a failure."""
        shell = self._shell
        self._computer.start()
        try:
            self._turns()
        except KeyboardInterrupt:
            shell.handle(s.Leave("it was interrupted"))
            raise
        except Exception as error:
            if (unfit := why_unfit(error)) is None:  # a fault of the program: the master should not have to guess
                shell.tell_master(protocol.Failed(f"{type(error).__name__}: {error}"))
                raise
            shell.handle(s.Leave(unfit))
        finally:
            self._computer.stop()
        if shell.error is not None:
            raise self._error_of(shell)

    def _error_of(self, shell: SlaveShell) -> ClusterError:
        if not shell.failed_elsewhere:
            return ClusterError(shell.error)
        # A slave that has joined has been told of the end; otherwise it was looking for its master again.
        return ClusterEndedError(shell.error) if shell.state.number >= 0 else MasterLostError(shell.error)

    def _turns(self) -> None:
        shell = self._shell
        ticked = 0.0
        came = False
        shell.handle(s.Start())
        while not shell.state.ended:
            if (rest_s := shell.rest_s(came)) > 0.0:
                self._network.rest(rest_s)
            ready = self._network.wait(shell.sleep_s())
            if self._life_line in ready:
                shell.handle(s.Leave("the process that started it has ended"))
            for event in self._computer.mailbox.take():
                shell.handle(event)
            came = shell.receive()
            shell.find_broken_connections()
            shell.wake()
            now = time.monotonic()
            if now - ticked >= shell.turn_s:
                ticked = now
                shell.handle(s.Tick())
                shell.look_at_deliveries()
                if shell.state.number >= 0 and (vitals := self._vital_signs.due(now)) is not None:
                    shell.tell_master(vitals)
