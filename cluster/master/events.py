"""What happens to a master, and what it wants done: the vocabulary between `machine` and its shell."""

from __future__ import annotations

from dataclasses import dataclass

from wdpm.cluster.display import Bucket, Frame, SlaveSeen
from wdpm.cluster.kept import TaskKept
from wdpm.cluster.messages import protocol
from wdpm.cluster.session import Session, SessionResult
from wdpm.scenes.flat.arrays import Triangles

# Events.


@dataclass(frozen=True)
class Tick:
    """Time has passed; comes several times a heartbeat."""


@dataclass(frozen=True)
class SlaveSaid:
    """`identity` names the connection; whoever only looks says something, too."""

    identity: bytes
    message: protocol.FromSlave | protocol.FromReader


@dataclass(frozen=True)
class Unreadable:
    """A message that breaks the protocol came."""

    identity: bytes
    reason: str


@dataclass(frozen=True)
class SlaveLost:
    """A slave's connection or process is gone."""

    identity: bytes
    reason: str


@dataclass(frozen=True)
class ProcessEnded:
    """A slave's process has ended, which was started here and will not be again.

    Attributes:
        left: of the processes that were started here, those that run: nobody else can join.
    """

    process: int
    reason: str
    left: int


@dataclass(frozen=True)
class NotComing:
    """Whoever starts slaves on other machines has tried one in vain; it may be tried again.

    Attributes:
        left: of those that are still on their way, or have come.
    """

    reason: str
    left: int


@dataclass(frozen=True)
class StillAwaited:
    """Whoever starts slaves on other machines has something to tell a person of one that has not joined yet."""

    text: str


@dataclass(frozen=True)
class Begin:
    """Render a session as soon as all slaves have joined."""

    session: Session


@dataclass(frozen=True)
class WaitForSlaves:
    """Tell when all slaves have joined that are waited for."""


@dataclass(frozen=True)
class PartitionMade:
    """The answer to MakePartition."""

    cell: int
    triangles: Triangles


@dataclass(frozen=True)
class GoOn:
    """The answer to GoOnLater."""


@dataclass(frozen=True)
class Close:
    """End the cluster: all is done, or the person wants to stop.

    Attributes:
        completed: whether all is done.
    """

    reason: str
    completed: bool = True


@dataclass(frozen=True)
class Abort:
    """End the cluster: something failed here."""

    reason: str


Event = (
    Tick
    | SlaveSaid
    | Unreadable
    | SlaveLost
    | ProcessEnded
    | NotComing
    | StillAwaited
    | WaitForSlaves
    | Begin
    | PartitionMade
    | GoOn
    | Close
    | Abort
)


# Instructions.


@dataclass(frozen=True)
class Send:
    """Send a message to a slave."""

    identity: bytes
    message: protocol.FromMaster | protocol.ToReader


@dataclass(frozen=True)
class MakePartition:
    """Find the triangles of a cell, which may take long."""

    cell: int


@dataclass(frozen=True)
class GoOnLater:
    """Send what is to be sent first: what follows takes a while, which slaves have something to do in."""


@dataclass(frozen=True)
class AllJoined:
    """The answer to WaitForSlaves: the slaves that are there."""

    slaves: tuple[protocol.Hello, ...]


@dataclass(frozen=True)
class Started:
    """A phase began; `total` units of work."""

    phase: str
    total: int


@dataclass(frozen=True)
class Advanced:
    """Units of the phase's work are done."""

    amount: int


@dataclass(frozen=True)
class Noted:
    """A line for the person."""

    text: str


@dataclass(frozen=True)
class FrameBegun:
    """The image begins; for those who show it."""

    frame: Frame


@dataclass(frozen=True)
class BucketDone:
    """Pixels of the image are there; for those who show it."""

    bucket: Bucket


@dataclass(frozen=True)
class SlavesSeen:
    """What slaves hold and take now has changed; for those who show the image."""

    slaves: tuple[SlaveSeen, ...]


@dataclass(frozen=True)
class WorthKeeping:
    """A bucket or records are done; for those who keep what is finished."""

    done: TaskKept


@dataclass(frozen=True)
class Finished:
    """The session is rendered."""

    result: SessionResult


@dataclass(frozen=True)
class Broken:
    """The cluster has ended because of an error."""

    reason: str


Instruction = (
    Send
    | MakePartition
    | GoOnLater
    | AllJoined
    | Started
    | Advanced
    | Noted
    | FrameBegun
    | BucketDone
    | SlavesSeen
    | WorthKeeping
    | Finished
    | Broken
)
