"""A master without sockets: tests put events in, and read its instructions."""

from __future__ import annotations

from typing import Any

from fake_worker import make_session, make_view, maps_built, triangles

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Master, Phase
from wdpm.cluster.messages import protocol as p

VERSIONS = {"code": "1"}
LIMITS = ClusterLimits(
    heartbeat_s=1.0,
    photon_task_paths=100,
    part_triangles=4,
    cells_in_flight=1,
    shared_in_flight=3,
    record_home_rays=1,
)
A, B, C = b"a", b"b", b"c"
EPOCH = 1


class Driver:
    """Feeds a master, and keeps the time."""

    def __init__(self, slaves: int = 2, limits: ClusterLimits = LIMITS) -> None:
        self.master = Master(slaves, VERSIONS, limits)
        self.now = 0.0

    def __call__(self, event: m.Event) -> list[m.Instruction]:
        self.now += 0.001
        out = self.master.handle(event, self.now)
        if m.GoOnLater() in out:
            out.remove(m.GoOnLater())
            out += self(m.GoOn())
        return out

    def says(self, identity: bytes, message: p.FromSlave) -> list[m.Instruction]:
        return self(m.SlaveSaid(identity, message))

    def join(self) -> Driver:
        for number, identity in enumerate((A, B)):
            self.says(identity, hello(number))
        assert self.master.phase is Phase.IDLE
        return self

    def to_photons(self, **session: Any) -> list[m.Instruction]:
        """As far as the first photon tasks."""
        self.join()
        self(m.Begin(make_session(2, 2, **{"paths": 450, **session})))
        self(m.PartitionMade(0, triangles(3)))
        self.says(A, p.PartitionReceived(EPOCH, 0))
        self(m.PartitionMade(1, triangles(3)))
        self.says(B, p.PartitionReceived(EPOCH, 1))
        self.says(A, p.Ready(EPOCH))
        return self.says(B, p.Ready(EPOCH))

    def to_buckets(self) -> list[m.Instruction]:
        """As far as the first buckets."""
        self.to_photons(paths=0, view=make_view(64, 32, 16))
        for answer in (maps_built(EPOCH), p.ViewSet(EPOCH)):
            self.says(A, answer)
            out = self.says(B, answer)
        assert self.master.phase is Phase.BUCKETS
        return out


def hello(process: int = 0, versions: dict[str, str] | None = None) -> p.Hello:
    return p.Hello(VERSIONS if versions is None else versions, "host", process, 1, 0, f"tcp://peer:{process}")


def sent(instructions: list[m.Instruction], identity: bytes | None = None) -> list[Any]:
    """Messages among instructions, to one slave or to all."""
    return [i.message for i in instructions if isinstance(i, m.Send) and (identity is None or i.identity == identity)]


def noted(instructions: list[m.Instruction]) -> str:
    """What people are told."""
    return "; ".join(i.text for i in instructions if isinstance(i, m.Noted))


def tasks_of(instructions: list[m.Instruction], identity: bytes) -> list[Any]:
    return [message.task for message in sent(instructions, identity) if isinstance(message, p.StartTask)]


def broken(instructions: list[m.Instruction]) -> str:
    """Why the cluster ended; everybody must have been told to stop."""
    reasons = [i.reason for i in instructions if isinstance(i, m.Broken)]
    assert len(reasons) == 1
    assert [type(message) for message in sent(instructions, A)][-1] is p.Stop
    assert [type(message) for message in sent(instructions, B)][-1] is p.Stop
    return reasons[0]
