"""A slave without sockets: tests put events in, and read its instructions."""

from __future__ import annotations

from typing import Any

from fake_worker import make_world, triangles

from wdpm.cluster.batch import Batch
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave import jobs as c
from wdpm.cluster.slave.machine import Slave
from wdpm.scenes.flat.arrays import Triangles

HELLO = p.Hello({}, "host", 1, 1, 0, "tcp://here:1")
WELCOME = p.Welcome(1, "cluster", 1.0, 90.0)
PEERS = ("tcp://a:1", "tcp://b:1", "tcp://c:1")
HOLDERS = (0, 1, 2, 1)
EPOCH = 3
PEER = b"peer"


class Driver:
    """Feeds a slave, number 1 of 3, which holds cells 1 and 3 of 4."""

    def __init__(self, patience: float = 60.0, rejoin: float | None = None, hold_s: float = 0.0) -> None:
        self.slave = Slave(HELLO, "tcp://master:1", patience, ClusterLimits(), rejoin, hold_s)
        self.now = 0.0

    def __call__(self, event: s.Event) -> list[s.Instruction]:
        self.now += 0.001
        return self.slave.handle(event, self.now)

    def told(self, *messages: p.FromMaster) -> list[s.Instruction]:
        return [instruction for message in messages for instruction in self(s.MasterSaid(message))]

    def peer(self, message: p.FromPeer, identity: bytes = PEER) -> list[s.Instruction]:
        return self(s.PeerSaid(identity, message))

    def computed(self, job: c.Job, *batches: Batch, **others: Any) -> list[s.Instruction]:
        return self(s.Computed(c.Outcome(job, batches, **others)))

    def ready(self) -> Driver:
        """As far as Ready; a peer has said hello."""
        self(s.Start())
        out = self.told(WELCOME, setup(), part(1), part(3))
        [build] = jobs(out)
        assert to_master(self.computed(build)) == [p.Ready(EPOCH)]
        self.peer(p.PeerHello("cluster", 0))
        return self


def setup(
    epoch: int = EPOCH,
    holders: tuple[int, ...] = HOLDERS,
    peers: tuple[str, ...] = PEERS,
    kept: tuple[int, ...] = (),
) -> p.Setup:
    return p.Setup(epoch, make_world(4), holders, peers, kept)


def part(cell: int, index: int = 0, parts: int = 1, held: Triangles | None = None, epoch: int = EPOCH) -> p.Partition:
    return p.Partition(epoch, cell, index, parts, triangles(2, 10 * cell + 2 * index) if held is None else held)


def jobs(instructions: list[s.Instruction]) -> list[c.Job]:
    return [i.job for i in instructions if isinstance(i, s.Run)]


def error_of(instructions: list[s.Instruction]) -> str:
    """Why the slave exits with an error."""
    [ending] = [i for i in instructions if isinstance(i, s.Exit)]
    assert ending.error is not None
    return ending.error


def to_master(instructions: list[s.Instruction]) -> list[Any]:
    return [i.message for i in instructions if isinstance(i, s.ToMaster)]
