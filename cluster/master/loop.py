"""What lies between a master's state machine and a network: messages come in as events, instructions go out.

`MasterShell` takes what has come when it is told to; `MasterLoop` waits for it, and has a clock.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterable, Sequence

from wdpm.cluster.cluster_events import ClusterObserver
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.event_log import EventLog
from wdpm.cluster.master.machine import Master
from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.transport.mailbox import Mailbox
from wdpm.cluster.transport.receipts import Receipts, swallowed
from wdpm.cluster.transport.transport import TURN_MESSAGES, TURN_S, Carried, Listener, Network
from wdpm.scenes.errors import ProtocolError

FROM_SLAVE = packing.by_name(protocol.FromSlave | protocol.FromReader)

SEEN_S = 2.0
"""Between two words on what slaves take, to whoever looks at the image [s]."""

SEE_OFF_S = 5.0
"""How long a master that ends waits for the Goodbye of slaves that it has told to stop; they answer at once."""

Started = m.ProcessEnded | m.NotComing | m.StillAwaited
"""What becomes of slaves that were started here, or from here."""

Watch = Callable[[], Iterable[Started]]
"""Slaves that were started and have ended, or do not come, since this was last asked."""


class MasterShell:
    """Carries events to the state machine and messages from it.

    Args:
        listener: where slaves reach the master.
        answer: takes the instructions that are no messages to slaves, in order.
        observers: are told what happens.
        clock: what the state machine takes for the time [s].
        later: does something once what was sent is on its way.
        carried: counts the bytes of messages; None where none leave this process.
    """

    def __init__(
        self,
        state: Master,
        listener: Listener,
        answer: Callable[[m.Instruction], None],
        observers: Sequence[ClusterObserver] = (),
        clock: Callable[[], float] = time.monotonic,
        later: Callable[[Callable[[], None]], object] = lambda do: do(),
        carried: Carried | None = None,
    ) -> None:
        self.state = state
        self._listener = listener
        self._answer = answer
        self._event_log = EventLog(observers)
        self._clock = clock
        self._later = later
        self._carried = carried or Carried()
        self._receipts: Receipts[bytes] = Receipts()
        self._unreachable: set[bytes] = set()

    def receive(self) -> None:
        """Take in messages that have come; then who could not be reached before all was read is lost.

        Not sooner: the last words of such a slave, which say why it left, may have been waiting here unread.
        """
        for _ in range(TURN_MESSAGES):
            received = self._listener.receive()
            if received is None:
                self._lose()
                return
            identity, message = received
            if isinstance(message, ProtocolError):
                self.handle(m.Unreadable(identity, str(message)))
            else:
                self._note_receipt(identity, message)
                self.handle(m.SlaveSaid(identity, message))

    def _note_receipt(self, identity: bytes, message: protocol.FromSlave | protocol.FromReader) -> None:
        if isinstance(message, protocol.Heartbeat):
            self._receipts.told(identity, message.received)
        else:
            self._receipts.came(identity)

    def look_at_receipts(self, dead_s: float) -> None:
        """Slaves whom nothing reaches any more are lost.

        Args:
            dead_s: silence that counts as death [s].
        """
        for identity in self._receipts.stuck(self._clock(), dead_s):
            self._receipts.forget(identity)
            self.handle(m.SlaveLost(identity, swallowed("it", dead_s)))

    def handle(self, event: m.Event) -> None:
        """Tell the state machine, and do what it says.

        A slave that cannot be reached is not lost yet: its last words may be waiting here unread.
        """
        now = self._clock()
        instructions = self.state.handle(event, now)
        self._event_log.tell(event, instructions, now)
        for instruction in instructions:
            if isinstance(instruction, m.GoOnLater):
                continue
            if not isinstance(instruction, m.Send):
                self._answer(instruction)
                if isinstance(instruction, m.FrameBegun):
                    self._answer(m.SlavesSeen(self.state.seen()))
                continue
            self._send(instruction.identity, instruction.message)
        if any(isinstance(instruction, m.GoOnLater) for instruction in instructions):
            self._later(lambda: self.handle(m.GoOn()))

    def _send(self, identity: bytes, message: protocol.FromMaster | protocol.ToReader) -> None:
        before = self._carried.sent
        if isinstance(message, protocol.Welcome):
            self._listener.admit(identity)
        elif isinstance(message, protocol.Heartbeat):
            message = protocol.Heartbeat(self._receipts.have_come(identity))
        if self._listener.send(identity, message):
            self._unreachable.discard(identity)  # it has connected again meanwhile
        else:
            self._unreachable.add(identity)
        if isinstance(message, protocol.Welcome):
            self._receipts.begin(identity)
        elif not isinstance(message, protocol.Heartbeat):
            self._receipts.sent(identity, self._carried.sent - before)

    def _lose(self) -> None:
        unreachable, self._unreachable = self._unreachable, set()
        for identity in sorted(unreachable):
            self.handle(m.SlaveLost(identity, "its connection is gone; it may have died"))

    def abort(self, reason: str) -> None:
        """Tell the slaves to stop, and nobody else: something failed here."""
        for instruction in self.state.handle(m.Abort(reason), self._clock()):
            if isinstance(instruction, m.Send):
                self._listener.send(instruction.identity, instruction.message)


class MasterLoop:
    """What the master's thread runs until the cluster ends.

    Args:
        mailbox: brings events of other threads.
        watch: tells of slave processes that were started here and have ended.
        answers: takes instructions that are no messages to slaves, and at last what ended the loop if that failed.
        observers: are told what happens, on this thread.
        limits: of the cluster.
    """

    def __init__(
        self,
        state: Master,
        network: Network,
        listener: Listener,
        mailbox: Mailbox,
        watch: Watch,
        answers: queue.SimpleQueue[m.Instruction | BaseException],
        observers: Sequence[ClusterObserver] = (),
        limits: ClusterLimits | None = None,
    ) -> None:
        self.state = state
        self._shell = MasterShell(state, listener, answers.put, observers, carried=network.carried)
        self._dead_s = (limits or ClusterLimits()).dead_s
        self._network = network
        self._mailbox = mailbox
        self._watch = watch
        self._answers = answers
        self._closing = False
        self._ended: list[Started] = []
        self._ticked = self._seen_again = 0.0
        self._seen: list[tuple[int, bool]] = []
        network.watch(mailbox.fd)

    def run(self) -> None:
        """Bring events, carry out instructions."""
        try:
            while not self._closing:
                self._turn()
            # A transport may throw away what a slave has not yet read when the connection ends (ZeroMQ does): the last
            # words have to be answered before it closes.
            deadline = time.monotonic() + SEE_OFF_S
            while not self.state.all_left and time.monotonic() < deadline:
                self._turn()
        except BaseException as error:  # whoever waits in `render` must hear of it, whatever it is
            self._shell.abort(f"the master failed: {error}")
            self._answers.put(error)

    def _turn(self) -> None:
        self._network.wait(TURN_S)
        for event in self._mailbox.take():
            self._closing = self._closing or isinstance(event, m.Close)
            self._shell.handle(event)
        self._shell.receive()
        now = time.monotonic()
        if now - self._ticked >= TURN_S:
            self._ticked = now
            # Of those that were found a tick ago: what a process has said last has been read since.
            ended, self._ended = self._ended, list(self._watch())
            for event in ended:
                self._shell.handle(event)
            self._shell.handle(m.Tick())
            self._shell.look_at_receipts(self._dead_s)
            self._tell_of_slaves(now)

    def _tell_of_slaves(self, now: float) -> None:
        """Who looks at the image hears of slaves when one comes or goes, and of what they take every so often.

        Answers are read while something is rendered; meanwhile only, or they would pile up.
        """
        if not self.state.rendering:
            return
        slaves = self.state.seen()
        who = [(slave.cells, slave.lost) for slave in slaves]
        if who != self._seen or now >= self._seen_again:
            self._seen, self._seen_again = who, now + SEEN_S
            self._answers.put(m.SlavesSeen(slaves))
