"""Pixel filters as tables: where the samples of a pixel lie, and what they count for.

Samples lie anywhere in their own pixel, and count in all pixels whose filter reaches them: see splats. A filter that
reaches further than MOST_REACH pixels would be dear, and one that reaches none beside its own has nothing to gain:
their samples are placed in proportion to the filter's magnitude (filter importance sampling, Ernst et al. 2006), and
count in one pixel alone. Where such a filter is negative a sample has the sign -1: see filter_weights. The filters are
Mitsuba's, two of them by Mitchell & Netravali 1988 ("Reconstruction filters in computer graphics").
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.model.scene import FilterKind, PixelFilter

FILTER_STEPS = 1024
"""Steps of a filter's inverse distribution: linear between them, it misses a gaussian's by less than 1e-5 pixels."""

_FINE = 64 * FILTER_STEPS

MOST_REACH = 3
"""Pixels to each side that samples are counted in at most, as of Mitsuba's widest filter by default: each pixel holds
sums for 49 then."""

Values = NDArray[np.float64]


def exponential(x: Values) -> Values:
    """e^x of numbers up to 0 (e^-700 below it), with the same bits on every machine, which np.exp has not.

    e^x = 2^n e^r with |r| <= ln(2) / 2, by the power series.
    """
    x = np.maximum(x, -700.0)
    n = np.rint(x / math.log(2))
    r = x - n * math.log(2)
    total = np.ones_like(r)
    for k in range(15, 0, -1):
        total = 1.0 + total * r / k
    return np.ldexp(total, n.astype(np.int64))


def sinc(x: Values) -> Values:
    """sin(pi x) / (pi x), with the same bits on every machine: by the power series, within half a turn of a zero."""
    n = np.rint(x)
    r = math.pi * (x - n)
    total = np.ones_like(r)
    for k in range(12, 0, -1):  # Horner's rule: the next terms are below 1e-21
        total = 1.0 - total * r * r / (2 * k * (2 * k + 1))
    sine = np.where(n % 2 == 0, 1.0, -1.0) * r * total
    return np.where(x == 0.0, 1.0, sine / np.where(x == 0.0, 1.0, math.pi * x))


def filter_values(pixel_filter: PixelFilter, x: Values) -> Values:
    """A filter along one axis, at distances from the pixel's centre in pixels; not normalised."""
    radius, distance = pixel_filter.radius, np.abs(x)
    match pixel_filter.kind:
        case FilterKind.BOX:
            values = np.ones_like(x)
        case FilterKind.GAUSSIAN:
            scale = -1.0 / (2 * pixel_filter.stddev**2)
            values = np.maximum(exponential(x**2 * scale) - exponential(np.array(radius**2 * scale)), 0.0)
        case FilterKind.TENT:
            values = 1.0 - distance / radius
        case FilterKind.MITCHELL:
            values = _mitchell(2.0 * distance / radius, pixel_filter.b, pixel_filter.c)
        case FilterKind.LANCZOS:
            values = sinc(x) * sinc(x / radius)
    return np.where(distance <= radius, values, 0.0)


def _mitchell(x: Values, b: float, c: float) -> Values:
    """The cubic of two parameters, for distances from 0 to 2."""
    near = (12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + (6 - 2 * b)
    far = (-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + (8 * b + 24 * c)
    return np.asarray(np.where(x < 1.0, near, far) / 6.0)


def reach_of(pixel_filter: PixelFilter) -> int:
    """In how many pixels to each side of its own a sample counts; 0 of filters whose samples are placed by them."""
    reach = math.ceil(pixel_filter.radius - 0.5)
    return reach if reach <= MOST_REACH else 0


def placed_by(pixel_filter: PixelFilter) -> PixelFilter:
    """The filter that a camera places samples by: one pixel, evenly, where they count in others too."""
    return PixelFilter() if reach_of(pixel_filter) else pixel_filter


def splat_table(pixel_filter: PixelFilter) -> NDArray[np.float32]:
    """A filter along one axis at distances from 0 to its radius, float32, shape [FILTER_STEPS + 1]."""
    distances = np.linspace(0.0, pixel_filter.radius, FILTER_STEPS + 1)
    return filter_values(pixel_filter, distances).astype(np.float32)


@functools.cache
def noise_left(pixel_filter: PixelFilter) -> float:
    """The variance of a pixel over that of one whose samples lie in it evenly and count in no other.

    Of many samples that are independent of each other: the integral of the filter's square over the square of its own.
    """
    if not reach_of(pixel_filter):
        return 1.0
    x = np.linspace(-pixel_filter.radius, pixel_filter.radius, _FINE + 1)
    values = filter_values(pixel_filter, x)
    step = 2.0 * pixel_filter.radius / _FINE
    along = _integral(values**2)[-1] / (_integral(values)[-1] ** 2 * step)
    return float(along**2)


def filter_quantiles(pixel_filter: PixelFilter) -> NDArray[np.float32]:
    """The inverse distribution of a filter's magnitude along one axis, in pixels, float32, shape [FILTER_STEPS + 1]."""
    radius = pixel_filter.radius
    if pixel_filter.kind is FilterKind.BOX:
        return np.linspace(-radius, radius, FILTER_STEPS + 1, dtype=np.float32)
    x = np.linspace(-radius, radius, _FINE + 1)
    distribution = _integral(np.abs(filter_values(pixel_filter, x)))
    distribution /= distribution[-1]
    return np.interp(np.linspace(0, 1, FILTER_STEPS + 1), distribution, x).astype(np.float32)


@functools.cache
def filter_signs(pixel_filter: PixelFilter) -> NDArray[np.float32]:
    """Along one axis, the sign of a filter in each step of `filter_quantiles`, float32, shape [FILTER_STEPS].

    -1 or 1, but in a step in which it changes: the integral of the filter over that of its magnitude there.
    """
    x = np.linspace(-pixel_filter.radius, pixel_filter.radius, _FINE + 1)
    values = filter_values(pixel_filter, x)
    if values.min() >= 0.0:
        return np.ones(FILTER_STEPS, np.float32)
    edges = filter_quantiles(pixel_filter).astype(np.float64)
    signed, magnitude = (np.diff(np.interp(edges, x, _integral(f))) for f in (values, np.abs(values)))
    return np.asarray(signed / magnitude, np.float32)


def is_signed(pixel_filter: PixelFilter) -> bool:
    """Whether a filter is negative anywhere, so that samples weigh differently."""
    return bool((filter_signs(pixel_filter) < 1.0).any())


def sharpening(pixel_filter: PixelFilter) -> float:
    """The integral of a filter's magnitude over the filter's own, across a pixel: 1 where it is never negative."""
    return 1.0 / float(np.add.accumulate(filter_signs(pixel_filter).astype(np.float64))[-1] / FILTER_STEPS) ** 2


def _integral(values: Values) -> Values:
    """By the trapezoidal rule, from the first value on, in units of a step."""
    return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2)])
