"""What happens to a slave, and what it wants done: the vocabulary between `machine` and its shell."""

from __future__ import annotations

from dataclasses import dataclass

from wdpm.cluster.messages import protocol
from wdpm.cluster.slave.jobs import Job, Outcome

# Events.


@dataclass(frozen=True)
class Start:
    """The connection to the master is open for the first time."""


@dataclass(frozen=True)
class Tick:
    """Time has passed; comes several times a heartbeat."""


@dataclass(frozen=True)
class MasterSaid:
    """A message of the master came."""

    message: protocol.FromMaster


@dataclass(frozen=True)
class PeerSaid:
    """`identity` names the connection, not the slave: a PeerHello tells which that is.

    Attributes:
        more: whether another event is told at once, so that no work need begin before it: another message, or Wake.
    """

    identity: bytes
    message: protocol.FromPeer
    more: bool = False


@dataclass(frozen=True)
class Wake:
    """Nothing more is at hand, or time has passed: work may begin."""


@dataclass(frozen=True)
class PeerAnswered:
    """A peer answered over the connection to it."""

    number: int
    message: protocol.PeerAnswer


@dataclass(frozen=True)
class Unreadable:
    """A message that breaks the protocol came, from the master (identity None) or over a peer connection."""

    identity: bytes | None
    reason: str


@dataclass(frozen=True)
class Computed:
    """The job that ran is done.

    Attributes:
        ran_s: processor time of the thread that ran it [s].
    """

    outcome: Outcome
    ran_s: float = 0.0


@dataclass(frozen=True)
class ComputeFailed:
    """The worker raised; `text` says what."""

    text: str


@dataclass(frozen=True)
class PeerLost:
    """The connection to a peer is gone.

    Attributes:
        reason: why it was given up, where it did not break.
    """

    number: int
    reason: str = ""


@dataclass(frozen=True)
class MasterLost:
    """The connection to the master is gone."""

    reason: str = "the connection broke"


@dataclass(frozen=True)
class MasterReached:
    """Somebody at the master's address has taken the connection; what was sent arrives, unless it breaks."""


@dataclass(frozen=True)
class MasterRefused:
    """Somebody is at the master's address, but keys do not fit."""


@dataclass(frozen=True)
class Leave:
    """Someone here wants the slave to end: Ctrl-C, or the process that started it has died."""

    reason: str


Event = (
    Start
    | Tick
    | Wake
    | MasterSaid
    | PeerSaid
    | PeerAnswered
    | Unreadable
    | Computed
    | ComputeFailed
    | PeerLost
    | MasterLost
    | MasterReached
    | MasterRefused
    | Leave
)


# Instructions.


@dataclass(frozen=True)
class ToMaster:
    """Send a message to the master."""

    message: protocol.FromSlave


@dataclass(frozen=True)
class ToPeer:
    """Send a message to a peer."""

    number: int
    message: protocol.FromPeer


@dataclass(frozen=True)
class AnswerPeer:
    """Answer over a connection that somebody made to this slave: a greeting, or why a message was dropped."""

    identity: bytes
    message: protocol.PeerAnswer


@dataclass(frozen=True)
class ConnectPeers:
    """Be connected with these peers, by number and endpoint, and with no others. What stands is not touched."""

    peers: tuple[tuple[int, str], ...]


@dataclass(frozen=True)
class Run:
    """Have the worker do a job; its Outcome is due before another Run comes.

    Attributes:
        short: whether it takes no longer than to hand it to another thread and back, about.
    """

    job: Job
    short: bool = False


@dataclass(frozen=True)
class Reconnect:
    """Open a fresh connection to the master; what waits in the old one is thrown away.

    Attributes:
        fresh: whether under a name that the master has not seen: it may know the old one for lost.
    """

    fresh: bool = False


JOINED = "joined"
"""The first word of what a slave tells when it has joined: whoever started it may look for that."""


@dataclass(frozen=True)
class Tell:
    """A line for the person at the slave."""

    text: str


@dataclass(frozen=True)
class Exit:
    """End the process.

    Attributes:
        error: why, if that is a failure.
        elsewhere: whether the failure was not this slave's: the master has gone, or has ended without an image.
    """

    error: str | None
    elsewhere: bool = False


Instruction = ToMaster | ToPeer | AnswerPeer | ConnectPeers | Run | Reconnect | Tell | Exit
