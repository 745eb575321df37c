"""Messages over a stream between a process and those that it has forked: frames, with their lengths ahead.

Both ends are this program, at the same version and on the same machine. Frames are those of `messages.packing`.
"""

from __future__ import annotations

import contextlib
import socket
import struct
from collections.abc import Sequence

from wdpm.cluster.messages.frames import Frame

Stream = socket.socket
"""One end."""

_COUNT = struct.Struct("<I")


def pair() -> tuple[Stream, Stream]:
    """The two ends of a new stream. They have no name, so nothing is left behind when both are closed."""
    return socket.socketpair()


def end(stream: Stream) -> None:
    """Close a stream so that the other end sees it, though processes that were forked meanwhile have copies of this."""
    with contextlib.suppress(OSError):  # it is closed, or the other end is gone
        stream.shutdown(socket.SHUT_RDWR)
    stream.close()


def send(stream: Stream, frames: Sequence[Frame]) -> None:
    """Send frames; waits until the other end has room. OSError if it is gone."""
    sizes = [memoryview(frame).nbytes for frame in frames]
    stream.sendall(_COUNT.pack(len(frames)) + struct.pack(f"<{len(frames)}Q", *sizes))
    for frame in frames:
        stream.sendall(frame)


def receive(stream: Stream) -> list[Frame] | None:
    """The next frames; waits for them. None if the other end is gone, at whatever point."""
    head = _read(stream, _COUNT.size)
    if head is None:
        return None
    (count,) = _COUNT.unpack(head)
    sizes = _read(stream, 8 * count)
    if sizes is None:
        return None
    frames: list[Frame] = []
    for size in struct.unpack(f"<{count}Q", sizes):
        frame = _read(stream, size)
        if frame is None:
            return None
        frames.append(frame)
    return frames


def _read(stream: Stream, size: int) -> bytearray | None:
    buffer = bytearray(size)
    rest = memoryview(buffer)
    while rest:
        try:
            got = stream.recv_into(rest)
        except ConnectionResetError:
            return None
        if got == 0:
            return None
        rest = rest[got:]
    return buffer
