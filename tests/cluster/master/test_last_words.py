"""A slave that says why it leaves is not taken for dead where the next message to it fails before that was read."""

from __future__ import annotations

from collections import deque
from typing import cast

from wdpm.cluster.master import events as m
from wdpm.cluster.master.loop import MasterShell
from wdpm.cluster.master.machine import Master
from wdpm.cluster.messages import protocol
from wdpm.cluster.transport.transport import TURN_MESSAGES, Listener, Received

SLAVE = b"slave"
GOODBYE = protocol.Goodbye("it has not enough memory")


class Gone:
    """A listener whose only slave has left: it cannot be reached, and what it said before is still to be read."""

    def __init__(self, said: list[Received]) -> None:
        self._said = deque(said)

    def receive(self) -> tuple[bytes, Received] | None:
        return (SLAVE, self._said.popleft()) if self._said else None

    def send(self, identity: bytes, message: object) -> bool:  # noqa: ARG002 - a Listener
        return False


class Beats:
    """A state machine that sends a heartbeat to the slave at each tick, and keeps what it is told."""

    def __init__(self) -> None:
        self.told: list[m.Event] = []

    def handle(self, event: m.Event, now: float) -> list[m.Instruction]:  # noqa: ARG002 - a Master
        self.told.append(event)
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
