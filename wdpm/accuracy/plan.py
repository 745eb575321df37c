"""What a sweep will cost, and the sweep that is made where none is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from wdpm.accuracy.facts import Facts
from wdpm.accuracy.knobs import KNOBS, Knob, Sweep, Value, make_sweep, photons_of, rounded
from wdpm.accuracy.points import BAND_SLAVES, Point, Points, plan_points
from wdpm.accuracy.store import Record
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.kernels.limits import MAX_K

DEFAULT_BUDGET_S = 300.0
REFERENCE_SHARE = 0.4
"""Of the budget, for a reference of our own."""

SPREADS: tuple[tuple[float, ...], ...] = (
    (1 / 16, 1 / 4, 4, 16),
    (1 / 8, 1 / 4, 1 / 2, 2, 4, 8),
    (1 / 4, 1 / 2, 2, 4),
    (1 / 4, 4),
    (1 / 4, 2),
)
"""Factors by which default sweeps turn photons and samples, the dearest first."""

CLUSTER_FACTOR = 1.3
"""Time of a render by slaves that share this machine's cores, over one without, roughly."""

INDIRECT_FACTOR = {Indirect.AUTO: 4.0, Indirect.MAP: 1.0, Indirect.GATHER: 1.5, Indirect.CACHE: 4.0}
"""Time of the camera's work, over that with the photon map alone, roughly: at few samples, where a cache costs most."""

SHADOW_RAY = 0.08
"""Time of a shadow ray more, over that of a sample with one: at most, see cluster.plan.light_samples."""


@dataclass(frozen=True)
class CostModel:
    """What a render takes, roughly, from one that was timed: for plans, not for results.

    Attributes:
        fixed: pilot and partition [s].
        photon: one stored photon [s].
        sample: one sample of every pixel, with this `k`, `indirect` and `light_samples` [s].
        light_samples: of the base, chosen by the renderer if by nobody else.
    """

    fixed: float
    photon: float
    sample: float
    k: int
    indirect: str = Indirect.AUTO.value
    light_samples: int = 1

    @classmethod
    def fitted_to(cls, point: Point, record: Record, light_samples: int) -> CostModel:
        """From a render of this point.

        Args:
            light_samples: that it had.
        """
        phases = record.phases
        photons = phases.get("photons", 0.0) + phases.get("map", 0.0)
        render = phases.get("render", 0.0)
        return cls(
            fixed=max(record.seconds - photons - render, 0.0),
            photon=photons / max(record.stored, 1),
            sample=render / point.settings.spp,
            k=point.settings.k,
            indirect=point.settings.indirect.value,
            light_samples=light_samples,
        )

    def seconds(self, point: Point, maps: Sequence[str]) -> float:
        """Of one render.

        Args:
            maps: that the scene calls for: "global", "caustic", "volume".
        """
        chosen = point.settings
        photons = sum(getattr(chosen, photons_of(kind)) for kind in maps) * chosen.passes * self.photon
        gather = 0.5 + 0.5 * chosen.k / self.k
        ways = INDIRECT_FACTOR[chosen.indirect] / INDIRECT_FACTOR[Indirect(self.indirect)]
        rays = _with_rays(chosen.light_samples or self.light_samples) / _with_rays(self.light_samples)
        alone = self.fixed + photons + chosen.spp * self.sample * gather * ways * rays
        return alone * CLUSTER_FACTOR if point.slaves else alone


def _with_rays(count: int) -> float:
    """Time of a sample with so many shadow rays, over that of one with one."""
    return 1.0 + SHADOW_RAY * (count - 1)


def total_seconds(points: Points, model: CostModel, seeds: int, maps: Sequence[str]) -> float:
    """Of a whole sweep, without its reference."""
    return seeds * sum(model.seconds(point, maps) for point in points.points)


def default_points(
    base: Point, model: CostModel, facts_of: Callable[[RenderSettings], Facts], seeds: int, seconds: float
) -> Points:
    """The widest default sweep that fits into the time; where none does, one around a base with fewer samples.

    Args:
        facts_of: of the scene, with the settings of a base.
    """
    base, sweeps = _default_plan(base, model, facts_of(base.settings), seeds, seconds)
    return plan_points(base, sweeps, facts_of(base.settings).chosen)  # a base with fewer photons has another radius


def _default_plan(base: Point, model: CostModel, facts: Facts, seeds: int, seconds: float) -> tuple[Point, list[Sweep]]:
    """The base, and the sweeps around it.

    Args:
        facts: of the base that was asked for: what changes with fewer photons, radii, takes no time.
    """
    while True:
        for factors in SPREADS:
            sweeps = default_sweeps(base.settings, factors, facts.idle)
            points = plan_points(base, sweeps, facts.chosen)
            if total_seconds(points, model, seeds, facts.maps) <= seconds:
                return base, sweeps
        if base.settings.spp == 1:
            return base, sweeps
        base = replace(base, settings=_cheaper(base.settings, facts.maps))


def default_sweeps(base: RenderSettings, factors: Sequence[float], idle: Mapping[str, str]) -> list[Sweep]:
    """Every knob that is swept by default, that this render has a use for, and to which the base leaves other values.

    Args:
        factors: one of SPREADS.
        idle: knobs that change nothing (uses.py), by name, with the reason.
    """
    wide = len(factors) > 2
    milder = [factor**0.5 for factor in factors]
    values: dict[str, Sequence[Value]] = {
        "photons": _scaled(base.photons, factors),
        "k": _scaled(base.k, milder, MAX_K),
        "radius": [1.0, *(rounded(factor, False) for factor in milder)],
        "spp": _scaled(base.spp, factors),
        "passes": [count for count in (1, min(4, base.spp), 16, 64)[: len(factors)] if count <= base.spp],
        "light_samples": [1, 4, 16] if wide else [1, 4],
        "caustic_photons": _scaled(base.caustic_photons, factors),
        "volume_photons": _scaled(base.volume_photons, factors),
        "indirect": [Indirect.MAP, Indirect.GATHER, Indirect.CACHE],
        "band": [0.0, 0.25, 0.5, 0.75, 1.0] if wide else [0.0, 0.5, 1.0],
        "slaves": [0, BAND_SLAVES],
    }
    wanted = (knob for knob in KNOBS if knob.by_default and knob.name not in idle)
    sweeps = [make_sweep(knob, list(values[knob.name]), factors=knob.factors) for knob in wanted]
    return [sweep for sweep in sweeps if len(sweep.values) > 1]


def left_out(points: Points, idle: Mapping[str, str]) -> dict[str, list[Knob]]:
    """The knobs that a default sweep does not turn, by the reason.

    Args:
        idle: as of default_sweeps.
    """
    found: dict[str, list[Knob]] = {}
    for knob in KNOBS:
        if points.curve_of(knob.name) is not None:
            continue
        reason = idle.get(knob.name) or _not_by_default(knob, points.base.settings)
        found.setdefault(reason, []).append(knob)
    return found


def _not_by_default(knob: Knob, base: RenderSettings) -> str:
    if not knob.by_default:
        return "only where --sweep asks for it"
    if knob.name == "passes":
        return "each pass needs a sample of its own, and the base has 1"
    return f"the base, {getattr(base, knob.name)}, leaves no other values"


def plan_in_words(points: Points, seeds: int, seconds: float, reference: float, asked: Point) -> list[str]:
    """What is going to be rendered, and about how long it will take.

    Args:
        seconds: of all, with the reference's.
        asked: the base before it was given fewer samples.
    """
    chosen = points.base.settings
    count = len(points.points)
    lines = [
        f"plan: {count} points, {seeds} seeds each, {count * seeds} renders; about {_minutes(seconds)} in all"
        + (f", {_minutes(reference)} of it for the reference" if reference else ""),
        f"base: {_base_in_words(chosen)}, {points.base.slaves} slaves",
    ]
    if chosen != asked.settings:
        lines.append(f"  (fewer than asked for, {asked.settings.spp} samples: they would take longer; see --budget)")
    lines += [f"  {curve.knob.option}: {', '.join(map(curve.knob.in_words, curve.values))}" for curve in points.curves]
    return lines


def left_out_in_words(points: Points, idle: Mapping[str, str]) -> list[str]:
    """Which knobs a default sweep does not turn, and why: one line for each reason."""
    return [
        f"  not swept: {', '.join(knob.option for knob in knobs)} ({reason})"
        for reason, knobs in left_out(points, idle).items()
    ]


def _base_in_words(chosen: RenderSettings) -> str:
    samples = f"{chosen.spp} sample{'s' if chosen.spp > 1 else ''}"
    if not chosen.algorithm.shoots_photons:
        return f"{chosen.algorithm.words}, {samples}"
    return f"{chosen.photons:,} photons, k {chosen.k}, {samples}"


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.1f} min"


def _scaled(base: int, factors: Sequence[float], most: int | None = None) -> list[Value]:
    """The base and its multiples; none of 0, which has no others."""
    if base == 0:
        return []
    scaled = [max(int(rounded(base * factor, True)), 1) for factor in factors]
    return [base, *(value if most is None else min(value, most) for value in scaled)]


def _cheaper(settings: RenderSettings, maps: Sequence[str]) -> RenderSettings:
    spp = max(settings.spp // 2, 1)
    fewer: dict[str, Any] = {photons_of(kind): max(getattr(settings, photons_of(kind)) // 2, 1) for kind in maps}
    return replace(settings, spp=spp, passes=min(settings.passes, spp), pass_samples=(), **fewer)
