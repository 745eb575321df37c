"""How other threads reach the thread of a loop while it waits for messages."""

from __future__ import annotations

from collections import deque
from typing import Any

from wdpm.cluster.transport import stream

_MOST_RINGS = 64
"""Items taken in one turn."""


class Mailbox:
    """Hands objects to the thread that waits for `fd`, from any other thread.

    A pair of sockets rings, not a ZeroMQ socket: a thread that hangs in a long kernel may be left behind with it, and
    would keep a ZeroMQ context from ending. Nor a pipe, which Windows cannot wait for.
    """

    def __init__(self) -> None:
        self._ear, self._bell = stream.pair()
        self._ear.setblocking(False)
        self.fd = self._ear.fileno()
        self._items: deque[Any] = deque()

    def put(self, item: Any) -> None:
        """Called by another thread."""
        self._items.append(item)
        self._bell.sendall(b".")

    def take(self) -> list[Any]:
        """Called by the waiting thread: all that has come, in order."""
        try:
            rings = len(self._ear.recv(_MOST_RINGS))
        except BlockingIOError:
            return []
        return [self._items.popleft() for _ in range(rings)]

    def close(self) -> None:
        """Once no thread uses it any more."""
        self._ear.close()
        self._bell.close()
