"""Where master and slaves of one run find each other: a folder in a directory that all their machines share.

    FOLDER/master          the master's address and its public key
    FOLDER/slave-3.key     the public key of the third slave
    FOLDER/ended           why the master is no longer there; the last slave to come removes the folder

Every process makes a key pair of its own and tells the others only the public half. So no file holds a secret: shared
directories often go over the network in clear. That only its owner may write to the folder is what makes it true.

Files appear whole: they are written beside their place and moved. Folders are listed before a file is looked for, as
NFS remembers for up to a minute that a file was not there, but asks again when a folder is opened.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from wdpm.cluster.transport import address
from wdpm.cluster.transport.keys import Keys, KnownKeys
from wdpm.cluster.transport.zeromq.run_keys import KEY_LENGTH, new_pair
from wdpm.scenes.errors import ClusterEndedError, MasterLostError, SettingsError

PATIENCE_S = 300.0
"""How long a slave looks for the master: both are started together, but a first import on a busy file server takes its
time [s]."""

LOOK_S = 0.25
"""Between one look into the folder and the next [s]."""

MOST_BYTES = 1024
"""Of a file: an address and a key, or a line of text."""

_MASTER = "master"
_ENDED = "ended"


def meeting_folder(shared: Path, name: str) -> Path:
    """The folder of a run in a shared directory."""
    return shared.absolute() / f".wdpm-{name}"


class Guests:
    """The owners of the public keys in the folder.

    Args:
        folder: of the run.
        slaves: how many there may be.
    """

    def __init__(self, folder: Path, slaves: int) -> None:
        self._folder = folder
        self._names = {_key_name(rank) for rank in range(1, slaves + 1)}
        self._known: set[bytes] = set()

    def admits(self, public: bytes) -> bool:
        """Whether one of the slaves has left this key by now."""
        if public not in self._known:
            left = self._names.intersection(_names_in(self._folder))
            keys = [_read(self._folder / name) for name in left]
            self._known = {key for key in keys if len(key) == KEY_LENGTH}
        return public in self._known


class Rendezvous:
    """The master's side: makes the folder.

    Args:
        folder: of this run alone.
        slaves: that will come.

    Attributes:
        security: the master's keys; whoever may write to the folder is let in.

    Raises:
        SettingsError: the folder cannot be made.
    """

    def __init__(self, folder: Path, slaves: int) -> None:
        self._folder = folder
        self._slaves = slaves
        pair = new_pair()
        self.security = Keys(pair, pair.public, Guests(folder, slaves))
        try:
            folder.mkdir(mode=0o700)
        except OSError as error:
            raise SettingsError(f"cannot make the folder {folder}: {error.strerror}") from None

    def publish(self, endpoint: str) -> None:
        """Tell the slaves where the master is."""
        _write(self._folder / _MASTER, f"{endpoint} {self.security.own.public.decode()}\n")

    def close(self, reason: str) -> None:
        """The master goes; slaves that have not come yet should not wait for it."""
        if not self._folder.exists():
            return  # somebody has tidied up
        _write(self._folder / _ENDED, reason + "\n")
        _remove_if_all_came(self._folder, self._slaves)


@dataclass(frozen=True)
class Found:
    """What a slave finds.

    Attributes:
        endpoint: of the master.
        security: the slave's keys.
    """

    endpoint: str
    security: Keys


def meet(folder: Path, rank: int, slaves: int, patience: float = PATIENCE_S) -> Found:
    """The slave's side: wait for the folder, leave a key there, and find the master.

    Args:
        rank: of the slave, from 1.
        slaves: how many there are.
        patience: how long to wait [s].

    Raises:
        SettingsError: nobody has opened the folder, or somebody else than this user.
        ClusterEndedError: the master has gone again.
        MasterLostError: it has not got so far as to say where it is.
    """
    deadline = time.monotonic() + patience
    if not _wait(lambda: folder.name in _names_in(folder.parent), deadline):
        raise SettingsError(
            f"no master has made {folder} within {patience:g} s; is {folder.parent} the same folder on all nodes? "
            "--shared DIR names another"
        )
    _check_owner(folder)
    pair = new_pair()
    _write(folder / _key_name(rank), pair.public.decode())
    if not _wait(lambda: bool(_names_in(folder).intersection((_MASTER, _ENDED))), deadline):
        raise MasterLostError(f"the master has not said in {folder} where it is, within {patience:g} s")
    if _ENDED in _names_in(folder):
        reason = _read(folder / _ENDED).decode(errors="replace").strip()
        _remove_if_all_came(folder, slaves)
        raise ClusterEndedError(f"the master has ended before this slave came: {reason}")
    endpoint, _, public = _read(folder / _MASTER).decode("ascii", errors="replace").strip().partition(" ")
    if not address.is_resolved(endpoint) or len(public) != KEY_LENGTH:
        raise SettingsError(f"{folder / _MASTER} holds no address and key; did something else write there?")
    return Found(endpoint, Keys(pair, public.encode(), KnownKeys()))


def _key_name(rank: int) -> str:
    return f"slave-{rank}.key"


def _wait(there: Callable[[], bool], deadline: float) -> bool:
    while not there():
        if time.monotonic() > deadline:
            return False
        time.sleep(LOOK_S)
    return True


def _names_in(folder: Path) -> set[str]:
    try:
        return set(os.listdir(folder))
    except OSError:  # not there yet, or no more
        return set()


def _check_owner(folder: Path) -> None:
    """Raise SettingsError if somebody else may have made the folder, or write to it."""
    found = folder.lstat()
    if found.st_uid != os.geteuid() or found.st_mode & 0o170077 != 0o040000:
        raise SettingsError(f"{folder} is no folder that only you can write to; name another place with --shared DIR")


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(MOST_BYTES)
    except OSError:  # removed meanwhile
        return b""


def _write(path: Path, text: str) -> None:
    """Write a file that appears whole; SettingsError if it cannot be."""
    beside = path.with_name(f".{path.name}.part")
    try:
        beside.write_text(text)
        beside.chmod(0o600)
        beside.replace(path)
    except OSError as error:
        raise SettingsError(f"cannot write {path}: {error.strerror}") from None


def _remove_if_all_came(folder: Path, slaves: int) -> None:
    """Whoever is last of those who need the folder removes it; two who are last at once may both try."""
    if _names_in(folder).issuperset(_key_name(rank) for rank in range(1, slaves + 1)):
        with suppress(FileNotFoundError):
            shutil.rmtree(folder)
