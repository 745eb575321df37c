"""A transport for tests: it carries messages by another one, remembers them, and breaks, loses and delays when told to.

All that a further transport takes is a file like this one, and a `register`.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from wdpm.cluster.messages.protocol import Message
from wdpm.cluster.transport.keys import Keys
from wdpm.cluster.transport.memory import MemoryTransport
from wdpm.cluster.transport.transport import Accepted, Carried, Connection, Listener, Network, Role, Transport

SCHEME = "flaky://"


@dataclass
class FlakyTransport:
    """Memory, with breaks.

    Attributes:
        breaks: whether a connection to a listener of this role breaks in the place of sending a message.
        loses: whether such a message is lost in the place of being sent, and nobody hears of it.
        delay_s: time that answers of a listener of this role take to a network, by its number in the order of opening.
        sent: messages that were sent over connections to listeners, in order.
    """

    breaks: Callable[[Role, Message], bool] = lambda role, message: False  # noqa: ARG005
    loses: Callable[[Role, Message], bool] = lambda role, message: False  # noqa: ARG005
    delay_s: Callable[[Role, int], float] = lambda role, network: 0.0  # noqa: ARG005
    sent: list[tuple[Role, Message]] = field(default_factory=list)
    opened: int = 0
    inner: Transport = field(default_factory=MemoryTransport)

    def resolve(self, address: str) -> str:
        return outside(self.inner.resolve(inside(address)))

    def open(self, keys: Keys | None) -> FlakyNetwork:
        self.opened += 1
        return FlakyNetwork(self, self.inner.open(keys), self.opened - 1)


def inside(address: str) -> str:
    """The address that the inner transport knows."""
    return address.replace(SCHEME, "memory://", 1)


def outside(address: str) -> str:
    """The address that others know."""
    return address.replace("memory://", SCHEME, 1)


class FlakyListener:
    def __init__(self, inner: Listener) -> None:
        self._inner = inner
        self.endpoint = outside(inner.endpoint)

    def receive(self) -> tuple[bytes, Any] | None:
        return self._inner.receive()

    def send(self, identity: bytes, message: Message) -> bool:
        return self._inner.send(identity, message)

    def admit(self, identity: bytes) -> None:
        self._inner.admit(identity)


class FlakyConnection:
    def __init__(self, transport: FlakyTransport, role: Role, inner: Connection, delay_s: float) -> None:
        self._transport, self._role, self._inner, self._delay_s = transport, role, inner, delay_s
        self._open = True
        self._news = False
        self._late: deque[tuple[float, Any]] = deque()

    def send(self, message: Message) -> bool:
        if self._open and self._transport.breaks(self._role, message):
            self._open, self._news = False, True
            self._inner.close(deliver=False)
        if self._open and self._transport.loses(self._role, message):
            return True
        if not self._open or not self._inner.send(message):
            return False
        self._transport.sent.append((self._role, message))
        return True

    def receive(self) -> Any:
        while (message := self._inner.receive()) is not None:
            self._late.append((time.monotonic() + self._delay_s, message))
        return self._late.popleft()[1] if self._late and time.monotonic() >= self._late[0][0] else None

    def broke(self) -> bool:
        news, self._news = self._news, False
        return news or self._inner.broke()

    def reached(self) -> bool:
        return self._inner.reached()

    def refused(self) -> bool:
        return self._inner.refused()

    def close(self, *, deliver: bool) -> None:
        self._inner.close(deliver=deliver)


class FlakyNetwork:
    def __init__(self, transport: FlakyTransport, inner: Network, number: int) -> None:
        self._transport, self._inner, self._number = transport, inner, number
        self.watch, self.rest, self.wait, self.close = inner.watch, inner.rest, inner.wait, inner.close

    @property
    def carried(self) -> Carried:
        return self._inner.carried

    @property
    def stirred(self) -> bool:
        return True  # a link may be cut at any time

    def listen(self, address: str, role: Role, accepted: Accepted) -> FlakyListener:
        return FlakyListener(self._inner.listen(inside(address), role, accepted))

    def connect(self, address: str, role: Role, accepted: Accepted, identity: bytes | None = None) -> FlakyConnection:
        inner = self._inner.connect(inside(address), role, accepted, identity)
        return FlakyConnection(self._transport, role, inner, self._transport.delay_s(role, self._number))

    def address_for_peers(self, master: str) -> str:
        return outside(self._inner.address_for_peers(inside(master)))
