"""What a sweep found: figures of each point, of the band, and the Pareto front."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.accuracy.error import SplitError, Truth, error_gained, own_noise, split_error
from wdpm.accuracy.pareto import pareto_front
from wdpm.accuracy.points import Point, Points
from wdpm.accuracy.store import RENDERS, Record, Store, plain_settings
from wdpm.images.comparison import RELATIVE_FLOOR
from wdpm.images.image import Image
from wdpm.progress import Progress
from wdpm.report.report import ErrorFigure


@dataclass(frozen=True)
class BandError:
    """What a narrow band costs, against the exact image of the same seed; means over seeds.

    Attributes:
        mse, rel_mse, max_abs: of the beauty layer; the last is the largest of all seeds.
        pixels: that differ, as a share.
        bits_equal: whether every bit of every layer but `cell` is equal, for all seeds.
    """

    mse: float
    rel_mse: float
    max_abs: float
    pixels: float
    bits_equal: bool


@dataclass(frozen=True)
class PointFigures:
    """One point.

    Attributes:
        number: of the point; 0 is the base.
        name: how it differs from the base, in words.
        settings: as JSON has them, with the first seed.
        wall_seconds, cpu_seconds: as of Record, medians over seeds.
        seconds: one of them, whichever counts as the time of a point.
        each_seconds: the same, of each seed.
        rel_mse, mse: the error and its parts.
        gained: relMSE over that of the base, as a difference, seed by seed.
        stored, ghosts, bytes, left_band: as of Record, medians over seeds.
        bits_as_base: whether every seed's image has the bits of the base's.
        band: for a point whose band was turned.
        command: renders the first seed.
        images: of each seed, relative to the folder.
    """

    number: int
    name: str
    settings: dict[str, Any]
    slaves: int
    wall_seconds: float
    cpu_seconds: float
    seconds: float
    each_seconds: tuple[float, ...]
    rel_mse: SplitError
    mse: SplitError
    gained: ErrorFigure
    stored: int
    ghosts: int
    bytes: int
    left_band: int
    bits_as_base: bool
    band: BandError | None
    command: str
    images: tuple[str, ...]


@dataclass(frozen=True)
class CurveFigures:
    """One knob's points: their numbers, and the values as numbers and in words."""

    knob: str
    label: str
    values: tuple[float | str, ...]
    words: tuple[str, ...]
    points: tuple[int, ...]
    base: int


@dataclass(frozen=True)
class Accuracy:
    """All that a sweep found.

    Attributes:
        scene: as on the command line.
        width, height: in pixels.
        seeds: of each point.
        reference: where it is from, in words.
        reference_noise: of its own, as relMSE; None if it is not known.
        clock: what counts as the time of a point, of knobs.CLOCKS.
        compile_seconds: spent on kernels, apart from all points.
        trim: share of the pixels that was left out of all errors.
        worst: share of the base's relMSE that the WORST share of its pixels makes up, before any is left out.
        machine: what it was measured on.
        front: numbers of the points that are not dominated in time and relMSE, in order of time.
    """

    scene: str
    width: int
    height: int
    seeds: tuple[int, ...]
    reference: str
    reference_noise: float | None
    clock: str
    compile_seconds: float
    trim: float
    worst: float
    machine: dict[str, Any]
    points: tuple[PointFigures, ...]
    curves: tuple[CurveFigures, ...]
    front: tuple[int, ...]

    @property
    def base(self) -> PointFigures:
        return self.points[0]

    def curve_of(self, knob: str) -> CurveFigures | None:
        """The curve of a knob, if it was turned."""
        return next((curve for curve in self.curves if curve.knob == knob), None)

    def to_json(self) -> str:
        """One JSON object."""
        return json.dumps(asdict(self), allow_nan=False, indent=2)


WORST = 0.001
"""Share of the pixels that are looked at apart."""


def figures_of(
    points: Points,
    store: Store,
    seeds: Sequence[int],
    truth: Truth,
    command: Callable[[Point], str],
    clock: str,
    trim: float,
    progress: Progress,
) -> tuple[PointFigures, ...]:
    """Figures of every point, from the images and records that the store has.

    Args:
        command: renders a point.
        clock: one of knobs.CLOCKS.
        trim: share of the pixels to leave out of all errors (kept_pixels).

    Raises:
        ImageError: one cannot be read.
    """
    records = {(point, seed): store.find(point, seed) for point in points.points for seed in seeds}
    missing = [key for key, record in records.items() if record is None]
    if missing:
        raise ValueError(f"{len(missing)} renders are missing")
    found = {key: record for key, record in records.items() if record is not None}
    exact = _exact_points(points)
    base = [store.image(points.base, seed).pixels for seed in seeds]
    kept = kept_pixels(points, store, seeds, truth, trim)[..., np.newaxis]
    plain = np.ones_like(truth.pixels) * kept / kept.mean()
    relative = truth.relative * plain
    figures = []
    progress.start("figures", len(points.points))
    for number, point in enumerate(points.points):
        mine = [found[point, seed] for seed in seeds]
        each_seconds = tuple(record.cpu_seconds if clock == "cpu" else record.seconds for record in mine)
        images = [store.image(point, seed) for seed in seeds]
        band = None
        if point in exact:
            other = exact[point]
            same = all(found[point, seed].digest == found[other, seed].digest for seed in seeds)
            band = band_error(images, [store.image(other, seed) for seed in seeds], same)
        pixels = [image.pixels for image in images]
        figures.append(
            PointFigures(
                number=number,
                name=name_of(point, points, number),
                settings=plain_settings(point.settings, seeds[0]),
                slaves=point.slaves,
                wall_seconds=median(record.seconds for record in mine),
                cpu_seconds=median(record.cpu_seconds for record in mine),
                seconds=median(each_seconds),
                each_seconds=each_seconds,
                rel_mse=split_error(pixels, truth, relative),
                mse=split_error(pixels, truth, plain),
                gained=error_gained(pixels, base, truth, relative),
                **{name: _middle(mine, name) for name in ("stored", "ghosts", "bytes", "left_band")},
                bits_as_base=all(found[point, seed].digest == found[points.base, seed].digest for seed in seeds),
                band=band,
                command=command(point),
                images=tuple(f"{RENDERS}/{store.image_path(point, seed).name}" for seed in seeds),
            )
        )
        progress.advance()
    return tuple(figures)


def pixel_errors(images: Sequence[NDArray[Any]], truth: Truth) -> NDArray[np.float64]:
    """Each pixel's part of relMSE, mean over seeds, shape [height, width]."""
    errors = [((image.astype(np.float64) - truth.pixels) ** 2 * truth.relative).mean(axis=2) for image in images]
    return np.asarray(np.nan_to_num(np.mean(errors, axis=0), posinf=0.0))


def kept_pixels(points: Points, store: Store, seeds: Sequence[int], truth: Truth, trim: float) -> NDArray[np.bool_]:
    """All pixels but a share that make up the most of the errors of the points, each point counting alike.

    Were they chosen by the errors of one point, they would be left out where chance was bad to that one.

    Returns:
        shape [height, width].
    """
    parts = np.zeros(truth.pixels.shape[:2])
    if trim == 0:
        return parts == 0
    for point in points.points:
        errors = pixel_errors([store.image(point, seed).pixels for seed in seeds], truth)
        parts += errors / max(float(errors.sum()), np.finfo(np.float64).tiny)
    return parts <= _threshold(parts, trim)


def worst_share(images: Sequence[NDArray[Any]], truth: Truth) -> float:
    """The share of relMSE that lies in the WORST share of the pixels."""
    errors = pixel_errors(images, truth)
    whole = float(errors.sum())
    return float(errors[errors > _threshold(errors, WORST)].sum()) / whole if whole > 0 else 0.0


def _threshold(errors: NDArray[np.float64], share: float) -> float:
    """What a share of the pixels is above."""
    return float(np.quantile(errors, 1.0 - share))


def band_error(images: Sequence[Image], exact: Sequence[Image], bits_equal: bool) -> BandError:
    """Of images against exact ones, seed by seed."""
    apart = [a.pixels.astype(np.float64) - b.pixels for a, b in zip(images, exact, strict=True)]
    relative = [
        each**2 / (b.pixels.astype(np.float64) ** 2 + RELATIVE_FLOOR) for each, b in zip(apart, exact, strict=True)
    ]
    return BandError(
        mse=float(np.mean([(each**2).mean() for each in apart])),
        rel_mse=float(np.mean([each.mean() for each in relative])),
        max_abs=float(max(np.abs(each).max() for each in apart)),
        pixels=float(np.mean([(each != 0).any(axis=2).mean() for each in apart])),
        bits_equal=bits_equal,
    )


def curves_of(points: Points) -> tuple[CurveFigures, ...]:
    """The curves of a sweep, in the order in which knobs are shown."""
    return tuple(
        CurveFigures(
            knob=curve.knob.name,
            label=curve.knob.label,
            values=tuple(value if isinstance(value, int | float) else value.value for value in curve.values),
            words=tuple(map(curve.knob.in_words, curve.values)),
            points=curve.points,
            base=curve.base,
        )
        for curve in points.curves
    )


def front_of(figures: Sequence[PointFigures]) -> tuple[int, ...]:
    """Numbers of the points that no other beats in both time and error."""
    return pareto_front([(point.seconds, point.rel_mse.error.value) for point in figures])


def reference_noise(truth: Truth) -> float | None:
    """As relMSE; None if it is not known."""
    return own_noise(truth, truth.relative)


def name_of(point: Point, points: Points, number: int) -> str:
    """How a point differs from the base: "photons 1M", "band 0.5, slaves 2"."""
    if number == 0:
        return "base"
    parts = []
    for curve in points.curves:
        if number in curve.points and number != curve.base:
            parts.append(f"{curve.knob.label} {curve.knob.in_words(curve.values[curve.points.index(number)])}")
            break
    if point.slaves != points.base.slaves and not any(part.startswith("slaves") for part in parts):
        parts.append(f"slaves {point.slaves}")
    return ", ".join(parts)


def _exact_points(points: Points) -> Mapping[Point, Point]:
    """Points of the band's curve, and the exact one that each is held against."""
    curve = points.curve_of("band")
    if curve is None:
        return {}
    return {points.points[number]: points.points[curve.base] for number in curve.points}


def _middle(records: Sequence[Record], name: str) -> int:
    return round(median(getattr(record, name) for record in records))
