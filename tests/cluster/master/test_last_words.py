"""A slave that says why it leaves is not taken for dead where the next message to it fails before that was read."""

from __future__ import annotations

import queue
from collections import deque
from typing import cast

from wdpm.cluster.master import events as m
from wdpm.cluster.master.loop import MasterLoop, MasterShell
from wdpm.cluster.master.machine import Master
from wdpm.cluster.messages import protocol
from wdpm.cluster.transport.mailbox import Mailbox
from wdpm.cluster.transport.transport import TURN_MESSAGES, Carried, Listener, Network, Received

SLAVE = b"slave"
GOODBYE = protocol.Goodbye("it has not enough memory")
FAILED = protocol.Failed("a fault of the program")
HELLO = protocol.Hello({}, "host", 1, 1, 0, "tcp://127.0.0.1:9")


class Gone:
    """A listener whose only slave has left: it cannot be reached, and what it said before is still to be read."""

    def __init__(self, said: list[Received]) -> None:
        self._said = deque(said)

    def receive(self) -> tuple[bytes, Received] | None:
        return (SLAVE, self._said.popleft()) if self._said else None

    def send(self, identity: bytes, message: object) -> bool:  # noqa: ARG002 - a Listener
        return False


class Beats:
    """A state machine that sends a heartbeat to the slave at each tick, and welcomes it; it keeps what it is told."""

    def __init__(self) -> None:
        self.told: list[m.Event] = []

    def handle(self, event: m.Event, now: float) -> list[m.Instruction]:  # noqa: ARG002 - a Master
        self.told.append(event)
        if event == m.SlaveSaid(SLAVE, HELLO):
            return [m.Send(SLAVE, protocol.Welcome(0, "cluster", 1.0, 60.0))]
        return [m.Send(SLAVE, protocol.Heartbeat())] if isinstance(event, m.Tick) else []


def shell_of(state: Beats, said: list[Received]) -> MasterShell:
    return MasterShell(cast("Master", state), cast("Listener", Gone(said)), lambda _: None)


def test_last_words_are_read_before_a_slave_is_lost() -> None:
    state = Beats()
    shell = shell_of(state, [GOODBYE])
    shell.handle(m.Tick())
    shell.receive()
    assert [type(event) for event in state.told] == [m.Tick, m.SlaveSaid, m.SlaveLost]


def test_a_slave_is_lost_though_it_said_more_than_is_read_at_a_time() -> None:
    state = Beats()
    shell = shell_of(state, [protocol.Heartbeat()] * TURN_MESSAGES + [GOODBYE])
    shell.handle(m.Tick())
    shell.receive()
    assert not any(isinstance(event, m.SlaveLost) for event in state.told)
    shell.receive()
    assert [type(event) for event in state.told[-2:]] == [m.SlaveSaid, m.SlaveLost]


class Returning:
    """A listener whose slave has come back by another connection when it is read."""

    def __init__(self) -> None:
        self._hello: deque[Received] = deque([HELLO])
        self.there = False

    def receive(self) -> tuple[bytes, Received] | None:
        self.there = True
        return (SLAVE, self._hello.popleft()) if self._hello else None

    def admit(self, identity: bytes) -> None: ...

    def send(self, identity: bytes, message: object) -> bool:  # noqa: ARG002 - a Listener
        return self.there


def test_a_slave_that_has_connected_again_is_not_lost() -> None:
    """It had no answer to its first Hello in time: the connection of the second is another one of the same name."""
    state = Beats()
    shell = MasterShell(cast("Master", state), cast("Listener", Returning()), lambda _: None)
    shell.handle(m.Tick())
    shell.receive()
    assert [type(event) for event in state.told] == [m.Tick, m.SlaveSaid]


class Ended:
    """A network whose only slave has said why it fails, and ended, while the master was at something else.

    Its words can be read from the first wait after that on.
    """

    endpoint = "none"
    carried = Carried()

    def __init__(self) -> None:
        self._said: deque[Received] = deque()
        self.has_ended = False

    def watch(self, descriptor: int) -> None: ...

    def wait(self, seconds: float) -> set[int]:  # noqa: ARG002 - a Network
        if self.has_ended and not self._said:
            self._said.append(FAILED)
        return set()

    def receive(self) -> tuple[bytes, Received] | None:
        return (SLAVE, self._said.popleft()) if self._said else None

    def send(self, identity: bytes, message: object) -> bool:  # noqa: ARG002 - a Listener
        return True

    def processes(self) -> list[m.ProcessEnded | m.NotComing]:
        """Found to have ended once, after all that had come was read."""
        if self.has_ended:
            return []
        self.has_ended = True
        return [m.ProcessEnded(1, "it ended with exit code 1", 3)]


def test_last_words_of_a_process_are_read_before_it_is_taken_for_ended() -> None:
    """Or a failure that ends a render would be a loss that others make good, by chance."""
    network, mailbox = Ended(), Mailbox()

    class Stops(Beats):
        all_left = True
        rendering = False

        def handle(self, event: m.Event, now: float) -> list[m.Instruction]:
            if isinstance(event, m.ProcessEnded):
                mailbox.put(m.Close("the test is over"))
            return super().handle(event, now)

    state = Stops()
    loop = MasterLoop(
        cast("Master", state),
        cast("Network", network),
        cast("Listener", network),
        mailbox,
        network.processes,
        queue.SimpleQueue(),
    )
    loop.run()
    mailbox.close()
    told = [type(event) for event in state.told if not isinstance(event, m.Tick)]
    assert told.index(m.SlaveSaid) < told.index(m.ProcessEnded)
