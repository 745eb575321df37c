"""ZeroMQ sockets as all of a cluster are set up, and messages on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import zmq

from wdpm.cluster.limits import DEAD_S
from wdpm.cluster.messages import packing
from wdpm.cluster.messages.frames import FRAME_BYTES, Frame
from wdpm.scenes.errors import ProtocolError

Socket = zmq.Socket[bytes]

LINGER_MS = 1000
"""How long a closing socket tries to get rid of its last words (Stop, Failed)."""

ENVELOPE_BYTES = 64
"""What encryption may add to a frame, and MAXMSGSIZE counts: CurveZMQ's MESSAGE command takes 33 bytes, its name, a
nonce, a MAC and flags (RFC 26)."""

_PROBE_S = 10
"""Between two probes of a connection on which nothing is sent [s]."""

STOP_CONNECTING = -1
"""Value of RECONNECT_IVL. ZeroMQ would mend a broken connection without a word, and messages would be missing."""

# As plain numbers: pyzmq's own types run Python code whenever two are joined, or one is looked up.
_LAST: Final = int(zmq.NOBLOCK)
_MORE: Final = int(zmq.NOBLOCK | zmq.SNDMORE)
_EVENTS: Final = int(zmq.EVENTS)
_READABLE: Final = int(zmq.POLLIN)


def make_socket(context: zmq.Context[Socket], kind: int) -> Socket:
    """A socket with the settings that all sockets of the cluster share."""
    socket = context.socket(kind)
    # No high-water mark: a full queue would drop messages (ROUTER) or block the loop that empties the other's queue
    # (DEALER). What is in flight is bounded by the number of tasks instead.
    socket.sndhwm = socket.rcvhwm = 0
    # Of one frame as it is sent; a longer one closes the connection before it is read.
    socket.maxmsgsize = FRAME_BYTES + ENVELOPE_BYTES
    socket.linger = LINGER_MS
    socket.reconnect_ivl = STOP_CONNECTING
    _notice_silent_links(socket)
    return socket


def _notice_silent_links(socket: Socket) -> None:
    """Have the system close a connection that takes no byte for DEAD_S, or has none to take and answers no probe.

    Heartbeats tell whether a process lives; a connection beside theirs may have been cut off without a word (a router
    that forgot it), and nothing else would ever tell.
    """
    socket.tcp_maxrt = round(1000 * DEAD_S)
    socket.tcp_keepalive, socket.tcp_keepalive_idle = 1, _PROBE_S
    socket.tcp_keepalive_intvl, socket.tcp_keepalive_cnt = _PROBE_S, round(DEAD_S / _PROBE_S) - 1
    socket.handshake_ivl = round(1000 * DEAD_S)


def bind(socket: Socket, address: str) -> str:
    """Listen at a resolved address (port * for a free one); returns the address with its port."""
    socket.ipv6 = "[" in address
    socket.bind(address)
    return _bound_to(socket)


def connect(socket: Socket, address: str) -> None:
    """Connect to a resolved address."""
    socket.ipv6 = "[" in address
    socket.connect(address)


def _bound_to(socket: Socket) -> str:
    endpoint = socket.getsockopt(zmq.LAST_ENDPOINT)
    if not isinstance(endpoint, bytes):
        raise AssertionError(f"ZeroMQ tells the endpoint {endpoint!r}")
    return endpoint.rstrip(b"\0").decode()


def send(socket: Socket, message: Any, identity: bytes | None = None) -> int:
    """Send a message, arrays without a copy; zmq.ZMQError if the other end is gone. Returns its bytes."""
    frames = packing.encode(message)
    size = size_of(frames)
    if identity is not None:
        frames.insert(0, identity)
    *others, last = frames
    for frame in others:
        socket.send(frame, _MORE, copy=False)
    socket.send(last, _LAST, copy=False)
    return size


def size_of(frames: Sequence[Frame]) -> int:
    """Bytes of all of them."""
    return sum(map(len, frames))


def receive_first(socket: Socket) -> zmq.Frame | None:
    """The first frame of the next message, a ROUTER's identity; None if there is no message."""
    # Most sockets that are asked have none: that is found out in a third of the time that an error takes.
    if not int(socket.get(_EVENTS)) & _READABLE:
        return None
    try:
        return socket.recv(_LAST, copy=False)
    except zmq.Again:
        return None


def receive_all(first: zmq.Frame, socket: Socket, most: int) -> list[memoryview]:
    """A message whose first frame is there. No more than one frame beyond `most` is kept behind it, which says that
    there were more."""
    return [first.buffer, *(frame.buffer for frame in receive_frames(first, socket, most))]


def receive_frames(first: zmq.Frame, socket: Socket, most: int) -> list[zmq.Frame]:
    """The frames that follow the first, as ZeroMQ has them: they know who sent them."""
    frames: list[zmq.Frame] = []
    frame = first
    while frame.more:  # asking the socket takes as long as a frame does
        frame = socket.recv(copy=False)
        if len(frames) <= most:
            frames.append(frame)
    return frames


def sender(frames: Sequence[zmq.Frame]) -> bytes:
    """The public key (Z85) of who sent a message, as the doorkeeper gave it to ZeroMQ; none where there are no keys."""
    try:
        return str(frames[0].get("User-Id")).encode() if frames else b""
    except zmq.ZMQError:
        return b""


def read(frames: Sequence[memoryview], expected: Mapping[str, type], *, stranger: bool = False) -> Any:
    """The message of some frames, or the ProtocolError that says what is wrong with it."""
    try:
        return packing.decode(frames, expected, stranger=stranger)
    except ProtocolError as error:
        return error
