"""What `wdpm bench peers` measures, as a table and as JSON."""

from __future__ import annotations

import statistics
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from wdpm.bench.mitsuba import Cost
from wdpm.bench.peers_grid import Member
from wdpm.bench.peers_law import Answer, ErrorLaw, Point
from wdpm.images.comparison import RELATIVE_FLOOR, Region
from wdpm.report.grid import Grid
from wdpm.report.tables import format_seconds
from wdpm.scenes.errors import SettingsError

DEFAULT_ERRORS = (0.05, 0.02, 0.01, 0.005)


@dataclass(frozen=True)
class Bounds:
    """What is to be reached, and how long may be tried.

    Attributes:
        errors: relMSE, falling.
        region: left, top, right, bottom of the pixels that count; None for all.
        rounds: renders that confirm a choice.
        limit_s: nothing is rendered that adds work to what took longer than this on all threads [s].
    """

    errors: tuple[float, ...] = DEFAULT_ERRORS
    region: Region | None = None
    rounds: int = 2
    limit_s: float = 60.0

    def __post_init__(self) -> None:
        for error in self.errors:
            if not 0 < error < float("inf"):
                raise SettingsError(f"error is {error}; expected a positive relMSE")
        object.__setattr__(self, "errors", tuple(sorted(set(self.errors), reverse=True)))


@dataclass(frozen=True)
class Try:
    """A member of the grid, rendered."""

    member: Member
    error: float
    cost: Cost


@dataclass(frozen=True)
class Confirmed:
    """A choice of settings, rendered with other seeds.

    Attributes:
        wdpm: medians of the times and mean of the errors.
        turns: renders of Mitsuba, one after each of wdpm.
    """

    wdpm: Try
    turns: tuple[Point, ...]

    @property
    def speed(self) -> Point:
        """Mitsuba's in the meantime: the medians of the times."""
        walls, cpus = ([getattr(turn.cost, name) for turn in self.turns] for name in ("wall_s", "cpu_s"))
        return replace(self.turns[0], cost=Cost(statistics.median(walls), statistics.median(cpus)))


@dataclass(frozen=True)
class Reached:
    """An error bound, and what it takes.

    Attributes:
        wdpm: the least that reached it; None if nothing did.
        mitsuba: what it takes there.
    """

    bound: float
    wdpm: Try | None
    mitsuba: Answer

    @property
    def ratio(self) -> Cost | None:
        """Of wdpm's times to Mitsuba's."""
        if self.wdpm is None:
            return None
        ours, theirs = self.wdpm.cost, self.mitsuba.cost
        return Cost(ours.wall_s / theirs.wall_s, ours.cpu_s / theirs.cpu_s)


@dataclass(frozen=True)
class PeerFigures:
    """What was measured of a scene.

    Attributes:
        tries: members that were rendered, by rising number of samples.
        skipped: members that were not, because one with less work had taken too long already.
        refused: family -> why wdpm does not render the scene that way.
        law: of Mitsuba.
        reached: by bound, falling.
    """

    scene: Path
    reference: Path
    size: tuple[int, int]
    threads: int
    bounds: Bounds
    mitsuba_version: str
    tries: tuple[Try, ...]
    skipped: tuple[Member, ...]
    refused: dict[str, str]
    law: ErrorLaw
    reached: tuple[Reached, ...]

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            **{name: str(getattr(self, name)) for name in ("scene", "reference")},
            **{name: getattr(self, name) for name in ("size", "threads", "mitsuba_version", "refused")},
            "bounds": asdict(self.bounds),
            "tries": [_try_to_dict(each) for each in self.tries],
            "skipped": [member.name for member in self.skipped],
            "mitsuba": {**asdict(self.law), "constant": self.law.constant, "slope": self.law.slope},
            "reached": [
                {
                    "error": each.bound,
                    "wdpm": None if each.wdpm is None else _try_to_dict(each.wdpm),
                    "mitsuba": asdict(each.mitsuba),
                    "ratio": None if each.ratio is None else asdict(each.ratio),
                }
                for each in self.reached
            ],
        }

    def grid(self) -> Grid:
        """The table."""
        columns = ("relMSE", "wdpm", "reached", "time", "CPU", "Mitsuba", "time", "CPU", "ratio", "CPU ratio")
        size = f"{self.size[0]}x{self.size[1]}"
        title = f"{self.scene}, {size}, {self.threads} threads, Mitsuba {self.mitsuba_version} path"
        return Grid(title, columns, tuple(_row(each) for each in self.reached), self._notes())

    def _notes(self) -> tuple[str, ...]:
        region = "" if self.bounds.region is None else f" of pixels {self.bounds.region}"
        law, spp = self.law, sorted({point.spp for point in self.law.points})
        slope = "" if law.slope is None else f" (a line through them: samples^{law.slope:.2f})"
        notes = [
            f"relMSE{region}: mean of (a - b)² / (b² + {RELATIVE_FLOOR:g}).",
            f"wdpm: what should take the least CPU time, from {len(self.tries)} choices of settings "
            f"({len(self.skipped)} more left out as slower); figures of {self.bounds.rounds} renders with other seeds, "
            "by turns with Mitsuba.",
            f"Mitsuba: {law.constant:.3g} / samples, measured at {', '.join(map(str, spp))}{slope}; * is beyond them.",
        ]
        if any(each.wdpm is None for each in self.reached):
            best = min(self.tries, key=lambda each: each.error)
            notes.append(f"-: nothing tried reaches it; the best has {best.error:.4f} ({best.member.name}).")
        notes += [f"{name}: not rendered: {why}" for name, why in self.refused.items()]
        return tuple(notes)


def _row(each: Reached) -> tuple[str, ...]:
    mark = "*" if each.mitsuba.extrapolated else ""
    theirs = (
        f"{each.mitsuba.spp:,.0f} samples{mark}",
        *(format_seconds(seconds) + mark for seconds in (each.mitsuba.cost.wall_s, each.mitsuba.cost.cpu_s)),
    )
    if each.wdpm is None or each.ratio is None:
        return f"{each.bound:g}", "-", "-", "-", "-", *theirs, "-", "-"
    ours = each.wdpm
    return (
        f"{each.bound:g}",
        ours.member.name,
        f"{ours.error:.4f}",
        format_seconds(ours.cost.wall_s),
        format_seconds(ours.cost.cpu_s),
        *theirs,
        f"{each.ratio.wall_s:.2f}",
        f"{each.ratio.cpu_s:.2f}",
    )


def _try_to_dict(each: Try) -> dict[str, Any]:
    member = each.member
    settings = {"photons": member.photons, "spp": member.spp, "passes": member.family.passes}
    chosen = {"indirect": member.family.indirect.value, "integrator": member.family.integrator.value}
    return {"name": member.name, **settings, **chosen, "error": each.error, "cost": asdict(each.cost)}
