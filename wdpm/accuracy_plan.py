"""What a sweep will cost, and the sweep that is made where none is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from wdpm.accuracy_knobs import KNOBS, Knob, Sweep, Value, make_sweep, rounded
from wdpm.accuracy_points import BAND_SLAVES, Point, Points, plan_points
from wdpm.accuracy_store import Record
from wdpm.kernels.settings import MAX_K, Indirect, RenderSettings

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


@dataclass(frozen=True)
class CostModel:
    """What a render takes, roughly, from one that was timed: for plans, not for results.

    Attributes:
        fixed: pilot and partition [s].
        photon: one stored photon [s].
        sample: one sample of every pixel, with this `k` and `indirect` [s].
    """

    fixed: float
    photon: float
    sample: float
    k: int
    indirect: str = Indirect.AUTO.value

    @classmethod
    def of(cls, point: Point, record: Record) -> CostModel:
        """From a render of this point."""
        phases = record.phases
        photons = phases.get("photons", 0.0) + phases.get("map", 0.0)
        render = phases.get("render", 0.0)
        return cls(
            fixed=max(record.seconds - photons - render, 0.0),
            photon=photons / max(record.stored, 1),
            sample=render / point.settings.spp,
            k=point.settings.k,
            indirect=point.settings.indirect.value,
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
        alone = self.fixed + photons + chosen.spp * self.sample * gather * ways
        return alone * CLUSTER_FACTOR if point.slaves else alone


def photons_of(kind: str) -> str:
    """The setting that says how many photons a map is to store."""
    return "photons" if kind == "global" else f"{kind}_photons"


def total_seconds(points: Points, model: CostModel, seeds: int, maps: Sequence[str]) -> float:
    """Of a whole sweep, without its reference."""
    return seeds * sum(model.seconds(point, maps) for point in points.points)


def default_points(
    base: Point, model: CostModel, maps: Sequence[str], radii: Mapping[str, float], seeds: int, seconds: float
) -> Points:
    """The widest default sweep that fits into the time; where none does, one around a base with fewer samples.

    Args:
        maps: that the scene calls for: "global", "caustic", "volume".
        radii: as of plan_points.
    """
    while True:
        for factors in SPREADS:
            points = plan_points(base, default_sweeps(base.settings, factors, maps), radii)
            if total_seconds(points, model, seeds, maps) <= seconds:
                return points
        if base.settings.spp == 1:
            return points
        base = replace(base, settings=_cheaper(base.settings, maps))


def default_sweeps(base: RenderSettings, factors: Sequence[float], maps: Sequence[str]) -> list[Sweep]:
    """Every knob that the scene has a use for, around the base."""
    by_name = {knob.name: knob for knob in KNOBS}
    milder = [factor**0.5 for factor in factors]
    sweeps = [_scaled(by_name["photons"], base.photons, factors), _scaled(by_name["k"], base.k, milder, MAX_K)]
    sweeps.append(make_sweep(by_name["radius"], [rounded(factor, False) for factor in (*milder, 1.0)], factors=True))
    sweeps.append(_scaled(by_name["spp"], base.spp, factors))
    sweeps += [
        _scaled(by_name[photons_of(kind)], getattr(base, photons_of(kind)), factors)
        for kind in ("caustic", "volume")
        if kind in maps
    ]
    passes: list[Value] = [count for count in (1, 4, 16, 64)[: len(factors)] if count <= base.spp]
    if len(passes) > 1:
        sweeps.append(make_sweep(by_name["passes"], passes))
    sweeps.append(make_sweep(by_name["indirect"], [Indirect.MAP, Indirect.GATHER, Indirect.CACHE]))
    sweeps.append(make_sweep(by_name["band"], [0.0, 0.25, 0.5, 0.75, 1.0] if len(factors) > 2 else [0.0, 0.5, 1.0]))
    sweeps.append(make_sweep(by_name["slaves"], [0, BAND_SLAVES]))
    return [sweep for sweep in sweeps if len(sweep.values) > 1]


def _scaled(knob: Knob, base: int, factors: Sequence[float], most: int | None = None) -> Sweep:
    scaled = [max(int(rounded(base * factor, True)), 1) for factor in factors]
    return make_sweep(knob, [base, *(value if most is None else min(value, most) for value in scaled)])


def _cheaper(settings: RenderSettings, maps: Sequence[str]) -> RenderSettings:
    spp = max(settings.spp // 2, 1)
    fewer: dict[str, Any] = {photons_of(kind): max(getattr(settings, photons_of(kind)) // 2, 1) for kind in maps}
    return replace(settings, spp=spp, passes=min(settings.passes, spp), **fewer)
