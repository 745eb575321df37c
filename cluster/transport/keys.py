"""Keys of a cluster, as masters and slaves hand them to a transport."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol


@dataclass(frozen=True)
class KeyPair:
    """A CURVE key pair, as 40 characters of Z85 each; the secret stays out of messages."""

    public: bytes
    secret: bytes

    def __repr__(self) -> str:
        return f"KeyPair({self.public.decode()})"


class Guests(Protocol):
    """Whom a process lets in."""

    def admits(self, public: bytes) -> bool:
        """Whether the owner of a public key may come in. Asked each time that somebody knocks."""


class KnownKeys:
    """The owners of some public keys, to which more may be added at any time."""

    def __init__(self) -> None:
        self._known: set[bytes] = set()

    def add(self, public: bytes) -> None:
        """Let the owner of this one in, too."""
        self._known.add(public)

    def admits(self, public: bytes) -> bool:
        """Whether it has been added."""
        return public in self._known


@dataclass(frozen=True)
class Keys:
    """The keys of a cluster, as one of its processes has them: no process has a secret that is not its own.

    Attributes:
        own: its pair.
        master: public key of the master.
        guests: whom it lets in from the start. A slave's peers it learns of from the master, with their endpoints.
        readers: whom a master answers how far it is, and nothing else.
    """

    own: KeyPair
    master: bytes
    guests: Guests
    readers: Guests = field(default_factory=KnownKeys)
