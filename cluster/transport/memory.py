"""The transport memory://NAME: queues in place of sockets, within one process.

Messages are handed over as they are, without packing. Each network may be used by a thread of its own; or all by one
thread, with a `Carrier` that decides when a message arrives: that is how `in_process` renders, and how tests shuffle
what may be shuffled.
"""

from __future__ import annotations

import itertools
import select
import threading
from collections import deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass

from wdpm.cluster.messages.protocol import Message
from wdpm.cluster.transport import stream
from wdpm.cluster.transport.keys import Keys
from wdpm.cluster.transport.stream import Stream
from wdpm.cluster.transport.transport import Accepted, Carried, Received, Role
from wdpm.scenes.errors import ClusterError, ProtocolError, SettingsError

SCHEME = "memory://"


@dataclass(frozen=True)
class Channel:
    """What keeps its order: what goes from one place to another. A network's place is the network itself."""

    sender: Hashable
    receiver: Hashable


Carrier = Callable[[Channel, Message, Callable[[], None]], None]
"""Makes the delivery of a message, behind all others of its channel."""


def at_once(channel: Channel, message: Message, delivery: Callable[[], None]) -> None:  # noqa: ARG001 - a Carrier
    """Carries messages without any delay."""
    delivery()


class MemoryTransport:
    """Networks that reach each other.

    Args:
        carry: makes deliveries, at once or later.
    """

    def __init__(self, carry: Carrier = at_once) -> None:
        self.carry = carry
        self.listeners: dict[str, MemoryListener] = {}
        self.numbers = itertools.count(1)  # calls of next() are atomic, as sets and gets of a dictionary are

    def resolve(self, address: str) -> str:
        """The address itself."""
        if not address.startswith(SCHEME) or address == SCHEME:
            raise SettingsError(f"'{address}' is no address; expected {SCHEME}NAME")
        return address

    def open(self, keys: Keys | None) -> MemoryNetwork:
        """Open a network. Nobody else reaches this process's memory, so keys keep nobody out."""
        del keys
        return MemoryNetwork(self)


class _Inbox:
    """What has been delivered to one end."""

    def __init__(self, network: MemoryNetwork, accepted: Accepted) -> None:
        self._network = network
        self._accepted = accepted
        self._arrived: deque[tuple[bytes, Received]] = deque()

    def put(self, identity: bytes, message: Message) -> None:
        """Called by whoever sends, on its thread."""
        name = type(message).__name__
        known = self._accepted.get(name) is type(message)
        self._arrived.append((identity, message if known else ProtocolError(f"message {name!r} is not known here")))
        self._network.ring()

    def take(self) -> tuple[bytes, Received] | None:
        return self._arrived.popleft() if self._arrived else None

    def __bool__(self) -> bool:
        return bool(self._arrived)


class MemoryListener:
    """An inbox that is found by its endpoint."""

    def __init__(self, memory: MemoryTransport, network: MemoryNetwork, endpoint: str, accepted: Accepted) -> None:
        self.inbox = _Inbox(network, accepted)
        self.network = network
        self.connections: dict[bytes, MemoryConnection] = {}
        self.closed = False
        self._memory = memory
        self._endpoint = endpoint

    @property
    def endpoint(self) -> str:
        """The address under which others find it."""
        return self._endpoint

    def receive(self) -> tuple[bytes, Received] | None:
        """The next message and the identity of the connection that it came over."""
        return self.inbox.take()

    def send(self, identity: bytes, message: Message) -> bool:
        """Answer over a connection; False if it is closed."""
        connection = self.connections.get(identity)
        if connection is None:
            return False
        channel = Channel(self.network, connection.network)
        self._memory.carry(channel, message, lambda: connection.inbox.put(identity, message))
        return True

    def admit(self, identity: bytes) -> None:
        """Nothing is read here, so nothing need be short."""

    def close(self) -> None:
        """Nobody finds it any more, and whoever is connected hears of it."""
        self.closed = True
        self._memory.listeners.pop(self._endpoint, None)
        for connection in list(self.connections.values()):
            connection.network.ring()


class MemoryConnection:
    """A way to a listener; to none if nobody listened when it was made."""

    def __init__(
        self,
        memory: MemoryTransport,
        network: MemoryNetwork,
        listener: MemoryListener | None,
        identity: bytes,
        accepted: Accepted,
    ) -> None:
        self.inbox = _Inbox(network, accepted)
        self.network = network
        self._memory = memory
        self._listener = listener
        self._identity = identity
        self._reported = listener is None
        self._reached = listener is not None
        if listener is not None:
            listener.connections[identity] = self

    def send(self, message: Message) -> bool:
        """Send a message; False if nobody listens."""
        listener = self._listener
        if listener is None or listener.closed:
            return False
        channel = Channel(self.network, listener.network)
        self._memory.carry(channel, message, lambda: listener.inbox.put(self._identity, message))
        return True

    def receive(self) -> Received | None:
        """The next answer."""
        taken = self.inbox.take()
        return None if taken is None else taken[1]

    def broke(self) -> bool:
        """Whether the listener has been closed since this was last asked."""
        if self._reported or self._listener is None or not self._listener.closed:
            return False
        self._reported = True
        return True

    def reached(self) -> bool:
        """At once, if anybody listened when it was made; asked for the first time."""
        reached, self._reached = self._reached, False
        return reached

    def refused(self) -> bool:
        """Never: there are no keys."""
        return False

    def close(self, *, deliver: bool) -> None:
        """Let go of it. What has been sent is in the carrier's hands."""
        del deliver
        self.network.forget(self)
        if self._listener is not None and self._listener.connections.get(self._identity) is self:
            del self._listener.connections[self._identity]


class MemoryNetwork:
    """The listeners and connections of one master or slave."""

    def __init__(self, memory: MemoryTransport) -> None:
        self.carried = Carried()
        self._memory = memory
        self._listeners: list[MemoryListener] = []
        self._connections: list[MemoryConnection] = []
        self._watched: set[int] = set()
        self._bell: tuple[Stream, Stream] | None = None
        self._rung = False
        self._lock = threading.Lock()  # of the bell

    def listen(self, address: str, role: Role, accepted: Accepted) -> MemoryListener:
        """Listen under a name; ClusterError if it is taken."""
        del role
        endpoint = self._memory.resolve(address)
        listener = MemoryListener(self._memory, self, endpoint, accepted)
        if self._memory.listeners.setdefault(endpoint, listener) is not listener:
            raise ClusterError(f"cannot listen at {address}: someone else does; choose another name")
        self._listeners.append(listener)
        return listener

    def connect(self, address: str, role: Role, accepted: Accepted, identity: bytes | None = None) -> MemoryConnection:
        """Connect to whoever listens under a name."""
        del role
        own = identity or next(self._memory.numbers).to_bytes(8)
        connection = MemoryConnection(self._memory, self, self._memory.listeners.get(address), own, accepted)
        self._connections.append(connection)
        return connection

    def address_for_peers(self, master: str) -> str:
        """A name that nobody else has."""
        return f"{master}/slave{next(self._memory.numbers)}"

    def watch(self, descriptor: int) -> None:
        """Have `wait` end when a file descriptor can be read, too."""
        self._watched.add(descriptor)

    @property
    def stirred(self) -> bool:
        """Asking is quick here."""
        return True

    def rest(self, seconds: float) -> None:
        """Until a watched descriptor can be read."""
        select.select(list(self._watched), [], [], seconds)

    def wait(self, seconds: float) -> set[int]:
        """Until something arrives, or a watched descriptor can be read."""
        with self._lock:
            if self._bell is None:
                self._bell = stream.pair()  # not before: a network that never waits needs no sockets
            ear = self._bell[0]
            here = any(listener.inbox for listener in self._listeners)
            here = here or any(connection.inbox for connection in self._connections)
        ready, _, _ = select.select([ear.fileno(), *self._watched], [], [], 0.0 if here else seconds)
        with self._lock:
            if self._rung:
                ear.recv(1)
                self._rung = False
        return self._watched.intersection(ready)

    def ring(self) -> None:
        """End a `wait`; called by any thread."""
        with self._lock:
            if self._bell is not None and not self._rung:
                self._rung = True
                self._bell[1].send(b".")

    def forget(self, connection: MemoryConnection) -> None:
        """A connection closes."""
        if connection in self._connections:
            self._connections.remove(connection)

    def close(self) -> None:
        """Close all that is open."""
        for listener in self._listeners:
            listener.close()
        for connection in list(self._connections):
            connection.close(deliver=False)
        with self._lock:
            bell, self._bell = self._bell, None
        for end in bell or ():
            end.close()
