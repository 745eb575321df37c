"""Keys of one run, for slaves that a master starts itself: they live in memory and go over a pipe, never to a file."""

from __future__ import annotations

import zmq

from wdpm.cluster.transport.keys import KeyPair, Keys, KnownKeys
from wdpm.scenes.errors import SettingsError

FROM_STANDARD_INPUT = "-"
"""In place of a folder of keys: they are the first line of standard input."""

KEY_LENGTH = 40
"""Of a key in Z85."""


def new_pair() -> KeyPair:
    """A new pair."""
    return KeyPair(*zmq.curve_keypair())


class RunKeys:
    """New keys for a run.

    Attributes:
        master: what the master has.
    """

    def __init__(self) -> None:
        self._slaves = KnownKeys()
        own = new_pair()
        self.master = Keys(own, own.public, self._slaves)

    def for_slave(self) -> bytes:
        """A pair for one more slave, whom the master lets in from now on; as the line that the slave gets."""
        public, secret = zmq.curve_keypair()
        self._slaves.add(public)
        return b" ".join((self.master.own.public, public, secret)) + b"\n"


def slave_keys(line: bytes) -> Keys:
    """What a slave got as one line; SettingsError if it is something else."""
    words = line.split()
    if len(words) != 3 or any(len(word) != KEY_LENGTH for word in words):
        raise SettingsError("--keys - : the first line of standard input is no keys of a run; give a folder of keys")
    master, public, secret = words
    return Keys(KeyPair(public, secret), master, KnownKeys())
