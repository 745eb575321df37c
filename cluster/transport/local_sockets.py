"""Addresses ipc://FOLDER/NAME: the system's own sockets between processes of one user, in a folder of his alone.

The system keeps everybody else out of the folder, so what goes over them need not be encrypted. For what slaves on one
machine send each other that would be most of the time that messages take (docs/measured.md).
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from wdpm.cluster.messages.endpoints import LOCAL, check_reach
from wdpm.cluster.transport import orphaned_folders
from wdpm.cluster.transport.host_share import HostShare, host_share, remove_traces
from wdpm.scenes.errors import ClusterError, SettingsError

MASTER = "master"
"""The name of the master's socket in its folder."""

LONGEST = 100
"""Bytes of a path at most. The system takes 104 to 108, with the zero at the end (unix(7))."""

_NAME_BYTES = 8


def is_local(address: str) -> bool:
    """Whether an address is one of these."""
    return address.startswith(LOCAL)


def resolve(address: str) -> str:
    """The address itself; SettingsError if it is none, or if others can enter its folder."""
    path = _path(address)
    if not path.is_absolute() or len(os.fsencode(path)) > LONGEST:
        raise SettingsError(f"'{address}' is no address; expected ipc:// and a path from / of at most {LONGEST} bytes")
    try:
        found = path.parent.stat()
    except FileNotFoundError:
        advice = check_reach(address, "")
        raise SettingsError(f"cannot use {address}: its folder is not there, or no longer; {advice}") from None
    except OSError as error:
        raise SettingsError(f"cannot use {address}: {error.strerror}") from None
    if found.st_uid != os.geteuid() or found.st_mode & 0o077:
        raise SettingsError(f"cannot use {address}: others can enter its folder; expected one of mode 700 of your own")
    return address


def check_free(address: str) -> None:
    """Raise ClusterError if there is a socket already: whoever binds there would take it from its owner."""
    if _path(address).exists():
        raise ClusterError(f"cannot listen at {address}: it is taken")


def remove(address: str) -> None:
    """Let nobody find a socket any more."""
    _path(address).unlink(missing_ok=True)


def beside(address: str) -> str:
    """A new address in the folder of another one."""
    return f"{LOCAL}{_path(address).parent}/{secrets.token_hex(_NAME_BYTES)}"


@contextlib.contextmanager
def address_for_master() -> Iterator[str | None]:
    """An address in a folder of its own, which is removed at the end; None where there can be none.

    Folders of masters that were killed with all their slaves are removed first.

    That is on Windows, whose folders have no owner and mode in this sense, and where paths of temporary files are too
    long, or have letters that no endpoint has (messages.checks).

    Raises:
        SettingsError: no folder can be made where temporary files go.
    """
    folder = _new_folder() if os.name == "posix" else None
    lock = None if folder is None else orphaned_folders.lock(folder)
    try:
        address = f"{LOCAL}{folder}/{MASTER}"
        fits = folder is not None and len(os.fsencode(folder)) + 2 + 2 * _NAME_BYTES <= LONGEST
        yield address if fits and address.isascii() and address.isprintable() else None
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def _new_folder() -> Path:
    try:
        orphaned_folders.remove_orphaned(Path(tempfile.gettempdir()))
        return Path(tempfile.mkdtemp(prefix=orphaned_folders.FOLDER_PREFIX))
    except OSError as error:
        raise SettingsError(
            f"no folder for the sockets of slaves can be made ({error.strerror}); set TMPDIR to a folder that you can "
            "write to"
        ) from None


def shared_with(address: str) -> HostShare | None:
    """What all share that have a socket in the folder of an address; None for other addresses, and other systems."""
    return host_share(_path(address).parent) if is_local(address) else None


def leave_orphaned(address: str, *, last: bool = False) -> None:
    """Remove the folder of a master that ended without doing so (it was killed), once no slave listens there.

    Args:
        last: none does any more; sockets are of slaves that were killed as well.
    """
    folder = _path(address).parent
    with contextlib.suppress(OSError):  # others of its slaves are still there, and the last of them removes it
        remove(address)
        remove_traces(folder)
        for path in folder.iterdir() if last else ():
            if path.is_socket():
                path.unlink(missing_ok=True)
        if os.listdir(folder) == [orphaned_folders.OWNER]:
            (folder / orphaned_folders.OWNER).unlink()
        folder.rmdir()


def _path(address: str) -> Path:
    return Path(address.removeprefix(LOCAL))
