"""How a slave learns that the process that started it has ended: its standard input closes."""

from __future__ import annotations

import os
import select
import threading
from typing import IO

from wdpm.cluster.transport import stream


def life_line(pipe: IO[bytes], *, sockets_alone: bool = os.name != "posix") -> int:
    """A descriptor that a network can watch, which can be read once a pipe has ended.

    Args:
        sockets_alone: whether the system waits for sockets alone, as Windows does: a thread then waits for the pipe.
    """
    if not sockets_alone:
        return pipe.fileno()
    here, there = stream.pair()

    def wait() -> None:
        with there:  # closing it is what `here` is told
            pipe.read()

    threading.Thread(target=wait, name="life line", daemon=True).start()
    return here.detach()


def has_ended(line: int) -> bool:
    """Whether the process at the other end has ended by now, or has let go.

    Args:
        line: of `life_line`.
    """
    return bool(select.select([line], [], [], 0.0)[0])
