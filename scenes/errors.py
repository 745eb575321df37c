"""Every error that wdpm raises on purpose.

    WdpmError
    ├── SceneError      something in a scene or model file; names file and line where known
    ├── SettingsError   a setting or an argument of the command line
    │   ├── JournalInUseError      another process renders the same image
    │   └── MachineError           this machine cannot compute as it is
    ├── ImageError      an image that cannot be read, written or compared
    │   ├── NotWrittenError        a file that cannot be written where it was to go
    │   └── CacheNotWrittenError   a render whose irradiance records cannot be written; has the image (cache_file.py)
    ├── GuardError      a strict render in which a guard acted
    └── ClusterError    a slave, the master or the connection between them
        ├── ProtocolError       a message that breaks docs/protocol.md
        └── ClusterEndedError   a slave whose master has ended without an image
            └── MasterLostError     a master has gone, or none answers

The message is one line for a person: what is wrong, where, what was expected, what to do.
The command line prints it without a traceback and exits with a code of its own (wdpm/exit_codes.py).
"""

from __future__ import annotations

import difflib
import errno
from collections.abc import Iterable
from pathlib import Path


class WdpmError(Exception):
    """Base of all errors that wdpm raises on purpose."""


class SceneError(WdpmError):
    """Something in a scene or model file is wrong.

    Args:
        message: what is wrong, what was expected, what to do.
        file: the file it is in, if it is in one.
        line: its line, counted from 1, where known.
    """

    def __init__(self, message: str, file: str | Path | None = None, line: int | None = None) -> None:
        self.file = None if file is None else Path(file)
        self.line = line
        where = "" if file is None else f"{file}:{line}: " if line is not None else f"{file}: "
        super().__init__(where + message)


class SettingsError(WdpmError):
    """A setting is out of range or contradicts another."""


class JournalInUseError(SettingsError):
    """Another process renders the same image, and keeps what is finished in the same file."""


class MachineError(SettingsError):
    """This machine cannot compute as it is: no kernel can be kept or loaded. Others may be fit."""


class ImageError(WdpmError):
    """An image cannot be read, written or compared."""


class NotWrittenError(ImageError):
    """A file cannot be written where it was to go: no room, no right, no folder any more."""


class GuardError(WdpmError):
    """A strict render in which a guard acted: light would have been lost, or an estimate made coarser."""


class ClusterError(WdpmError):
    """A slave, the master or the connection between them failed."""


class ProtocolError(ClusterError):
    """A message breaks docs/protocol.md."""


class ClusterEndedError(ClusterError):
    """A slave's master has gone or has ended without an image: nothing is wrong with the slave."""


class MasterLostError(ClusterEndedError):
    """A slave's master has gone, or one that is asked does not answer: it may come back."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A hint for a misspelt name, or an empty string where nothing is near."""
    near = difflib.get_close_matches(name, list(known), n=1)
    return f'; did you mean "{near[0]}"?' if near else ""


NO_MEMORY_WORDS = ("Failed to allocate", "can't start new thread")
"""How errors begin that tell of no memory: of Warp's arrays, and of the room for a thread's stack."""


def is_of_files(error: BaseException) -> bool:
    """Whether something has failed since this process, or the system, may open no more files and sockets.

    ZeroMQ's errors are none of the system's, and have its numbers.
    """
    return getattr(error, "errno", None) in (errno.EMFILE, errno.ENFILE)


def is_of_memory(error: BaseException) -> bool:
    """Whether something has failed for want of memory: numpy, the system and Warp each say it in another way."""
    if isinstance(error, OSError):
        return error.errno == errno.ENOMEM
    return isinstance(error, MemoryError) or (
        isinstance(error, RuntimeError) and str(error).startswith(NO_MEMORY_WORDS)
    )
