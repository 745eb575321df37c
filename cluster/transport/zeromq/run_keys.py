"""Keys of one run, for slaves that a master starts itself: they live in memory and go over a pipe, never to a file."""

from __future__ import annotations

from typing import NamedTuple

import zmq

from wdpm.cluster.transport.keys import KeyPair, Keys
from wdpm.scenes.errors import SettingsError

FROM_STANDARD_INPUT = "-"
"""In place of a folder of keys: they are the first line of standard input."""

_KEY_LENGTH = 40


class RunKeys(NamedTuple):
    """Keys of a run.

    Attributes:
        master: what the master has.
        line: what a slave gets, as one line.
    """

    master: Keys
    line: bytes


def make_run_keys() -> RunKeys:
    """New keys."""
    master, slave = (KeyPair(*zmq.curve_keypair()) for _ in range(2))
    line = b" ".join((master.public, slave.public, slave.secret)) + b"\n"
    return RunKeys(Keys(master, master.public, slave.public), line)


def slave_keys(line: bytes) -> Keys:
    """What a slave got as one line; SettingsError if it is something else."""
    words = line.split()
    if len(words) != 3 or any(len(word) != _KEY_LENGTH for word in words):
        raise SettingsError("--keys - : the first line of standard input is no keys of a run; give a folder of keys")
    master, public, secret = words
    return Keys(KeyPair(public, secret), master, public)
