"""What `wdpm bench peers` measures, as a table and as JSON."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from wdpm.bench.peers.grid import PATH, Member, Way
from wdpm.bench.peers.law import Answer, Point
from wdpm.bench.peers.mitsuba import Cost
from wdpm.bench.peers.target import Bounds, RelMse, Target, mean_of
from wdpm.images.comparison import RELATIVE_FLOOR
from wdpm.report.grid import Grid
from wdpm.report.tables import format_seconds


@dataclass(frozen=True)
class Try:
    """A member of the grid, rendered.

    Attributes:
        chose: how it was rendered, where that was left to wdpm; else nothing.
    """

    member: Member
    errors: RelMse
    cost: Cost
    chose: str = ""


@dataclass(frozen=True)
class Confirmed:
    """A choice of settings, rendered with other seeds.

    Attributes:
        wdpm: medians of the times and means of the errors.
        turns: renders of Mitsuba, one after each of wdpm.
    """

    wdpm: Try
    turns: tuple[Point[RelMse], ...]

    @property
    def speed(self) -> Point[float]:
        """Mitsuba's in the meantime: the medians of the times."""
        walls, cpus = ([getattr(turn.cost, name) for turn in self.turns] for name in ("wall_s", "cpu_s"))
        return Point(self.turns[0].spp, 0.0, Cost(statistics.median(walls), statistics.median(cpus)))


@dataclass(frozen=True)
class Reached:
    """An error, and what it takes by one way.

    Attributes:
        way: its name.
        wdpm: the least that reached it; None if nothing did.
        by_law: what it would take by path tracing, which was not rendered with so many samples; None where it was, and
            where another way is asked for.
        mitsuba: what Mitsuba takes there.
        rejected: where only the first seed reached it: what came nearest of what was rendered with others.
    """

    target: Target
    way: str
    wdpm: Try | None
    by_law: Answer | None
    mitsuba: Answer
    rejected: Try | None = None

    @property
    def cost(self) -> Cost | None:
        """What it takes; None if that is not known."""
        if self.wdpm is not None:
            return self.wdpm.cost
        return None if self.by_law is None else self.by_law.cost

    @property
    def ratio(self) -> Cost | None:
        """Of wdpm's times to Mitsuba's."""
        return _ratio(self.cost, self.mitsuba.cost)


@dataclass(frozen=True)
class PeerFigures:
    """What was measured of a scene.

    Attributes:
        tries: members that were rendered, by rising number of samples.
        skipped: members that were not, because one with less work had taken too long already.
        refused: family -> why wdpm does not render the scene that way.
        points: Mitsuba's.
        ways: that were asked for.
        reached: by error, and there by way.
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
    points: tuple[Point[RelMse], ...]
    ways: tuple[Way, ...]
    reached: tuple[Reached, ...]

    def of_path(self, each: Reached) -> Cost | None:
        """Ratio of the times of a way to those of wdpm's own path tracing to the same error."""
        own = [other.cost for other in self.reached if other.way == PATH.name and other.target == each.target]
        return _ratio(each.cost, own[0]) if own else None

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            **{name: str(getattr(self, name)) for name in ("scene", "reference")},
            **{name: getattr(self, name) for name in ("size", "threads", "mitsuba_version", "refused")},
            "bounds": asdict(self.bounds),
            "tries": [_try_to_dict(each) for each in self.tries],
            "skipped": [member.name for member in self.skipped],
            "mitsuba": [asdict(point) for point in self.points],
            "reached": [self._reached_to_dict(each) for each in self.reached],
        }

    def _reached_to_dict(self, each: Reached) -> dict[str, Any]:
        ratios = {"ratio": each.ratio, "of_path": self.of_path(each)}
        return {
            "target": asdict(each.target),
            "way": each.way,
            "wdpm": None if each.wdpm is None else _try_to_dict(each.wdpm),
            "by_law": None if each.by_law is None else asdict(each.by_law),
            "mitsuba": asdict(each.mitsuba),
            **{name: None if ratio is None else asdict(ratio) for name, ratio in ratios.items()},
        }

    def grid(self) -> Grid:
        """The table."""
        columns = (
            "relMSE",
            "wdpm",
            "reached",
            "time",
            "CPU",
            "Mitsuba",
            "time",
            "CPU",
            "ratio",
            "CPU ratio",
            "of path",
        )
        size = f"{self.size[0]}x{self.size[1]}"
        title = f"{self.scene}, {size}, {self.threads} threads, Mitsuba {self.mitsuba_version} path"
        return Grid(title, columns, tuple(self._row(each) for each in self.reached), tuple(self._notes()))

    def _row(self, each: Reached) -> tuple[str, ...]:
        law, theirs, own = each.by_law, each.mitsuba, self.of_path(each)
        ours = ("-", "-", "-", "-")
        if each.wdpm is not None:
            done = each.wdpm
            chose = f" ({done.chose})" if done.chose else ""
            ours = (done.member.name + chose, f"{each.target.error_in(done.errors):.3g}", *_times(done.cost))
        elif law is not None:
            ours = (f"{each.way}, {law.spp:,.0f} samples*", "-", *_times(law.cost, "*"))
        mark = "*" if theirs.extrapolated else ""
        samples = (f"{theirs.spp:,.0f} samples{mark}", *_times(theirs.cost, mark))
        ratios = ("-", "-") if each.ratio is None else (f"{each.ratio.wall_s:.2f}", f"{each.ratio.cpu_s:.2f}")
        return each.target.name, *ours, *samples, *ratios, "-" if own is None else f"{own.cpu_s:.2f}"

    def _notes(self) -> Iterator[str]:
        bounds = self.bounds
        region = "" if bounds.region is None else f" of pixels {bounds.region}"
        yield f"relMSE{region}: mean of (a - b)² / (b² + {RELATIVE_FLOOR:g})." + (
            f" Trimmed: without the worst {bounds.trim:.2%} of the pixels." if bounds.trim else ""
        )
        yield (
            f"wdpm: what should take the least CPU time, of {len(self.tries)} renders ({len(self.skipped)} more left "
            f"out as slower); figures of {bounds.rounds} renders with other seeds, by turns with Mitsuba. Of path: CPU "
            "time over that of wdpm's own path tracing."
        )
        rendered = ", ".join(f"{spp:,}" for spp in sorted({point.spp for point in self.points}))
        yield f"Mitsuba rendered {rendered} samples; * is not rendered, but told by a law:"
        for trimmed in (False, True) if bounds.trim else (False,):
            law = Target(0.0, trimmed).law(self.points)
            slope = "" if law.slope is None else f" (a line through its images: samples^{law.slope:.2f})"
            yield f"error{' trimmed' if trimmed else ''} = {law.constant:.3g} / samples{slope}."
        yield from self._missed()
        yield from (f"{name}: not rendered: {why}" for name, why in self.refused.items())

    def _missed(self) -> Iterator[str]:
        """What nothing reached, once for each way and kind of error."""
        families = {way.name: way.families for way in self.ways}
        missed = {(each.way, each.target.trimmed): each for each in self.reached if each.cost is None}
        for each in missed.values():
            tries = [done for done in self.tries if done.member.family in families[each.way]]
            if tries:
                best = each.rejected or min(tries, key=lambda done: each.target.error_in(done.errors))
                found = f"the best has {each.target.error_in(best.errors):.3g} ({best.member.name})"
                seeds = " with other seeds, as one did with the first" if each.rejected else ""
                yield f"-: of {each.way} nothing tried reaches it{seeds}; {found}."


def mean_try(tries: Sequence[Try], member: Member) -> Try:
    """Of renders with different seeds: medians of the times, means of the errors."""
    cost = Cost(
        statistics.median(each.cost.wall_s for each in tries), statistics.median(each.cost.cpu_s for each in tries)
    )
    chose = " or ".join(dict.fromkeys(each.chose for each in tries))
    return Try(member, mean_of([each.errors for each in tries]), cost, chose)


def _ratio(of: Cost | None, to: Cost | None) -> Cost | None:
    return None if of is None or to is None else Cost(of.wall_s / to.wall_s, of.cpu_s / to.cpu_s)


def _times(cost: Cost, mark: str = "") -> tuple[str, str]:
    return format_seconds(cost.wall_s) + mark, format_seconds(cost.cpu_s) + mark


def _try_to_dict(each: Try) -> dict[str, Any]:
    member = each.member
    settings = {"photons": member.photons, "spp": member.spp, "passes": member.family.passes}
    chosen = {"indirect": member.family.indirect.value, "integrator": member.family.integrator.value}
    figures = {"chose": each.chose, "errors": asdict(each.errors), "cost": asdict(each.cost)}
    return {"name": member.name, **settings, **chosen, **figures}
