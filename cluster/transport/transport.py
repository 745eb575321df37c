"""What masters and slaves need from whatever carries their messages.

A `Transport` is one way to carry them, found by the scheme of an address (`registry`). A process opens a `Network` of
it and has there a `Listener`, which many reach, and `Connection`s to the listeners of others. All three belong to one
thread: the loops of master and slave, which know nothing else of a network. Other threads reach a loop through
a `Mailbox`.

What every implementation keeps, since the state machines rely on it:

* Messages of one sender to one receiver arrive once, in order and whole, or not at all. Heartbeats alone, which say no
  more than that their sender lives and what has come there, and Dismissed may overtake others and come twice: they must
  not wait behind bulk data.
* `send` never waits for the other end: two loops that waited for each other would wait forever.
* A connection that broke stays broken, and says so. Mending it in secret would leave a hole where the messages were
  that were under way.
* What a received message holds is checked: its type is one of those that may come there, and its parts hold
  together. What cannot be read is a `ProtocolError` in the place of a message; it is for the state machines to judge.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

from wdpm.cluster.messages.protocol import Message
from wdpm.cluster.transport.keys import Keys

Received = Any
"""A message of a type that is accepted there, right in itself; or the ProtocolError that says what is wrong with it."""

Accepted = Mapping[str, type]
"""Messages that may come somewhere, by name: `packing.by_name`."""

TURN_S = 0.25
"""Longest sleep of a loop: several a heartbeat. What comes wakes it, and so does news that a connection broke; a turn
without anything takes 0.3 ms, and three times that on a machine that is busy with other things."""

TURNS_A_HEARTBEAT = 4
"""Of a slave that has joined, if that makes its sleep longer."""

TURN_MESSAGES = 64
"""Messages that a loop takes from one place before the others get their turn."""


class Role(Enum):
    """Who listens. The master's listener and a slave's are told apart by their keys."""

    MASTER = "master"
    SLAVE = "slave"


class Listener(Protocol):
    """Where others reach this process, any number of them."""

    @property
    def endpoint(self) -> str:
        """The address under which others find it."""

    def receive(self) -> tuple[bytes, Received] | None:
        """The next message and the identity of the connection that it came over; None if there is none."""

    def send(self, identity: bytes, message: Message) -> bool:
        """Answer over a connection. False if it is known to be gone; True says no more than that it is not."""

    def admit(self, identity: bytes) -> None:
        """Take messages of any length over a connection: of a stranger only short ones without arrays are read."""


class Connection(Protocol):
    """A way to somebody's listener."""

    def send(self, message: Message) -> bool:
        """Send a message; False if the other end is gone."""

    def receive(self) -> Received | None:
        """The next answer; None if there is none."""

    def broke(self) -> bool:
        """Whether the other end has closed the connection, as `wait` has heard since this was last asked."""

    def reached(self) -> bool:
        """Whether the other end has taken the connection, as `wait` has heard since this was last asked."""

    def refused(self) -> bool:
        """Whether somebody is there, who does not know this end: keys do not fit. Asked after `broke`."""

    def close(self, *, deliver: bool) -> None:
        """Let go of it.

        Args:
            deliver: try for a moment to get rid of what has been sent; otherwise that is thrown away.
        """


@dataclass
class Carried:
    """Bytes of messages that a process has sent and received so far; of messages that stay in it, none."""

    sent: int = 0
    received: int = 0


class Network(Protocol):
    """What one process has open, with what it waits for together."""

    @property
    def carried(self) -> Carried:
        """What has gone over it."""

    def listen(self, address: str, role: Role, accepted: Accepted) -> Listener:
        """Listen at an address.

        Args:
            role: as whom.

        Raises:
            SettingsError: this is no address.
            ClusterError: nobody can listen there, or someone else does.
        """

    def connect(self, address: str, role: Role, accepted: Accepted, identity: bytes | None = None) -> Connection:
        """Begin to connect to a listener. Nothing is wrong yet if nobody listens there: `broke` or `send` may tell.

        Args:
            address: as `Transport.resolve` or `Listener.endpoint` gives it.
            role: of the listener.
            accepted: answers that may come; empty where none is ever read.
            identity: by which the listener knows the connection, at most one at a time; None for one of its own.

        Raises:
            ClusterError: this is no address, or there are no more connections.
        """

    def address_for_peers(self, master: str) -> str:
        """Where a slave of the master at a resolved address listens for the other slaves: a free one, near to them."""

    @property
    def stirred(self) -> bool:
        """Whether there may be answers, or news, of connections without an identity since `wait` was called last.

        A slave has one to each of the others, and asking them all takes its time; they say something at their beginning
        and end.
        """

    def watch(self, descriptor: int) -> None:
        """Have `wait` end when a file descriptor can be read, too: a mailbox's, or the pipe of a life line."""

    def rest(self, seconds: float) -> None:
        """Until a watched descriptor can be read or the time is over, whatever messages come meanwhile."""

    def wait(self, seconds: float) -> set[int]:
        """Until a message has come, a watched descriptor can be read or the time is over.

        Returns:
            The watched descriptors that can be read.
        """

    def close(self) -> None:
        """Close all that is open; may be called again."""


class Transport(Protocol):
    """One way to carry messages."""

    def resolve(self, address: str) -> str:
        """An address with a machine's number in place of its name, where it has one; SettingsError if it is none."""

    def open(self, keys: Keys | None) -> Network:
        """Open a network.

        Args:
            keys: of the cluster; only who has them is let in. None for no security.
        """
