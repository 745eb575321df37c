"""Files of a cluster's keys, as ZeroMQ's own tools write them.

One folder serves a whole cluster: the master's pair and one pair that all slaves share. Whoever has the folder can take
part; so it is to be copied over a safe way, and kept secret.
"""

from __future__ import annotations

from pathlib import Path

import zmq.auth

from wdpm.cluster.transport.address import is_loopback
from wdpm.cluster.transport.keys import KeyPair, Keys
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


def load_keys(folder: Path) -> Keys:
    """Read what make_keys wrote; SettingsError if something is missing or damaged."""
    return Keys(_load(folder / "master.key_secret"), _load(folder / "slave.key_secret"))


def keys_for(resolved: str, folder: Path | None, insecure: bool) -> Keys | None:
    """The keys to use at an address; None for no security.

    Raises:
        SettingsError: others than this machine can reach the address, and neither keys nor `insecure` are given.
    """
    if folder is not None:
        return load_keys(folder)
    if insecure or is_loopback(resolved):
        return None
    raise SettingsError(
        f"{resolved} can be reached from other machines: make keys with `wdpm keys FOLDER` and give --keys FOLDER "
        "to the master and every slave, or accept anyone who reaches the port with --insecure"
    )


def _load(path: Path) -> KeyPair:
    try:
        if path.stat().st_mode & 0o077:
            raise SettingsError(f"{path} can be read by others: run `chmod 600 {path}`")
        public, secret = zmq.auth.load_certificate(path)
    except OSError as error:
        reason = error.strerror or "no such file"
        raise SettingsError(f"cannot read the key {path}: {reason}; make it with `wdpm keys`") from None
    except ValueError as error:
        raise SettingsError(f"{path} holds no key ({error}); make it with `wdpm keys`") from None
    if secret is None or len(public) != 40 or len(secret) != 40:
        raise SettingsError(f"{path} holds no secret key; make it with `wdpm keys`")
    return KeyPair(public, secret)
