"""What `wdpm accuracy` renders: points, and the curves that lead through them.

One knob is turned at a time, the others stay at the base; so a curve shows what its knob alone buys, and all curves
meet at the base. A point that lies on several curves is rendered once.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Any

from wdpm.accuracy.knobs import Knob, Sweep, Value, make_sweep
from wdpm.cluster.render_settings import RenderSettings
from wdpm.scenes.errors import SettingsError

BAND_SLAVES = 2
"""The fewest slaves between which there is a band."""

LEFT_OPEN = ("radius", "caustic_radius", "volume_radius", "light_samples")
"""Knobs whose setting may be None: then the renderer chooses, as it suits the scene."""


@dataclass(frozen=True)
class Point:
    """Settings, but for the seed, and a number of slaves."""

    settings: RenderSettings
    slaves: int = 0


@dataclass(frozen=True)
class Curve:
    """One knob's points.

    Attributes:
        values: of the knob, growing.
        points: numbers of the points with these values.
        base: the number of the point whose other settings are those of this curve, and which lies on it.
    """

    knob: Knob
    values: tuple[Value, ...]
    points: tuple[int, ...]
    base: int


@dataclass(frozen=True)
class Points:
    """All points of a sweep; the first is the base."""

    points: tuple[Point, ...]
    curves: tuple[Curve, ...]

    @property
    def base(self) -> Point:
        return self.points[0]

    def curve_of(self, name: str) -> Curve | None:
        """The curve of a knob, if it is turned."""
        return next((curve for curve in self.curves if curve.knob.name == name), None)


def plan_points(base: Point, sweeps: Sequence[Sweep], chosen: Mapping[str, Value]) -> Points:
    """The points of sweeps around a base.

    Args:
        chosen: what the renderer chooses at the base for each knob of LEFT_OPEN [radii: scene units].

    Raises:
        SettingsError: a knob is swept twice, or is set to what no render can have.
    """
    points: dict[Point, int] = {base: 0}
    curves = []
    seen: set[str] = set()
    for sweep in sweeps:
        if sweep.knob.name in seen:
            raise SettingsError(f"{sweep.knob.option} is swept twice; give all its values in one --sweep")
        seen.add(sweep.knob.name)
        curves.append(_curve(base, sweep, chosen, points))
    return Points(tuple(points), tuple(curves))


def value_of(point: Point, knob: Knob) -> Any:
    """What a knob is set to; None for one of LEFT_OPEN that the renderer chooses."""
    return point.slaves if knob.name == "slaves" else getattr(point.settings, knob.name)


def command_of(point: Point, seed: int, scene: Sequence[str], defaults: RenderSettings, threads: int | None) -> str:
    """The command that renders a point, for a shell.

    Args:
        scene: words that name the scene: the file, and options that change it.
        defaults: settings that the scene has if none are chosen.
        threads: None for all cores.
    """
    words = ["wdpm", "render", *scene]
    settings = replace(point.settings, seed=seed)
    always = ("photons", "k", "spp", "seed")  # so that a command shows what it is about
    for field in fields(RenderSettings):
        value = getattr(settings, field.name)
        if value != getattr(defaults, field.name) or field.name in always:
            words += _option(field.name, value)
    if point.slaves:
        words += ["--slaves", f"{point.slaves}"]
    if threads is not None:
        words += ["--threads", f"{threads}"]
    return shlex.join(words)


def _curve(base: Point, sweep: Sweep, chosen: Mapping[str, Value], points: dict[Point, int]) -> Curve:
    knob = sweep.knob
    origin = replace(base, slaves=max(base.slaves, BAND_SLAVES)) if knob.name == "band" else base
    if knob.name == "band":
        # Errors of a band are against the exact image, so that one must be there.
        origin = replace(origin, settings=replace(base.settings, band=1.0, inexact=False))
    own = value_of(origin, knob)
    if own is None:
        own = chosen[knob.name]
    wanted = [_times(value, own) if sweep.factors else value for value in sweep.values]
    found: dict[Value, Point] = {own: origin}
    try:
        for value in (wanted[0], wanted[-1], *wanted):  # of a range, the ends are what was typed
            if value not in found:
                found[value] = _turned(origin, knob, value)
    except SettingsError as error:
        raise SettingsError(f"{sweep.words}: {error}") from None
    ordered = make_sweep(knob, [*wanted, own]).values
    numbers = tuple(points.setdefault(found[value], len(points)) for value in ordered)
    return Curve(knob, ordered, numbers, points[origin])


def _times(factor: Value, own: Value) -> Value:
    """A factor of what the base has, short enough for a command."""
    if isinstance(factor, Enum) or isinstance(own, Enum):
        raise TypeError(f"{factor!r} is no factor of {own!r}")
    return own if factor == 1.0 else float(f"{factor * own:.6g}")


def _turned(origin: Point, knob: Knob, value: Value) -> Point:
    """The origin with a knob set to a value. Raises SettingsError if no render can have it."""
    if knob.name == "slaves":
        if not isinstance(value, int):
            raise TypeError(f"slaves: {value!r}")
        return replace(origin, slaves=value)
    change: dict[str, Any] = {knob.name: value}
    if knob.name == "band":
        change["inexact"] = float(value) < 1.0 if not isinstance(value, Enum) else False
    settings = replace(origin.settings, **change)
    if settings.passes > settings.spp:
        raise SettingsError(
            f"passes is {settings.passes}, more than spp, which is {settings.spp}; each pass needs a sample of its "
            "own: give a larger --spp"
        )
    return Point(settings, origin.slaves)


def _option(name: str, value: Any) -> list[str]:
    option = "--" + name.replace("_", "-")
    if isinstance(value, bool):
        return [option] if value else []
    if isinstance(value, Enum):
        return [option, str(value.value)]
    if isinstance(value, tuple):
        return [option, ",".join(map(str, value))]
    return [option, f"{value}"]
