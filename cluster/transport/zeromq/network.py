"""The transports tcp://HOST:PORT and ipc://FOLDER/NAME: ROUTER sockets listen, DEALER sockets connect.

docs/protocol.md is the norm for what sockets there are, and how they are set up.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Final

import zmq
from zmq.utils.monitor import recv_monitor_message

from wdpm.cluster.limits import MOST_SLAVES
from wdpm.cluster.messages import packing
from wdpm.cluster.messages.protocol import Dismissed, FromReader, Heartbeat, Message
from wdpm.cluster.transport import address as tcp
from wdpm.cluster.transport import local_sockets, open_files
from wdpm.cluster.transport.keys import Guests, Keys, KnownKeys
from wdpm.cluster.transport.transport import Accepted, Carried, Received, Role
from wdpm.cluster.transport.zeromq import curve
from wdpm.cluster.transport.zeromq.heartbeat_lane import ONLY_HEARTBEATS, TO_SLAVE, HeartbeatLane, lane_of, owner
from wdpm.cluster.transport.zeromq.sockets import (
    Socket,
    bind,
    connect,
    make_socket,
    read,
    receive_all,
    receive_first,
    receive_frames,
    send,
    sender,
    size_of,
)
from wdpm.scenes.errors import ClusterError, MachineError, ProtocolError, SettingsError

HANDSHAKE_FAILED = (
    zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_AUTH
)
"""What ZeroMQ tells when keys do not fit, or one end has some and the other has none."""


ONLY_READERS: Accepted = {FromReader.__name__: FromReader}
"""What may come from somebody whose key is no slave's."""


LOOKS: Final = 8
"""So many waits may end without a look at all, since messages are there: so long may other news wait."""


NOT_MORE = ProtocolError("these are keys of a reader, who may only ask how far a render is; give those of a slave")


class ZeroMQTransport:
    """Between processes and machines."""

    def resolve(self, address: str) -> str:
        """tcp://HOST:PORT with a number in place of the name; ipc://FOLDER/NAME as it is."""
        return local_sockets.resolve(address) if local_sockets.is_local(address) else tcp.resolve(address)

    def open(self, keys: Keys | None) -> ZeroMQNetwork:
        """Open a context."""
        return ZeroMQNetwork(keys)


class ZeroMQListener:
    """A ROUTER.

    Args:
        network: has waited for messages, and counts what comes and goes.
        members: whose keys make them more than readers; None where nobody has keys.
    """

    def __init__(
        self,
        network: ZeroMQNetwork,
        socket: Socket,
        endpoint: str,
        accepted: Accepted,
        members: Guests | None = None,
    ) -> None:
        self._members = members
        self._network = network
        self._carried = network.carried
        self._socket = socket
        self._endpoint = endpoint
        self._accepted = accepted
        self._admitted: set[bytes] = set()

    @property
    def endpoint(self) -> str:
        """Where it is bound; a slave's that has keys says which is its own."""
        return self._endpoint

    def receive(self) -> tuple[bytes, Received] | None:
        """The next message and the routing id that it came from."""
        first = self._network.first_of(self._socket)
        if first is None:
            return None
        identity = first.bytes
        beating = owner(identity)
        stranger = beating is not None or identity not in self._admitted
        whole = receive_frames(first, self._socket, packing.most_frames(stranger))
        frames = [frame.buffer for frame in whole]
        self._carried.received += size_of(frames)
        if stranger and self._members is not None and not self._members.admits(sender(whole)):
            asked = read(frames, ONLY_READERS, stranger=True)
            return identity, NOT_MORE if isinstance(asked, ProtocolError) else asked
        if beating is not None:
            return beating, read(frames, ONLY_HEARTBEATS, stranger=True)
        return identity, read(frames, self._accepted, stranger=stranger)

    def admit(self, identity: bytes) -> None:
        """From now on take long messages, and such with arrays."""
        self._admitted.add(identity)

    def send(self, identity: bytes, message: Message) -> bool:
        """Answer. The master's ROUTER knows who is gone; a slave's drops what nobody takes, and says True."""
        if isinstance(message, Heartbeat | Dismissed):
            self._send(lane_of(identity), message)
        return self._send(identity, message)

    def _send(self, identity: bytes, message: Message) -> bool:
        try:
            self._carried.sent += send(self._socket, message, identity)
        except zmq.ZMQError as error:
            if error.errno != zmq.EHOSTUNREACH:
                raise
            self._network.look_at_all()  # its last words may have come since the last wait
            return False
        return True


class ZeroMQConnection:
    """A DEALER to someone, and the socket on which ZeroMQ tells that it broke.

    Args:
        open_lane: opens a second connection for heartbeats, with the first of them; None for none.
    """

    def __init__(
        self, network: ZeroMQNetwork, socket: Socket, accepted: Accepted, open_lane: Callable[[], HeartbeatLane] | None
    ) -> None:
        self.socket = socket
        self.lane: HeartbeatLane | None = None
        self._open_lane = open_lane
        self._network = network
        self._accepted = accepted
        self.monitor: Socket = socket.get_monitor_socket(
            zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED | HANDSHAKE_FAILED
        )
        self._reached = self._refused = self._broke = self._told = False

    def send(self, message: Message) -> bool:
        """A DEALER without a connection has no queue to put a message in."""
        if isinstance(message, Heartbeat) and self._open_lane is not None:
            self.lane = self.lane or self._open_lane()
            self.lane.send(message)
        try:
            self._network.carried.sent += send(self.socket, message)
        except zmq.Again:
            return False
        except zmq.ZMQError as error:
            if error.errno != zmq.ENOTSOCK:  # it was closed, and nothing could be opened in its place
                raise
            return False
        return True

    def receive(self) -> Received | None:
        """The next answer; what comes over the lane first."""
        if self.lane is not None and (beat := self._network.first_of(self.lane.socket)) is not None:
            return read(receive_all(beat, self.lane.socket, 1), TO_SLAVE, stranger=True)
        # Last words may have come after the wait that ended before the news that this broke.
        first = receive_first(self.socket) if self._told else self._network.first_of(self.socket)
        if first is None:
            return None
        frames = receive_all(first, self.socket, packing.most_frames(stranger=False))
        self._network.carried.received += size_of(frames)
        return read(frames, self._accepted)

    def read_news(self) -> None:
        """Read what ZeroMQ has told of the connection."""
        while self.monitor.poll(0):
            happened = recv_monitor_message(self.monitor)["event"]
            self._reached = self._reached or happened == zmq.EVENT_HANDSHAKE_SUCCEEDED
            self._refused = self._refused or bool(happened & HANDSHAKE_FAILED)
            self._broke = self._broke or happened == zmq.EVENT_DISCONNECTED

    def broke(self) -> bool:
        """Whether ZeroMQ has told that the other end hung up."""
        broke, self._broke = self._broke, False
        self._told = self._told or broke
        return broke

    def reached(self) -> bool:
        """Whether ZeroMQ has told that the ends have agreed on who they are."""
        reached, self._reached = self._reached, False
        return reached

    def refused(self) -> bool:
        """Whether ZeroMQ has told that the ends did not agree on who they are."""
        return self._refused

    def close(self, *, deliver: bool) -> None:
        """Close the sockets; what is to be delivered lingers. May be called again."""
        self._network.forget(self)
        if self.socket.closed:
            return
        self.socket.disable_monitor()
        self.monitor.close(linger=0)
        self.socket.close(None if deliver else 0)
        if self.lane is not None:
            self.lane.socket.close()


class ZeroMQNetwork:
    """A ZeroMQ context.

    Args:
        keys: of the cluster, or None.
    """

    def __init__(self, keys: Keys | None) -> None:
        self.carried = Carried()
        self._keys = keys
        self._poller = zmq.Poller()
        self._watching = zmq.Poller()  # what is watched alone
        self._often = zmq.Poller()  # all but connections to peers, of which there is news at their beginning and end
        self._rested, self._unlooked = False, 0  # since the last wait; waits since all was looked at
        self._watched: set[int] = set()
        self._ready: set[Socket | int] | None = None
        self._connections: list[ZeroMQConnection] = []
        self._monitors: dict[Socket | int, ZeroMQConnection] = {}
        self._seldom: set[Socket | int] = set()  # what is not among the places that are looked at often
        self._peers = KnownKeys()
        with ExitStack() as stack:
            self._context: zmq.Context[Socket] = stack.enter_context(zmq.Context())
            self._context.max_sockets = 3 * MOST_SLAVES + 64  # a lane is one of the 64
            self._door = None if keys is None else self._doorkeeper(keys)
            if self._door is not None:
                stack.callback(self._door.close)
            self._stack = stack.pop_all()

    def listen(self, address: str, role: Role, accepted: Accepted) -> ZeroMQListener:
        """Bind a ROUTER; port 0 takes a free one."""
        self._check_keys_go_with(address)
        router = self._stack.enter_context(make_socket(self._context, zmq.ROUTER))
        if role is Role.MASTER:
            router.router_mandatory = True  # a message to a slave that is gone is an error instead of nothing
            router.router_handover = True  # a slave that had to connect again is the same slave
        if self._keys is not None:
            curve.serve(router, self._keys.own)
        endpoint = _bind(router, address)
        if local_sockets.is_local(endpoint):
            self._stack.callback(local_sockets.remove, endpoint)
        if self._keys is not None and role is Role.SLAVE:
            endpoint = curve.with_key(endpoint, self._keys.own.public)
        self._look_at(router, often=True)
        members = self._keys.guests if self._keys is not None and role is Role.MASTER else None
        return ZeroMQListener(self, router, endpoint, accepted, members)

    def connect(self, address: str, role: Role, accepted: Accepted, identity: bytes | None = None) -> ZeroMQConnection:
        """Connect a DEALER. ZeroMQ would look a name up, or take what is none, and say nothing."""
        self._check_keys_go_with(address)
        if role is Role.SLAVE:
            open_files.require_as_slave(len(self._connections))  # one of them is with the master
        address, server = self._who_is_at(address, role)
        _check_resolved(address)

        def attach(socket: Socket) -> None:
            if self._keys is not None:
                curve.connect(socket, self._keys.own, server)
            connect(socket, address)
            if accepted:
                self._look_at(socket, often=identity is not None)

        lane = None
        if role is Role.MASTER and identity is not None:
            lane = partial(HeartbeatLane, identity, self._dealer, attach)
        connection = ZeroMQConnection(self, self._dealer(), accepted, lane)
        self._connections.append(connection)
        self._monitors[connection.monitor] = connection
        self._look_at(connection.monitor, often=identity is not None)
        if identity is not None:
            connection.socket.routing_id = identity
        attach(connection.socket)
        return connection

    def _check_keys_go_with(self, address: str) -> None:
        """Raise ClusterError about keys where the system says who may come; a master may name any endpoint."""
        if self._keys is not None and local_sockets.is_local(address):
            raise ClusterError(f"cannot use {address!r}: a socket in a folder takes no keys, and there are some here")

    def _doorkeeper(self, keys: Keys) -> curve.Doorkeeper:
        is_master = keys.own.public == keys.master  # knows its slaves already; those learn of each other from it

        def admits(public: bytes) -> bool:
            reads = is_master and (public == keys.master or keys.readers.admits(public))
            return reads or keys.guests.admits(public) or self._peers.admits(public)

        door = curve.Doorkeeper(self._context, admits, 0.0 if is_master else curve.WAIT_FOR_NEWS_S)
        self._look_at(door.socket, often=True)
        return door

    def _who_is_at(self, endpoint: str, role: Role) -> tuple[str, bytes]:
        """An address, and whose public key must be there. A peer that this process connects to is let in, too."""
        address, key = curve.split_key(endpoint)
        if self._keys is None:
            if key is not None:
                raise ClusterError(f"cannot connect to {endpoint!r}: it takes keys, and there are none here")
            return address, b""
        if role is Role.MASTER:
            return address, self._keys.master
        if key is None:
            raise ClusterError(f"cannot connect to {endpoint!r}: it has no key")
        self._peers.add(key)
        return address, key

    def _dealer(self) -> Socket:
        try:
            return make_socket(self._context, zmq.DEALER)
        except zmq.ZMQError as error:
            raise MachineError(f"no more connections can be opened: {error.strerror.lower()}") from None

    def address_for_peers(self, master: str) -> str:
        """Any port of the interface that leads to the master; or a new socket beside his."""
        if local_sockets.is_local(master):
            return local_sockets.beside(master)
        return tcp.join(tcp.interface_towards(master), 0)

    def watch(self, descriptor: int) -> None:
        """Have `wait` end when a file descriptor can be read, too."""
        self._watched.add(descriptor)
        self._watching.register(descriptor, zmq.POLLIN)
        self._look_at(descriptor, often=True)

    def _look_at(self, place: Socket | int, *, often: bool) -> None:
        """Have `wait` end when a place can be read, and look there each time, or now and then while others can be."""
        self._poller.register(place, zmq.POLLIN)
        if often:
            self._often.register(place, zmq.POLLIN)
        else:
            self._seldom.add(place)

    def rest(self, seconds: float) -> None:
        """Poll what is watched alone; ZeroMQ's own thread takes messages in meanwhile."""
        self._rested = True
        self._watching.poll(math.ceil(seconds * 1000))

    def wait(self, seconds: float) -> set[int]:
        """Poll all sockets that are read from, what is watched, and ZeroMQ's news of connections that broke.

        Polling takes some microseconds for each socket, of which a slave has two for each of the others.
        """
        # After a rest something is there most times.
        ready = self._often.poll(0) if self._rested and self._unlooked < LOOKS else []
        self._rested, self._unlooked = False, self._unlooked + 1
        if not ready:
            self._unlooked = 0
            ready = self._poller.poll(math.ceil(seconds * 1000))
        self._ready = {place for place, _ in ready}
        if self._door is not None:
            self._door.answer()
        for place in self._ready:
            if (connection := self._monitors.get(place)) is not None:
                connection.read_news()
        return self._watched & self._ready

    @property
    def stirred(self) -> bool:
        """Whether any connection but those with an identity may have news."""
        return self._ready is None or not self._seldom.isdisjoint(self._ready)

    def first_of(self, socket: Socket) -> zmq.Frame | None:
        """The first frame of a socket's next message; None if there was none when `wait` ended.

        Asking a socket that has nothing takes as long as a small message does, and a slave has one for each of the
        others.
        """
        if self._ready is not None and socket not in self._ready:
            return None
        return receive_first(socket)

    def look_at_all(self) -> None:
        """Until the next wait, ask every socket, and not only those that had something when the last one ended."""
        self._ready = None

    def close(self) -> None:
        """Close all sockets and the context."""
        for connection in list(self._connections):
            connection.close(deliver=False)
        self._stack.close()

    def forget(self, connection: ZeroMQConnection) -> None:
        """A connection closes."""
        if connection in self._connections:
            self._connections.remove(connection)
            del self._monitors[connection.monitor]
        for socket in (connection.socket, connection.monitor, connection.lane and connection.lane.socket):
            if socket is not None and socket in self._poller:
                self._poller.unregister(socket)
                if socket in self._often:
                    self._often.unregister(socket)
                self._seldom.discard(socket)


def _check_resolved(address: str) -> None:
    """Raise ClusterError if an address, which others may have sent, is none to connect to as it is."""
    if local_sockets.is_local(address):
        try:
            local_sockets.resolve(address)
        except SettingsError as error:
            raise ClusterError(f"cannot connect: {error}") from None
    elif not tcp.is_resolved(address):
        raise ClusterError(f"cannot connect to {address!r}: this is no address tcp://NUMBER:PORT")


def _bind(router: Socket, where: str) -> str:
    if local_sockets.is_local(where):
        local_sockets.check_free(where)
        try:
            return bind(router, local_sockets.resolve(where))
        except zmq.ZMQError as error:
            raise ClusterError(f"cannot listen at {where}: {error.strerror}") from None
    number, port = tcp.split(tcp.resolve(where))
    try:
        return bind(router, tcp.join(number, port or "*"))
    except zmq.ZMQError as error:
        if error.errno == zmq.EADDRINUSE:
            raise ClusterError(f"cannot listen at {where}: another program uses port {port}; choose another") from None
        reason = f"{error.strerror}; it must be an address of this machine"
        raise SettingsError(f"cannot listen at {where}: {reason}") from None
