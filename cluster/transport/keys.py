"""Keys of a cluster, as masters and slaves hand them to a transport."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class KeyPair:
    """A CURVE key pair, as 40 characters of Z85 each; the secret stays out of messages."""

    public: bytes
    secret: bytes

    def __repr__(self) -> str:
        return f"KeyPair({self.public.decode()})"


@dataclass(frozen=True)
class Keys:
    """The keys of a cluster, as one of its processes has them: no process has a secret that is not its own.

    Attributes:
        own: the pair of a master, or the one that all slaves share.
        master, slave: the public keys of both.
    """

    own: KeyPair
    master: bytes
    slave: bytes
