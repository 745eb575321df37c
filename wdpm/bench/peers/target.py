"""Errors that `wdpm bench peers` asks for: as numbers, or those that Mitsuba has with some numbers of samples."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wdpm.bench.peers.law import ErrorLaw, Point
from wdpm.images.comparison import RELATIVE_FLOOR, Region, compare, region_slices
from wdpm.images.image import Image
from wdpm.scenes.errors import SettingsError

DEFAULT_ERRORS = (0.05, 0.02, 0.01, 0.005)


@dataclass(frozen=True)
class Bounds:
    """What is to be reached, and how long may be tried.

    Attributes:
        errors: relMSE, falling.
        samples: of Mitsuba, whose errors are to be reached; rising.
        trim: share of the pixels, the worst ones, without which all errors are to be reached as well; 0 for none.
        region: left, top, right, bottom of the pixels that count; None for all.
        rounds: renders that confirm a choice.
        limit_s: nothing is rendered that adds work to what took longer than this on all threads [s].

    Raises:
        SettingsError: one of them is out of range.
    """

    errors: tuple[float, ...] = DEFAULT_ERRORS
    region: Region | None = None
    rounds: int = 2
    limit_s: float = 60.0
    samples: tuple[int, ...] = ()
    trim: float = 0.0

    def __post_init__(self) -> None:
        for error in self.errors:
            if not 0 < error < float("inf"):
                raise SettingsError(f"error is {error}; expected a positive relMSE")
        if not 0 <= self.trim <= MOST_TRIM:
            raise SettingsError(f"trim is {self.trim:g}; expected a share of the pixels, 0 to {MOST_TRIM:g}")
        object.__setattr__(self, "errors", tuple(sorted(set(self.errors), reverse=True)))
        object.__setattr__(self, "samples", tuple(sorted(set(self.samples))))


MOST_TRIM = 0.1
"""Of the pixels: with more left out an image is judged by its easy parts."""


@dataclass(frozen=True)
class RelMse:
    """Errors of an image.

    Attributes:
        whole: relMSE.
        trimmed: without the worst pixels (Bounds.trim); equal to the other where none are left out.
    """

    whole: float
    trimmed: float


def rel_mse_of(image: Image, reference: Image, bounds: Bounds) -> RelMse:
    """Errors of an image. Raises ImageError where both have not the same size, or the region lies outside."""
    whole = compare(image, reference, bounds.region).rel_mse
    if not bounds.trim:
        return RelMse(whole, whole)
    rows, columns = region_slices(bounds.region, reference.shape)
    a, b = (each.pixels[rows, columns].astype(np.float64) for each in (image, reference))
    with np.errstate(invalid="ignore"):  # infinities, which are left out as `compare` leaves them out
        relative = (a - b) ** 2 / (b**2 + RELATIVE_FLOOR)
    of_pixels = np.sort(np.where(np.isfinite(relative), relative, 0.0).mean(axis=-1), axis=None)
    return RelMse(whole, float(of_pixels[: max(1, int(len(of_pixels) * (1.0 - bounds.trim)))].mean()))


def mean_of(errors: Sequence[RelMse]) -> RelMse:
    """Of several images of the same settings."""
    return RelMse(statistics.fmean(each.whole for each in errors), statistics.fmean(each.trimmed for each in errors))


@dataclass(frozen=True)
class Target:
    """An error that is to be reached.

    Attributes:
        error: the largest that will do.
        trimmed: whether it is that without the worst pixels.
        spp: samples with which Mitsuba has it; None where the error was asked for as a number.
        by_law: whether so many were not rendered by Mitsuba, and the error is that of its law.
    """

    error: float
    trimmed: bool = False
    spp: int | None = None
    by_law: bool = False

    def error_in(self, errors: RelMse) -> float:
        """The error that counts."""
        return errors.trimmed if self.trimmed else errors.whole

    def reached_by(self, errors: RelMse) -> bool:
        """Whether an image is good enough."""
        return self.error_in(errors) <= self.error

    def law(self, points: Sequence[Point[RelMse]]) -> ErrorLaw:
        """How this kind of error falls with samples."""
        return ErrorLaw(tuple(Point(point.spp, self.error_in(point.error), point.cost) for point in points))

    @property
    def name(self) -> str:
        """For people."""
        of_what = "" if self.spp is None else f" ({self.spp:,} samples{'*' if self.by_law else ''})"
        return f"{self.error:.3g}{' trimmed' if self.trimmed else ''}{of_what}"


def targets_of(bounds: Bounds, points: Sequence[Point[RelMse]]) -> tuple[Target, ...]:
    """All errors that are to be reached, by what Mitsuba was seen to have; the trimmed ones after the others."""
    targets = []
    for trimmed in (False, True) if bounds.trim else (False,):
        targets += [Target(error, trimmed) for error in bounds.errors]
        for spp in bounds.samples:
            some = [point.error for point in points if point.spp == spp]
            kind = Target(math.inf, trimmed, spp, by_law=not some)
            error = kind.error_in(mean_of(some)) if some else kind.law(points).constant / spp
            targets.append(Target(error, trimmed, spp, by_law=not some))
    return tuple(targets)
