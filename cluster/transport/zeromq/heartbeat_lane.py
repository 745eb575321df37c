"""Heartbeats on a connection of their own, so that they do not wait behind bulk data.

A cell's triangles take minutes over a slow link, and whatever is sent after them arrives after them. So a slave opens
a second connection to its master's ROUTER once it sends heartbeats, under its own identity with `SUFFIX`. It carries
nothing else that counts, so nothing is lost when it breaks: ZeroMQ may mend this one by itself. Heartbeats go over the
first connection too: there they tell whether it stands. So does Dismissed: a slave whose first connection swallows all
that is sent would not hear it otherwise.
"""

from __future__ import annotations

from collections.abc import Callable

import zmq

from wdpm.cluster.messages.protocol import Dismissed, Heartbeat
from wdpm.cluster.transport.transport import Accepted
from wdpm.cluster.transport.zeromq.sockets import Socket, send

SUFFIX = b"/heartbeats"

ONLY_HEARTBEATS: Accepted = {"Heartbeat": Heartbeat}
"""What a slave says over it."""

TO_SLAVE: Accepted = {**ONLY_HEARTBEATS, "Dismissed": Dismissed}
"""What the master does."""

_RECONNECT_MS = 200
_RECONNECT_MOST_MS = 5000

_QUEUED = 2
"""Heartbeats that wait for a connection; older ones say nothing that newer ones do not."""


def lane_of(identity: bytes) -> bytes:
    """The identity of a slave's second connection."""
    return identity + SUFFIX


def owner(identity: bytes) -> bytes | None:
    """Whose second connection an identity names; None if it is a first one."""
    return identity.removesuffix(SUFFIX) if identity.endswith(SUFFIX) else None


class HeartbeatLane:
    """A slave's end.

    Args:
        make: gives a DEALER with the cluster's settings and keys, that is not yet connected.
        attach: connects it.
    """

    def __init__(self, identity: bytes, make: Callable[[], Socket], attach: Callable[[Socket], None]) -> None:
        self.socket = make()
        self.socket.routing_id = lane_of(identity)
        self.socket.linger = 0
        self.socket.sndhwm = _QUEUED
        self.socket.reconnect_ivl, self.socket.reconnect_ivl_max = _RECONNECT_MS, _RECONNECT_MOST_MS
        attach(self.socket)

    def send(self, heartbeat: Heartbeat) -> None:
        """Send one, or drop it if some wait already."""
        try:
            send(self.socket, heartbeat)
        except zmq.Again:
            return
