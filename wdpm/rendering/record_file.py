"""Files that only grow, a record at a time, and lose no more than the last ones however their writer ends.

One process writes to such a file at a time: a lock (flock(2)) that the system lets go of when its owner ends, however
it ends, tells others so.

A record is some frames of bytes with their lengths and a sum over all. A reader takes records up to the first that is
cut off or changed: nothing after it is looked at. What frames mean is the reader's business, and is checked there.
"""

from __future__ import annotations

import contextlib
import os
import struct
import time
import weakref
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

SIGNATURE = b"wdpm journal 1\n"

_HEAD = struct.Struct("<QI")
"""Bytes of what follows, and their sum."""

_COUNT = struct.Struct("<I")
_LENGTH = struct.Struct("<Q")

SYNC_S = 5.0
"""Between two orders to the disk, at least [s]. A killed process loses nothing that it has written; a machine that
loses its power, no more than this."""

SYNC_SHARE = 0.005
"""Of the time, at most, that is spent waiting for the disk."""

Frame = bytes | bytearray | memoryview


class RecordWriter:
    """Appends records to a file.

    Args:
        path: is created, or cut off and gone on with.
        end: where the last record to keep ends; 0 to begin anew.

    Raises:
        OSError: it cannot be written; here, and from every method.
    """

    def __init__(self, path: Path, end: int = 0, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._file = path.open("r+b" if end else "wb", buffering=0)
        try:
            self._file.truncate(end)
            self._file.seek(end)
            if not end:
                _write_all(self._file.fileno(), SIGNATURE)
        except OSError:
            self._file.close()
            raise
        self._sync_at = clock() + SYNC_S
        _sync_folder(path.parent)

    def append(self, frames: Sequence[Frame]) -> None:
        """Add a record; it is in the hands of the system afterwards, and from time to time on the disk."""
        lengths = _COUNT.pack(len(frames)) + b"".join(_LENGTH.pack(_bytes_of(frame)) for frame in frames)
        total = zlib.crc32(lengths)
        for frame in frames:
            total = zlib.crc32(frame, total)
        head = _HEAD.pack(len(lengths) + sum(map(_bytes_of, frames)), total)
        for part in (head + lengths, *frames):
            _write_all(self._file.fileno(), part)
        if self._clock() >= self._sync_at:
            self.sync()

    def sync(self) -> None:
        """Have the disk take what was written. The slower it is, the more seldom it is asked."""
        began = self._clock()
        os.fsync(self._file.fileno())
        ended = self._clock()
        self._sync_at = ended + max(SYNC_S, (ended - began) / SYNC_SHARE)

    def close(self) -> None:
        """Let go of the file; may be called again."""
        self._file.close()


def read_records(path: Path) -> Iterator[tuple[list[bytes], int]]:
    """The whole records of a file, from its beginning, each with where it ends.

    Raises:
        OSError: it cannot be read.
        ValueError: it is another kind of file.
    """
    with path.open("rb") as file:
        if file.read(len(SIGNATURE)) != SIGNATURE:
            raise ValueError("it is no journal of wdpm")
        left = path.stat().st_size - len(SIGNATURE)
        while (head := file.read(_HEAD.size)) and len(head) == _HEAD.size:
            length, expected = _HEAD.unpack(head)
            left -= _HEAD.size
            if not _COUNT.size <= length <= left:  # so no more is ever asked for than there is
                return
            body = file.read(length)
            left -= length
            frames = _frames_of(body) if zlib.crc32(body) == expected else None
            if frames is None:
                return
            yield frames, file.tell()


def _frames_of(body: bytes) -> list[bytes] | None:
    """The frames of a record; None if they do not fill it."""
    (count,) = _COUNT.unpack_from(body)
    place = _COUNT.size + count * _LENGTH.size
    if place > len(body):
        return None
    lengths = [_LENGTH.unpack_from(body, _COUNT.size + number * _LENGTH.size)[0] for number in range(count)]
    if place + sum(lengths) != len(body):
        return None
    frames = []
    for length in lengths:
        frames.append(body[place : place + length])
        place += length
    return frames


def _bytes_of(frame: Frame) -> int:
    return memoryview(frame).nbytes


def _write_all(descriptor: int, data: Frame) -> None:
    left = memoryview(data).cast("B")
    while left:
        left = left[os.write(descriptor, left) :]


def _sync_folder(folder: Path) -> None:
    """Have the disk know the name of a new file, where folders can be opened."""
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


_TRIES = 8
"""To lock a file that others remove meanwhile; a disk on which a file is never the same again has no locks."""


class FileLock:
    """The right to write to a file, as long as others ask for it, too.

    Where the system or the disk has no such locks, everybody gets it.

    Args:
        path: of the file; it is created where there is none.

    Raises:
        BlockingIOError: somebody else has it.
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._file = -1
        for _ in range(_TRIES):
            if self._take(path):
                break
            self.release()
        _HELD.add(self)

    def _take(self, path: Path) -> bool:
        """Whether it is had of the file that has the name: the one before may have removed what we opened."""
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
        try:
            if not _lock(self._file):
                self.release()  # Windows takes no name from a file that is open
                return True
            return os.path.samestat(os.fstat(self._file), path.stat())
        except FileNotFoundError:
            return False
        except OSError:
            self.release()
            raise

    def release(self) -> None:
        """Let others have it; may be called again."""
        _HELD.discard(self)
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)


_HELD: weakref.WeakSet[FileLock] = weakref.WeakSet()


def _lock(file: int) -> bool:
    """Whether there are such locks: it is locked then. Raises BlockingIOError if somebody else has locked it."""
    try:
        import fcntl
    except ModuleNotFoundError:  # Windows
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a disk without locks, over the network say
        return False
    return True


def _let_go_in_child() -> None:
    """All processes with the file open have the lock: those that are forked must not keep it when this one ends."""
    for lock in list(_HELD):
        with contextlib.suppress(OSError):
            lock.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go_in_child)
