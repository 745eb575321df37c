"""CURVE (Curve25519) encrypts all connections of a cluster and proves both ends; who is let in is asked here."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import zmq
from zmq.utils import z85

from wdpm.cluster.limits import MOST_SLAVES
from wdpm.cluster.transport.keys import KeyPair
from wdpm.scenes.errors import ClusterError

DOMAIN = b"wdpm"

WAIT_FOR_NEWS_S = 20.0
"""How long a slave keeps somebody whom it does not know at its door: the master may be about to tell it of a new peer,
over a link that is slower than the peer's [s]."""

MOST_WAITING = 2 * MOST_SLAVES
"""Strangers at the door; more are turned away at once."""

_KEY_BYTES = 32


def serve(socket: zmq.Socket[bytes], own: KeyPair) -> None:
    """Have a socket that will be bound take only connections that a `Doorkeeper` lets in."""
    socket.curve_server = True
    socket.curve_publickey, socket.curve_secretkey = own.public, own.secret
    socket.zap_domain = DOMAIN


def connect(socket: zmq.Socket[bytes], own: KeyPair, server: bytes) -> None:
    """Have a socket that will connect prove itself, and talk only to the owner of the public key `server`."""
    socket.curve_serverkey = server
    socket.curve_publickey, socket.curve_secretkey = own.public, own.secret


def with_key(endpoint: str, public: bytes) -> str:
    """An endpoint that says who is there: tcp://HOST:PORT#KEY, the key in hexadecimal digits."""
    return f"{endpoint}#{z85.decode(public).hex()}"


def split_key(endpoint: str) -> tuple[str, bytes | None]:
    """The address in an endpoint, and the public key (Z85) of who is there, if it says so; ClusterError if that is no
    key."""
    address, marked, digits = endpoint.partition("#")
    if not marked:
        return address, None
    try:
        key = bytes.fromhex(digits)
    except ValueError:
        key = b""
    if len(key) != _KEY_BYTES:
        raise ClusterError(f"cannot connect to {endpoint!r}: what follows # is no public key")
    return address, z85.encode(key)


class _Knock(NamedTuple):
    """Somebody wants to come in.

    Attributes:
        envelope: what an answer begins with.
        until: the end of ZeroMQ's patience, or of ours.
    """

    envelope: list[bytes]
    request: bytes
    public: bytes
    until: float


class Doorkeeper:
    """Answers ZeroMQ's questions who may come in (ZAP, RFC 27), in the thread that waits for messages.

    pyzmq's authenticators answer at once. Here an answer may have to wait: a peer may be heard of from the master only
    after it has knocked.

    Args:
        admits: whether the owner of a public key (Z85) may come in, as far as is known now.
        patience_s: how long somebody unknown is kept waiting.
    """

    def __init__(
        self, context: zmq.Context[zmq.Socket[bytes]], admits: Callable[[bytes], bool], patience_s: float
    ) -> None:
        self._admits = admits
        self._patience_s = patience_s
        self._waiting: list[_Knock] = []
        self.socket: zmq.Socket[bytes] = context.socket(zmq.ROUTER)
        self.socket.linger = 0
        self.socket.bind("inproc://zeromq.zap.01")

    def answer(self) -> None:
        """Let in or turn away whoever has knocked, as far as that can be said by now."""
        now = time.monotonic()
        while self.socket.poll(0):
            if (knock := self._read(self.socket.recv_multipart(), now)) is not None:
                self._waiting.append(knock)
        still = []
        for place, knock in enumerate(self._waiting):
            if self._admits(knock.public):
                self._reply(knock, b"200", b"OK")
            elif now >= knock.until or place >= MOST_WAITING:
                self._reply(knock, b"400", b"unknown key")
            else:
                still.append(knock)
        self._waiting = still

    def close(self) -> None:
        """Nobody is let in any more."""
        self.socket.close()

    def _read(self, frames: list[bytes], now: float) -> _Knock | None:
        """A question as ZeroMQ itself puts it: identity, nothing, version, request, domain, address, identity,
        mechanism, key."""
        identity, _, version, request, domain, _, _, mechanism, *credentials = frames
        known = (version, domain, mechanism, len(credentials)) == (b"1.0", DOMAIN, b"CURVE", 1)
        public = z85.encode(credentials[0]) if known else b""
        return _Knock([identity, b"", version], request, public, now + self._patience_s)

    def _reply(self, knock: _Knock, status: bytes, text: bytes) -> None:
        self.socket.send_multipart([*knock.envelope, knock.request, status, text, knock.public, b""])
