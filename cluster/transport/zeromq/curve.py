"""CURVE (Curve25519) encrypts all connections of a cluster and proves both ends."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import zmq
from zmq.auth.thread import ThreadAuthenticator

from wdpm.cluster.transport.keys import KeyPair, Keys

DOMAIN = "wdpm"


def serve(socket: zmq.Socket[bytes], own: KeyPair) -> None:
    """Have a socket that will be bound take only connections that `admission` lets in."""
    socket.curve_server = True
    socket.curve_publickey, socket.curve_secretkey = own.public, own.secret
    socket.zap_domain = DOMAIN.encode()


def connect(socket: zmq.Socket[bytes], own: KeyPair, server: bytes) -> None:
    """Have a socket that will connect prove itself, and talk only to the owner of the public key `server`."""
    socket.curve_serverkey = server
    socket.curve_publickey, socket.curve_secretkey = own.public, own.secret


@contextmanager
def admission(context: zmq.Context[Any], keys: Keys | None) -> Iterator[None]:
    """While open, sockets of the context that `serve` let only slaves in. Without it, CURVE would take any key."""
    if keys is None:
        yield
        return
    authenticator = ThreadAuthenticator(context)
    authenticator.start()
    try:
        authenticator.configure_curve_callback(DOMAIN, _OnlySlaves(keys.slave))
        yield
    finally:
        authenticator.stop()


class _OnlySlaves:
    def __init__(self, public: bytes) -> None:
        self._public = public

    def callback(self, domain: str, key: bytes) -> bool:  # noqa: ARG002 - the authenticator's interface
        return key == self._public
