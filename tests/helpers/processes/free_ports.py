"""Ports of this machine at which nobody listens, and that nobody is given unasked."""

from __future__ import annotations

import os
import random
import socket

_PORTS = range(12_000, 30_000)
"""Below those that systems give to whoever asks for any port (32768 up on Linux, 49152 up elsewhere): another process
would be given one of them between the moment when it is found free and the moment when a test listens there."""

_ORDER = random.Random(os.getpid())
"""Of each process its own: tests run side by side."""


def free_port() -> int:
    """A port of 127.0.0.1 that is free; not the same one soon again."""
    while True:
        port = _ORDER.choice(_PORTS)
        try:
            with socket.create_server(("127.0.0.1", port)):
                return port
        except OSError:
            continue
