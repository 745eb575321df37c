"""Every message of the cluster. docs/protocol.md describes them in words; `packing` turns them into frames.

`PROTOCOL` grows by one with every change that an older process would not understand.

Every message that belongs to a render carries the epoch of a team: the slaves that have all cells of the scene among
them. Each team has an epoch of its own, and a new one whenever its cells get new holders; a message of another epoch is
dropped, since what it speaks of is gone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Batch
from wdpm.cluster.records import Records
from wdpm.cluster.task import Task, TaskResult
from wdpm.cluster.world import NO_REGIONS, PhotonPlan, View, World
from wdpm.scenes.flat.arrays import Triangles

PROTOCOL = 37


# From a slave to the master.


@dataclass(frozen=True)
class Hello:
    """A slave asks to join.

    Attributes:
        versions: what the image's bits depend on, by name; must equal the master's.
        host: name of the machine; process: its process number there; for messages.
        threads: cores that it computes with.
        memory: main memory of the machine [bytes] ...
        own_memory: ... and what the slave may use of it, if somebody said so; 0 otherwise [bytes].
        peers: endpoint where its peers reach it.
        processes: tasks that it does at once where it holds the whole scene.
    """

    versions: dict[str, str]
    host: str
    process: int
    threads: int
    memory: int
    peers: str
    processes: int = 1
    own_memory: int = 0


@dataclass(frozen=True)
class PartitionReceived:
    """All parts of a cell have arrived: the master may send another."""

    epoch: int
    cell: int


@dataclass(frozen=True)
class Ready:
    """The cells are built and the kernels are compiled."""

    epoch: int


@dataclass(frozen=True)
class TaskDone:
    """A task whose home this slave is has ended."""

    epoch: int
    result: TaskResult


@dataclass(frozen=True)
class MapsBuilt:
    """All ghosts have arrived, and the photon maps of all cells are built.

    Attributes:
        counted: what was counted of photons here (cluster.master.statistics).
    """

    epoch: int
    counted: dict[str, Any]


@dataclass(frozen=True)
class RecordsSet:
    """The slave has the irradiance records that it was sent last."""

    epoch: int


@dataclass(frozen=True)
class ViewSet:
    """The slave can take batches of this view's buckets."""

    epoch: int


@dataclass(frozen=True)
class PhotonsForgotten:
    """The slave holds no photons any more."""

    epoch: int


@dataclass(frozen=True)
class Statistics:
    """What the slave held and did, by name."""

    epoch: int
    values: dict[str, Any]


SPENT = COMPUTING, NO_TASK, NO_RAYS, PHASE_END, SENDING = "computing", "no task", "no rays", "phase end", "sending"
"""What a slave's time goes to, as Statistics have it: computing, and waits by what ended them: a task, rays or results
of others, an order of the master between phases; and sending what a job left behind, which comes before the next.
"""


@dataclass(frozen=True)
class PeerGone:
    """The connection to a peer has broken; what travelled on it is lost."""

    number: int


@dataclass(frozen=True)
class PeerUnreachable:
    """A peer did not answer, or is not who it should be; `reason` says which."""

    number: int
    reason: str


@dataclass(frozen=True)
class Vitals:
    """What the slave's process takes now, for those who ask how far the render is.

    Attributes:
        memory: in use [bytes].
        cores: that it keeps busy, on average since it last said so.
        sent, received: by it, to and from all others [bytes/s].
    """

    memory: int = 0
    cores: float = 0.0
    sent: float = 0.0
    received: float = 0.0


@dataclass(frozen=True)
class Note:
    """A line for the person at the master."""

    text: str


@dataclass(frozen=True)
class Failed:
    """The slave cannot go on."""

    text: str


@dataclass(frozen=True)
class Goodbye:
    """The slave leaves."""

    reason: str


# From the master to a slave.


@dataclass(frozen=True)
class Welcome:
    """The slave is in.

    Attributes:
        number: its number, from 0.
        cluster: name of this cluster, which peers show each other.
        heartbeat_s: send something at least this often [s].
        liveness_s: silence that counts as death [s].
    """

    number: int
    cluster: str
    heartbeat_s: float
    liveness_s: float


@dataclass(frozen=True)
class Refuse:
    """The slave cannot join, and should not try again."""

    reason: str


@dataclass(frozen=True)
class Setup:
    """A world without photons; the slave's cells follow as Partitions, but for those that it keeps.

    Attributes:
        holders: cell -> number of the slave of the team that holds it.
        peers: number of a slave -> its endpoint for peers; empty for those that are not of the team.
        kept: cells of this world that the slave has, built, from an epoch before.
        scene: names the triangles and the world but for its photon plan: equal names are equal scenes. Slaves on one
            machine share what they make of it.
    """

    epoch: int
    world: World
    holders: tuple[int, ...]
    peers: tuple[str, ...]
    kept: tuple[int, ...] = ()
    scene: str = ""


@dataclass(frozen=True)
class Partition:
    """Triangles of a cell, or one part of them; parts follow each other in the order of the triangles' numbers.

    Attributes:
        part: from 0 to parts - 1.
    """

    epoch: int
    cell: int
    part: int
    parts: int
    triangles: Triangles


@dataclass(frozen=True)
class StartTask:
    """The slave becomes the home of a task."""

    epoch: int
    task: Task


@dataclass(frozen=True)
class Copy:
    """The photons of a cell that landed in one team are needed in another.

    Attributes:
        slave: holds the cell in the other team, and is reached at `endpoint`.
        epoch: of the other team.
    """

    cell: int
    slave: int
    epoch: int
    endpoint: str


@dataclass(frozen=True)
class BuildMaps:
    """All photons have landed: send copies to other teams, ghosts to the peers, and build maps when theirs have come.

    Attributes:
        copies: who wants what landed here, and then what was worked out here.
        awaited: how many batches of each come from other teams.
        part, parts: which part of the irradiance at photons is worked out here, from 0, and how many there are.
        regions: boxes that have all of space among them, one for each part: low corners, which are in the box, and high
            ones, which are not, float32, shape [parts, 2, 3]. A part of the irradiance is that at the photons in its
            box, and of the global map a slave is sent those in reach of them alone. Shape [0, 2, 3] where each slave
            needs all photons.
    """

    epoch: int
    copies: tuple[Copy, ...] = ()
    awaited: int = 0
    part: int = 0
    parts: int = 1
    regions: NDArray[np.float32] = field(default_factory=lambda: NO_REGIONS)


@dataclass(frozen=True)
class SetView:
    """The view of the buckets that follow."""

    epoch: int
    view: View


@dataclass(frozen=True)
class AwaitRecords:
    """Other irradiance records follow: what reads records waits for them, and all else that is started goes on."""

    epoch: int


@dataclass(frozen=True)
class SetRecords:
    """The irradiance records of all rounds so far, in place of those sent before, for what follows."""

    epoch: int
    records: Records


@dataclass(frozen=True)
class ForgetPhotons:
    """Photons will be traced again, by another plan: those of the next pass, say."""

    epoch: int
    plan: PhotonPlan


@dataclass(frozen=True)
class ReadStatistics:
    """Answer with Statistics."""

    epoch: int


@dataclass(frozen=True)
class Stop:
    """Leave the cluster and end.

    Attributes:
        completed: whether all that was to be rendered is.
    """

    reason: str
    completed: bool


@dataclass(frozen=True)
class Dismissed:
    """The sender is no member, or no longer one: it may join, under another name than it had."""

    reason: str


# Both ways.


@dataclass(frozen=True)
class Heartbeat:
    """The sender lives.

    Attributes:
        received: messages that have come there over the first connection since Hello or Welcome, but for heartbeats.
    """

    received: int = 0


@dataclass(frozen=True)
class Rejected:
    """The receiver of the last message could not use it."""

    reason: str


# Between slaves.


@dataclass(frozen=True)
class PeerHello:
    """The first message to a peer: who speaks, and of which cluster."""

    cluster: str
    number: int


@dataclass(frozen=True)
class PeerWelcome:
    """The answer to PeerHello: the slave of this number takes batches of the sender."""

    number: int


@dataclass(frozen=True)
class PeerReceived:
    """So many messages have come over this connection since PeerHello."""

    messages: int


@dataclass(frozen=True)
class PeerBatches:
    """Batches for cells and homes of the receiver: all that came of one turn of the sender's worker."""

    epoch: int
    batches: tuple[Batch, ...]


# Between a master and those who only look (`wdpm status`).


@dataclass(frozen=True)
class AskStatus:
    """How far is the render? May come from anybody who is let in, and makes nobody a slave."""


@dataclass(frozen=True)
class SlaveStatus:
    """A slave as the master knows it.

    Attributes:
        host, process, threads: what it said of itself.
        memory: main memory that it may use, or that its machine has [bytes].
        peak_memory: most that it has used, as far as it has said; 0 before it has [bytes].
        team: number of its team, from 0; -1 for none.
        cells: that it holds.
        tasks: that it is at; done: that it has done.
        busy_s: that those took, from their handing out to their results, added up [s].
        silent_s: since when nothing was heard of it [s].
        now: what its process takes; None before it has said so.
    """

    number: int
    host: str
    process: int
    threads: int
    memory: int
    peak_memory: int
    team: int
    cells: int
    tasks: int
    done: int
    busy_s: float
    silent_s: float
    now: Vitals | None = None


@dataclass(frozen=True)
class StatusReport:
    """How far a render is.

    Attributes:
        phase: what the master waits for.
        units, done: work of the phase; 0 where it is not counted.
        phase_s: since it began [s].
        images: images, or passes, that are rendered.
        expected, most: slaves that are waited for, and that there may be.
        joined, lost, refused: slaves so far.
        retried: tasks that were handed out again, since their slaves were lost.
        slaves: those that are there.
    """

    phase: str
    units: int
    done: int
    phase_s: float
    images: int
    expected: int
    most: int
    joined: int
    lost: int
    refused: int
    retried: int
    slaves: tuple[SlaveStatus, ...]


FromReader = AskStatus
ToReader = StatusReport | Rejected

Progress = PartitionReceived | Ready | TaskDone | MapsBuilt | ViewSet | RecordsSet | PhotonsForgotten | Statistics
"""What a slave says in an epoch."""

FromSlave = Hello | Progress | PeerGone | PeerUnreachable | Vitals | Note | Failed | Goodbye | Heartbeat | Rejected
Ordered = Partition | StartTask | BuildMaps | SetView | AwaitRecords | SetRecords | ForgetPhotons | ReadStatistics
"""What a slave is told in an epoch."""

FromMaster = Welcome | Refuse | Setup | Ordered | Dismissed | Stop | Heartbeat | Rejected
FromPeer = PeerHello | PeerBatches
PeerAnswer = PeerWelcome | Rejected
ToPeer = PeerAnswer | PeerReceived
"""What a slave says over a connection that a peer has made to it."""

Message = FromSlave | FromMaster | FromPeer | ToPeer | FromReader | ToReader
