"""Files of a cluster's keys, as ZeroMQ's own tools write them.

    FOLDER/master.key, master.key_secret   the master's pair
    FOLDER/slaves/NAME.key                 public keys of the slaves that are let in
    FOLDER/readers/NAME.key                public keys of those who may ask how far a render is (`wdpm status`)
    FOLDER/NAME/                           for the slave NAME, to be moved to its machine: its own pair (slave.key,
                                           slave.key_secret) and the master's public key (master.key)

The master reads FOLDER, a slave the folder that was made for it: nobody has a secret that is not its own. A slave whose
file in FOLDER/slaves is removed is let in no more, one whose file is added is let in at once.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import zmq.auth

from wdpm.cluster.transport import local_sockets
from wdpm.cluster.transport.address import is_loopback
from wdpm.cluster.transport.keys import KeyPair, Keys, KnownKeys
from wdpm.cluster.transport.transport import Role
from wdpm.scenes.errors import SettingsError

SLAVES = "slaves"
"""Where in a master's folder the public keys of its slaves are."""

READERS = "readers"
"""Where those are of people and programs that only look."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")

_READ_AGAIN_S = 1.0
"""Whoever knocks more often than this does not have the folder read again."""


def make_keys(folder: Path) -> list[Path]:
    """Make the pair of a master in a new folder that only its owner can read; returns the files.

    Raises:
        SettingsError: the folder exists already, or cannot be made or written to.
    """
    with _new_folder(folder):
        _make_folder(folder / SLAVES)
        return _make_pair(folder, "master")


def add_slave(folder: Path, name: str, *, reader: bool = False) -> list[Path]:
    """Make a pair for one more slave of a master; returns what was made: a public key, and a folder to be moved.

    Args:
        folder: of `make_keys`.
        name: of the slave; letters, digits, dots, dashes and underscores.
        reader: it may only ask how far a render is.

    Raises:
        SettingsError: the folder is none of a master, the name is none or is taken, or a file cannot be written.
    """
    if _NAME.fullmatch(name) is None or name in (SLAVES, READERS):
        raise SettingsError(f"'{name}' is no name of a slave; expected letters, digits, '.', '-' and '_'")
    _load_public(folder / "master.key")
    public = folder / (READERS if reader else SLAVES) / f"{name}.key"
    if not public.parent.exists():
        _make_folder(public.parent)
    if public.exists():
        raise SettingsError(
            f"{public} exists already; choose another name, or remove the file to let that slave in no more"
        )
    own = folder / name
    part = public.with_name(f".{public.name}.part")  # a master that reads the folder now finds a whole key or none
    with _new_folder(own):
        try:
            _make_pair(own, "slave")
            shutil.copy(folder / "master.key", own)
            shutil.copy(own / "slave.key", part)
            part.replace(public)  # last: nobody is let in whose keys are not complete
        finally:
            part.unlink(missing_ok=True)
    return [public, own]


class KeyFolder:
    """The owners of all public keys in a folder, which is read while people add and remove files.

    Args:
        folder: of files NAME.key.
        may_be_empty: there need not be one, nor the folder.

    Raises:
        SettingsError: one of them is no key, or there is none.
    """

    def __init__(self, folder: Path, *, may_be_empty: bool = False) -> None:
        self._folder = folder
        self._known = {_load_public(path) for path in folder.glob("*.key")}
        self._read_at = time.monotonic()
        if not self._known and not may_be_empty:
            raise SettingsError(
                f"{folder} has no key of a slave; make one for each with `wdpm keys add {folder.parent} NAME`"
            )

    def admits(self, public: bytes) -> bool:
        """Whether one of the files has this key by now; a file that cannot be read lets nobody in."""
        if time.monotonic() - self._read_at >= _READ_AGAIN_S:
            self._known = set(self._readable())
            self._read_at = time.monotonic()
        return public in self._known

    def _readable(self) -> Iterator[bytes]:
        for path in self._folder.glob("*.key"):
            with contextlib.suppress(SettingsError):  # half written, perhaps: whoever owns it tries again
                yield _load_public(path)


def load_keys(folder: Path, role: Role) -> Keys:
    """Read what a process of this role needs: a master the folder of make_keys, a slave its own of add_slave.

    Raises:
        SettingsError: something is missing, damaged, or can be read by others.
    """
    if role is Role.SLAVE and (folder / SLAVES).exists():
        raise SettingsError(
            f"{folder} has the master's keys; give the slave the folder that `wdpm keys add {folder} NAME` makes"
        )
    own = _load_pair(folder / f"{role.value}.key_secret")
    master = _load_public(folder / "master.key")
    if role is Role.SLAVE:
        return Keys(own, master, KnownKeys())
    return Keys(own, master, KeyFolder(folder / SLAVES), KeyFolder(folder / READERS, may_be_empty=True))


def reader_keys(folder: Path) -> Keys:
    """The keys of somebody who asks a master how far it is: those of a reader or a slave, or the master's own.

    Raises:
        SettingsError: something is missing, damaged, or can be read by others.
    """
    is_master = (folder / SLAVES).exists()
    own = _load_pair(folder / ("master.key_secret" if is_master else "slave.key_secret"))
    return Keys(own, _load_public(folder / "master.key"), KnownKeys())


def keys_for(resolved: str, folder: Path | None, insecure: bool, role: Role) -> Keys | None:
    """The keys to use at an address; None for no security.

    Raises:
        SettingsError: others than this machine can reach the address, and neither keys nor `insecure` are given.
    """
    if folder is not None:
        return load_keys(folder, role)
    if insecure or local_sockets.is_local(resolved) or is_loopback(resolved):
        return None
    raise SettingsError(
        f"{resolved} can be reached from other machines: make keys with `wdpm keys` and give --keys FOLDER to the "
        "master and every slave, or accept anyone who reaches the port with --insecure"
    )


def is_open_to_others(found: os.stat_result) -> bool:
    """Whether others than this user can read a file.

    One that root keeps for a group counts as none: so Kubernetes gives secrets to processes that are not root.
    """
    kept_by_root = found.st_uid == 0 != os.geteuid()
    return bool(found.st_mode & (0o007 if kept_by_root else 0o077))


def _load_pair(path: Path) -> KeyPair:
    public, secret = _load(path, secret=True)
    if secret is None or len(secret) != 40:
        raise SettingsError(f"{path} holds no secret key; make it with `wdpm keys`")
    return KeyPair(public, secret)


def _load_public(path: Path) -> bytes:
    return _load(path, secret=False)[0]


def _load(path: Path, *, secret: bool) -> tuple[bytes, bytes | None]:
    try:
        # Windows has lists of rights in place of a mode, in which a file is its owner's unless somebody shared it.
        if secret and os.name == "posix" and is_open_to_others(path.stat()):
            raise SettingsError(f"{path} can be read by others: run `chmod 600 {path}`")
        public, private = zmq.auth.load_certificate(path)
    except OSError as error:
        reason = error.strerror or "no such file"
        raise SettingsError(f"cannot read the key {path}: {reason}; make it with `wdpm keys`") from None
    except ValueError as error:
        raise SettingsError(f"{path} holds no key ({error}); make it with `wdpm keys`") from None
    if len(public) != 40:
        raise SettingsError(f"{path} holds no key; make it with `wdpm keys`")
    return public, private


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(mode=0o700, parents=True)
    except FileExistsError:
        raise SettingsError(f"{folder} exists already; name a new folder, so that no key is overwritten") from None
    except OSError as error:
        raise SettingsError(f"cannot make the folder {folder}: {error.strerror}") from None


@contextlib.contextmanager
def _new_folder(folder: Path) -> Iterator[None]:
    """A folder that is made and filled while this is open; where that fails it goes again, for half a key is none.

    Raises:
        SettingsError: it exists already, or it or something in it cannot be written.
    """
    _make_folder(folder)
    try:
        yield
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, OSError):
            raise SettingsError(f"cannot write {error.filename or folder}: {error.strerror}") from None
        raise


def _make_pair(folder: Path, name: str) -> list[Path]:
    paths = [Path(path) for path in zmq.auth.create_certificates(folder, name)]
    for path in paths:
        path.chmod(0o600)
    return paths
