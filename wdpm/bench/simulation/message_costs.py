"""What a message costs the processors at its two ends beside packing and unpacking it, measured over real sockets.

Messages of two sizes are sent over ZeroMQ with the keys that any local cluster has. The calling thread's time, less
what packing and unpacking take, is that of calls of ZeroMQ; what the process takes beyond is that of its own threads,
which encrypt, decrypt and copy.
"""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass

from wdpm.cluster.batch import Batch, Kind, zeros
from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.transport.registry import transport_of
from wdpm.cluster.transport.transport import Connection, Listener, Network, Role
from wdpm.cluster.transport.zeromq.run_keys import RunKeys, slave_keys
from wdpm.scenes.errors import ClusterError

ADDRESS = "tcp://127.0.0.1:0"
SMALL, LARGE = 50, 40_000
"""Hits of a message: a kB, and a MB."""
MESSAGES = (400, 60)
"""Of each size."""
PATIENCE_S = 20.0


@dataclass(frozen=True)
class MessageCosts:
    """Seconds of a core for a message, at each of its ends.

    Attributes:
        call_s: of the thread that sends or receives.
        carry_s: of the library's own thread, ...
        carry_byte_s: ... and for each byte.
    """

    call_s: float
    carry_s: float
    carry_byte_s: float

    def carrying(self, size: int) -> float:
        """Seconds of the library's thread for a message of so many bytes."""
        return self.carry_s + self.carry_byte_s * size


FREE = MessageCosts(0.0, 0.0, 0.0)
"""Messages that cost no processor anything."""


def measure() -> MessageCosts:
    """Send messages through this machine's loopback interface; ClusterError if they do not come."""
    keys = RunKeys()
    transport = transport_of(ADDRESS)
    accepted = {**packing.by_name(protocol.FromPeer), **packing.by_name(protocol.FromSlave)}
    with ExitStack() as stack:
        here, there = transport.open(keys.master), transport.open(slave_keys(keys.for_slave()))
        stack.callback(here.close)
        stack.callback(there.close)
        listener = here.listen(ADDRESS, Role.MASTER, accepted)
        connection = there.connect(listener.endpoint, Role.MASTER, {})
        connection.send(protocol.Goodbye("the first message, by which they know each other"))
        listener.admit(_receive(here, listener, 1))
        small, large = (
            _carry(here, listener, connection, count, items)
            for count, items in zip(MESSAGES, (SMALL, LARGE), strict=True)
        )
    byte_s = max((large.carry_s - small.carry_s) / (large.size - small.size), 0.0)
    return MessageCosts(small.call_s / 2, max(small.carry_s - byte_s * small.size, 0.0) / 2, byte_s / 2)


@dataclass(frozen=True)
class _Carried:
    size: int
    call_s: float
    carry_s: float


def _carry(network: Network, listener: Listener, connection: Connection, count: int, items: int) -> _Carried:
    """What a message with so many hits takes, at both ends together."""
    message = protocol.PeerBatches(1, (Batch.of_task(Kind.PROBED, 0, 0, 0, 1, zeros(Kind.PROBED, items)),))
    frames = packing.encode(message)
    whole = [bytes(frame) for frame in frames]
    expected = packing.by_name(protocol.FromPeer)
    began = time.thread_time()
    for _ in range(count):
        packing.encode(message)
        packing.decode(whole, expected)
    packed_s = time.thread_time() - began
    began, all_began = time.thread_time(), time.process_time()
    for _ in range(count):
        connection.send(message)
    _receive(network, listener, count)
    call_s, all_s = time.thread_time() - began, time.process_time() - all_began
    return _Carried(sum(map(len, whole)), max(call_s - packed_s, 0.0) / count, max(all_s - call_s, 0.0) / count)


def _receive(network: Network, listener: Listener, count: int) -> bytes:
    """Take in so many messages; who sent the last one."""
    identity, deadline = b"", time.monotonic() + PATIENCE_S
    while count:
        received = listener.receive()
        if received is not None:
            identity, count = received[0], count - 1
        elif time.monotonic() > deadline:
            raise ClusterError(f"messages to {ADDRESS} did not come within {PATIENCE_S:g} s; is loopback cut off?")
        else:
            network.wait(0.05)
    return identity
