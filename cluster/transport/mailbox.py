"""How other threads reach the thread of a loop while it waits for messages."""

from __future__ import annotations

import os
from collections import deque
from typing import Any

_MOST_RINGS = 64
"""Items taken in one turn."""


class Mailbox:
    """Hands objects to the thread that waits for `fd`, from any other thread.

    A pipe rings, not a ZeroMQ socket: a thread that hangs in a long kernel may be left behind with it, and would keep
    a ZeroMQ context from ending.
    """

    def __init__(self) -> None:
        self.fd, self._bell = os.pipe()
        os.set_blocking(self.fd, False)
        self._items: deque[Any] = deque()

    def put(self, item: Any) -> None:
        """Called by another thread."""
        self._items.append(item)
        os.write(self._bell, b".")

    def take(self) -> list[Any]:
        """Called by the waiting thread: all that has come, in order."""
        try:
            rings = len(os.read(self.fd, _MOST_RINGS))
        except BlockingIOError:
            return []
        return [self._items.popleft() for _ in range(rings)]

    def close(self) -> None:
        """Once no thread uses it any more."""
        os.close(self.fd)
        os.close(self._bell)
