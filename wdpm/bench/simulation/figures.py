"""What simulated clusters do with a scene: how much faster than one machine, and where the rest of their time goes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from wdpm.report.grid import Grid
from wdpm.report.tables import format_bytes, format_seconds

LOSSES = ("plan", "repeated", "messages", "photons", "map", "records", "render", "setup")
"""What machines do, or wait in, beside what one machine does alone; see `Run.lost`."""

WAITS = ("setup", "photons", "map", "records", "render")
"""Those that are waiting, by the phase that it is in."""

_WORDS = {
    "plan": "planning",
    "repeated": "more to compute",
    "messages": "messages",
    "setup": "waiting: set-up",
    "photons": "waiting: photons",
    "map": "waiting: maps",
    "records": "waiting: records",
    "render": "waiting: image",
}


@dataclass(frozen=True)
class Run:
    """One render by machines that are not there.

    Attributes:
        slaves, machines: that took part.
        copies: of the scene.
        seconds: simulated, of the whole render: planning, which the master does alone, and the session.
        phases: simulated seconds of the session's phases.
        alone_s: seconds of one machine, without a cluster.
        lost: shares of the machines' time that did not go to what one machine does alone, by LOSSES: slaves waited for
            the plan; they computed what others compute as well, or what one machine need not; they were at messages;
            they waited, in each phase. Below 0 where a cluster has less to do than one machine.
        wire: share of the time in which the busiest interface carried something.
        balance: the mean slave's computing over that of the slave that computed most.
        sent, messages: over all links and within machines: bytes, and how many.
        triangles, photons: that one slave held at most, as shares of all.
        bits_equal: whether the image is that of one process, bit for bit.
        host_s: seconds of one core that the simulation took here.
    """

    slaves: int
    machines: int
    copies: str
    seconds: float
    phases: Mapping[str, float]
    alone_s: float
    lost: Mapping[str, float]
    wire: float
    balance: float
    sent: int
    messages: int
    triangles: float
    photons: float
    bits_equal: bool
    host_s: float

    @property
    def speed_up(self) -> float:
        """Over one machine."""
        return self.alone_s / self.seconds

    @property
    def inflation(self) -> float:
        """Processor seconds of all machines over those of one: what `wdpm bench scaling` measures of real slaves."""
        alone = 1.0 - sum(self.lost.values())
        return (alone + self.lost["repeated"] + self.lost["messages"]) / alone

    @property
    def limit(self) -> str:
        """What most of the machines' time is lost to, in words."""
        return _WORDS[max(self.lost, key=lambda name: self.lost[name])]

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return asdict(self) | {"speed_up": self.speed_up, "inflation": self.inflation, "limit": self.limit}


@dataclass(frozen=True)
class Simulation:
    """All runs of a scene.

    Attributes:
        hardware: in words.
    """

    scene: str
    title: str
    hardware: str
    runs: tuple[Run, ...]

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "scene": self.scene,
            "title": self.title,
            "hardware": self.hardware,
            "runs": [run.to_dict() for run in self.runs],
        }

    def grid(self) -> Grid:
        """The table."""
        columns = (
            *("slaves", "copies", "time", "speed-up", "efficiency", "inflation", "plan", "more work", "messages"),
            *("waiting", "most lost to", "link", "sent", "bits"),
        )
        notes = (
            f"Simulated: {self.hardware}. Jobs and messages are those of real slaves, computed here one after another; "
            "their time is processor seconds measured here, and links are simulated.",
            "inflation: processor seconds of all machines over those of one. plan ... waiting: shares of all slaves' "
            "time that did not go to what one machine computes alone. link: share of the time in which the busiest "
            "interface carries something.",
        )
        return Grid(self.title, columns, tuple(map(_row, self.runs)), notes)


def _row(run: Run) -> tuple[str, ...]:
    waiting = sum(run.lost[name] for name in WAITS)
    lost = (f"{share:.0%}" for share in (run.lost["plan"], run.lost["repeated"], run.lost["messages"], waiting))
    return (
        f"{run.slaves}",
        run.copies,
        format_seconds(run.seconds),
        f"{run.speed_up:.2f}",
        f"{run.speed_up / run.slaves:.0%}",
        f"{run.inflation:.2f}",
        *lost,
        run.limit if run.slaves > 1 else "-",
        f"{run.wire:.0%}",
        format_bytes(run.sent),
        "equal" if run.bits_equal else "DIFFER",
    )
