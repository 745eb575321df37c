"""Memory that processes of one user on one machine share: what one of them has made, the others map.

Each thing has a name, and each name a small file in a folder of the user's own, with a lock (flock(2)). Whoever needs
the thing takes the lock; the first makes it, while the others wait, and writes into the file where it is. If the maker
ends, however it ends, the system gives the lock to the next one.

The memory itself has no name: it is a file in memory (memfd_create(2)), which others open by way of the process that
made it (/proc/PID/fd/N). So nothing of it is left once no process maps it, and no size of /dev/shm limits it. It is
sealed before anyone hears of it: nobody can change it or make it shorter. Where the system does not allow one of these
steps, everyone makes what he needs by himself.
"""

from __future__ import annotations

import contextlib
import hashlib
import mmap
import os
import sys
import time
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path

PREFIX = "made-"
"""Of the names of the files that say where things are."""

PATIENCE_S = 60.0
"""How long one waits for another to make something [s], before making it oneself: the other may have been stopped."""

_WAIT_FIRST_S, _WAIT_LONGEST_S = 0.002, 0.05
_ENTRY_BYTES = 128
_NOT_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)  # what is opened may be a pipe by now

NOBODY = b"-"
"""In place of where something is: whoever made it could not share it."""


class Claim:
    """The right to make something, or what is there.

    Attributes:
        found: read-only memory that another process has made; None if there is none.
    """

    def __init__(self, file: int | None, path: Path, found: memoryview | None = None) -> None:
        self._file = file
        self._path = path
        self.found = found

    def publish(self, parts: Sequence[memoryview]) -> memoryview | None:
        """Have others map these bytes, one part after another. Returns them as they are there, read-only.

        None if that cannot be: nobody else will find them then.
        """
        if self._file is None:
            return None
        try:
            memory, view = _sealed(parts)
        except OSError:
            _written(self._file, NOBODY)  # so that others need not wait for each other
            return None
        there = os.fstat(memory)
        entry = f"{os.getpid()} {memory} {there.st_dev} {there.st_ino} {there.st_size}\n".encode()
        if not _written(self._file, entry):
            os.close(memory)
            return None
        weakref.finalize(view, _let_go, memory, self._path)
        return memoryview(view)


class HostShare:
    """What processes with the same folder make once for all of them.

    Args:
        folder: of mode 700, of the user alone.
    """

    def __init__(self, folder: Path, patience: float = PATIENCE_S) -> None:
        self._folder = folder
        self._patience = patience

    @contextlib.contextmanager
    def claim(self, name: str, *, wait: bool = True) -> Iterator[Claim | None]:
        """Be alone with something for as long as the context lasts: what is there, or the right to make it.

        Args:
            wait: for whoever is at it; None comes at once otherwise, if somebody is.
        """
        path = self._folder / (PREFIX + hashlib.blake2b(name.encode(), digest_size=16).hexdigest())
        try:
            file = _locked(path, self._patience if wait else 0.0)
        except TimeoutError:
            yield Claim(None, path) if wait else None
            return
        except OSError:
            yield Claim(None, path)
            return
        try:
            found = _found(os.pread(file, _ENTRY_BYTES, 0))
        except PermissionError:  # all who need it make it, at the same time
            os.close(file)
            yield Claim(None, path)
            return
        try:
            yield Claim(file, path, found)
        finally:
            os.close(file)  # and with it goes the lock


def host_share(folder: Path) -> HostShare | None:
    """What processes of this folder share; None where the system has no such memory."""
    return HostShare(folder) if sys.platform == "linux" else None


def remove_traces(folder: Path) -> None:
    """Remove the files that say where things are; whoever is at one goes on alone."""
    for path in folder.glob(f"{PREFIX}*"):
        path.unlink(missing_ok=True)


def _locked(path: Path, patience: float) -> int:
    """A file of that path, opened, and locked; TimeoutError if somebody else has the lock all the time."""
    import fcntl

    deadline, wait = time.monotonic() + patience, _WAIT_FIRST_S
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_at(file, path):
                return file
        except BlockingIOError:
            if time.monotonic() >= deadline:
                os.close(file)
                raise TimeoutError from None
            time.sleep(wait)
            wait = min(1.5 * wait, _WAIT_LONGEST_S)
        except OSError:
            os.close(file)
            raise
        os.close(file)


def _is_at(file: int, path: Path) -> bool:
    """Whether a path still leads to an open file, and not to another one or none."""
    with contextlib.suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(file), path.stat())
    return False


def _sealed(parts: Sequence[memoryview]) -> tuple[int, mmap.mmap]:
    """A file in memory that nobody can change any more, and a view of it."""
    import fcntl

    if not hasattr(os, "memfd_create"):
        raise OSError("this Python was built without memfd_create")
    size = sum(part.nbytes for part in parts)
    memory = os.memfd_create("wdpm", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    try:
        os.ftruncate(memory, size)
        with mmap.mmap(memory, size) as room:
            _prefer_large_pages(room)
            for part in parts:
                room.write(part)
        seals = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE | fcntl.F_SEAL_SEAL
        fcntl.fcntl(memory, fcntl.F_ADD_SEALS, seals)
        return memory, _mapped(memory, size)
    except BaseException:
        os.close(memory)
        raise


def _mapped(memory: int, size: int) -> mmap.mmap:
    view = mmap.mmap(memory, size, prot=mmap.PROT_READ)
    _prefer_large_pages(view)
    return view


def _prefer_large_pages(view: mmap.mmap) -> None:
    with contextlib.suppress(OSError):  # of a kernel that has none
        view.madvise(mmap.MADV_HUGEPAGE)


def _written(file: int, entry: bytes) -> bool:
    """Write where something is; False if the disk has no room for that."""
    try:
        os.ftruncate(file, 0)
        os.pwrite(file, entry, 0)
    except OSError:
        return False
    return True


def _found(entry: bytes) -> memoryview | None:
    """The memory that an entry tells of; None if its maker is gone, or if it is not what the entry says.

    Raises:
        PermissionError: it cannot be shared, or the system keeps this process out.
    """
    import fcntl

    if entry == NOBODY:
        raise PermissionError
    try:
        process, number, device, inode, size = map(int, entry.split())
        memory = os.open(f"/proc/{process}/fd/{number}", os.O_RDONLY | _NOT_WAITING)
    except PermissionError:
        raise
    except (OSError, ValueError):
        return None
    try:
        there = os.fstat(memory)
        same = (there.st_dev, there.st_ino, there.st_size) == (device, inode, size)
        wanted = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_WRITE
        if not same or fcntl.fcntl(memory, fcntl.F_GET_SEALS) & wanted != wanted:
            return None
        return memoryview(_mapped(memory, size))
    except OSError:
        return None
    finally:
        os.close(memory)


def _let_go(memory: int, path: Path) -> None:
    """The maker needs something no more: who has mapped it goes on, and nobody else finds it."""
    path.unlink(missing_ok=True)
    os.close(memory)
