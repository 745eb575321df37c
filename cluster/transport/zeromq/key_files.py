"""Files of a cluster's keys, as ZeroMQ's own tools write them.

One folder serves a whole cluster: the master's pair and one pair that all slaves share. Whoever has the folder can take
part; so it is to be copied over a safe way, and kept secret. A process reads its own secret key and the public ones:
slaves need no `master.key_secret`.
"""

from __future__ import annotations

from pathlib import Path

import zmq.auth

from wdpm.cluster.transport.address import is_loopback
from wdpm.cluster.transport.keys import KeyPair, Keys
from wdpm.cluster.transport.transport import Role
from wdpm.scenes.errors import SettingsError


def make_keys(folder: Path) -> list[Path]:
    """Make the keys of a cluster in a new folder that only its owner can read; returns the files.

    Raises:
        SettingsError: the folder exists already, or cannot be made.
    """
    try:
        folder.mkdir(mode=0o700, parents=True)
    except FileExistsError:
        raise SettingsError(f"{folder} exists already; name a new folder, so that no key is overwritten") from None
    except OSError as error:
        raise SettingsError(f"cannot make the folder {folder}: {error.strerror}") from None
    paths: list[Path] = []
    for name in ("master", "slave"):
        public, secret = zmq.auth.create_certificates(folder, name)
        paths += [Path(public), Path(secret)]
    for path in paths:
        path.chmod(0o600)
    return paths


def load_keys(folder: Path, role: Role) -> Keys:
    """Read of what make_keys wrote what a process of this role needs; SettingsError if it is missing or damaged."""
    own = _load_pair(folder / f"{role.value}.key_secret")
    return Keys(own, _load_public(folder / "master.key"), _load_public(folder / "slave.key"))


def keys_for(resolved: str, folder: Path | None, insecure: bool, role: Role) -> Keys | None:
    """The keys to use at an address; None for no security.

    Raises:
        SettingsError: others than this machine can reach the address, and neither keys nor `insecure` are given.
    """
    if folder is not None:
        return load_keys(folder, role)
    if insecure or is_loopback(resolved):
        return None
    raise SettingsError(
        f"{resolved} can be reached from other machines: make keys with `wdpm keys FOLDER` and give --keys FOLDER "
        "to the master and every slave, or accept anyone who reaches the port with --insecure"
    )


def _load_pair(path: Path) -> KeyPair:
    public, secret = _load(path, secret=True)
    if secret is None or len(secret) != 40:
        raise SettingsError(f"{path} holds no secret key; make it with `wdpm keys`")
    return KeyPair(public, secret)


def _load_public(path: Path) -> bytes:
    return _load(path, secret=False)[0]


def _load(path: Path, *, secret: bool) -> tuple[bytes, bytes | None]:
    try:
        if secret and path.stat().st_mode & 0o077:
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
