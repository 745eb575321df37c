"""Folders of sockets whose master was killed together with all who would have removed them: the next master does.

A master keeps a file in its folder locked for as long as it lives, however it ends (flock(2)). A folder is removed only
if nobody has that lock, if it is of the form that masters make and its user's alone, and if it holds nothing but what
clusters leave. No link is followed.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from wdpm.cluster.transport.host_share import PREFIX as MADE

FOLDER_PREFIX: Final = "wdpm-"
"""Of the names of such folders."""

OWNER: Final = "owner"
"""The file that is locked."""

_FOLDER: Final = re.compile(FOLDER_PREFIX + r"[a-z0-9_]{8}")
_LEFT: Final = re.compile(rf"master|{OWNER}|[0-9a-f]{{16}}|{MADE}[0-9a-f]{{32}}")


def lock(folder: Path) -> int | None:
    """Have nobody take a folder for orphaned while this process lives, or until the descriptor that comes is closed.

    None where there are no such locks: then no file says that the folder is one to remove, and it stays.
    """
    import fcntl

    unlocked = folder / f"{OWNER}.unlocked"  # the name that counts is given to a file that is locked already
    try:
        file = os.open(unlocked, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        unlocked.rename(folder / OWNER)
    except OSError:
        os.close(file)
        unlocked.unlink(missing_ok=True)
        return None
    return file


def remove_orphaned(parent: Path) -> None:
    """Remove all that are orphaned of the folders in another one."""
    try:
        names = os.listdir(parent)
    except PermissionError:  # one may make folders there, and not see whose there are
        return
    for name in filter(_FOLDER.fullmatch, names):
        with contextlib.suppress(OSError):  # its master lives, it is another user's, or somebody else removes it
            _remove_if_orphaned(parent / name)


def _remove_if_orphaned(path: Path) -> None:
    """OSError if it is not."""
    with _opened(path, os.O_DIRECTORY) as folder:
        found = os.fstat(folder)
        if found.st_uid == os.geteuid() and found.st_mode & 0o777 == 0o700:
            with _opened(OWNER, os.O_NONBLOCK, folder) as owner:
                _clear(path, folder, owner)


def _clear(path: Path, folder: int, owner: int) -> None:
    import fcntl

    fcntl.flock(owner, fcntl.LOCK_EX | fcntl.LOCK_NB)
    left = os.listdir(folder)
    if all(map(_LEFT.fullmatch, left)):
        for name in left:
            os.unlink(name, dir_fd=folder)
        path.rmdir()


@contextlib.contextmanager
def _opened(path: Path | str, how: int, folder: int | None = None) -> Iterator[int]:
    file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC | how, dir_fd=folder)
    try:
        yield file
    finally:
        os.close(file)
