"""A transport for tests: it carries messages by another one, remembers them, and breaks connections when told to.

All that a further transport takes is a file like this one, and a `register`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from wdpm.cluster.messages.protocol import Message
from wdpm.cluster.transport.keys import Keys
from wdpm.cluster.transport.memory import MemoryTransport
from wdpm.cluster.transport.transport import Accepted, Connection, Listener, Network, Role, Transport

SCHEME = "flaky://"


@dataclass
class FlakyTransport:
    """Memory, with breaks.

    Attributes:
        breaks: whether a connection to a listener of this role breaks in the place of sending a message.
        sent: messages that were sent over connections to listeners, in order.
    """

    breaks: Callable[[Role, Message], bool] = lambda role, message: False  # noqa: ARG005
    sent: list[tuple[Role, Message]] = field(default_factory=list)
    inner: Transport = field(default_factory=MemoryTransport)

    def resolve(self, address: str) -> str:
        return outside(self.inner.resolve(inside(address)))

    def open(self, keys: Keys | None) -> FlakyNetwork:
        return FlakyNetwork(self, self.inner.open(keys))


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


class FlakyConnection:
    def __init__(self, transport: FlakyTransport, role: Role, inner: Connection) -> None:
        self._transport, self._role, self._inner = transport, role, inner
        self._open = True
        self._news = False

    def send(self, message: Message) -> bool:
        if self._open and self._transport.breaks(self._role, message):
            self._open, self._news = False, True
            self._inner.close(deliver=False)
        if not self._open or not self._inner.send(message):
            return False
        self._transport.sent.append((self._role, message))
        return True

    def receive(self) -> Any:
        return self._inner.receive()

    def broke(self) -> bool:
        news, self._news = self._news, False
        return news or self._inner.broke()

    def close(self, *, deliver: bool) -> None:
        self._inner.close(deliver=deliver)


class FlakyNetwork:
    def __init__(self, transport: FlakyTransport, inner: Network) -> None:
        self._transport, self._inner = transport, inner
        self.watch, self.wait, self.close = inner.watch, inner.wait, inner.close

    def listen(self, address: str, role: Role, accepted: Accepted) -> FlakyListener:
        return FlakyListener(self._inner.listen(inside(address), role, accepted))

    def connect(self, address: str, role: Role, accepted: Accepted, identity: bytes | None = None) -> FlakyConnection:
        return FlakyConnection(self._transport, role, self._inner.connect(inside(address), role, accepted, identity))

    def address_for_peers(self, master: str) -> str:
        return outside(self._inner.address_for_peers(inside(master)))
