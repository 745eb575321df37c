"""Whether processes of this machine can reach each other at all; for `wdpm doctor`."""

from __future__ import annotations

import socket

LOOPBACK = "127.0.0.1"
TIMEOUT_S = 2.0


def loopback_trouble() -> str | None:
    """Why a process cannot listen at 127.0.0.1 and be reached there; None if it can."""
    try:
        with socket.create_server((LOOPBACK, 0)) as listener:
            listener.settimeout(TIMEOUT_S)
            with socket.create_connection(listener.getsockname(), TIMEOUT_S) as there:
                here, _ = listener.accept()
                with here:
                    there.sendall(b"?")
                    here.settimeout(TIMEOUT_S)
                    return None if here.recv(1) == b"?" else f"{LOOPBACK} loses what is sent"
    except OSError as error:
        return f"{LOOPBACK} cannot be used: {(error.strerror or str(error)).lower()}"


def is_free(port: int) -> bool:
    """Whether nobody listens at a port of 127.0.0.1."""
    try:
        with socket.create_server((LOOPBACK, port)):
            return True
    except OSError:
        return False
