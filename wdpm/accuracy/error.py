"""The error of a point, taken apart by several seeds: what another seed would change, and what it would not.

Let x_s be the image of seed s, b the reference, w a weight, and <> the mean over the image's values. Then

    error  = mean over s of <w (x_s - b)^2>
    bias²  = mean over pairs s != t of <w (x_s - b)(x_t - b)>
    noise  = error - bias²

Seeds are independent, so products of two of them hold no noise: bias² is unbiased (a U-statistic; Hoeffding 1948), and
noise is the usual unbiased variance. bias² can come out below zero where there is none. The reference's own noise is in
error and in bias² alike, and is subtracted where it is known.

Intervals are of 95 %: a jackknife over the seeds (Efron & Stein 1981) in each of 16 blocks along the image's longer
side, whose errors count as independent of each other, as in error_layers. The jackknife errs on the wide side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.images.comparison import RELATIVE_FLOOR
from wdpm.rendering.error_layers import BLOCKS, NORMAL_QUANTILE
from wdpm.report.report import ErrorFigure
from wdpm.scenes.errors import SettingsError

Values = NDArray[np.float64]

LEAST_SEEDS = 3
"""Without one of three, there are two left to tell noise and bias apart."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What images are compared with.

    Attributes:
        pixels: float64, shape [height, width, 3].
        half_difference: half the difference of two independent halves: as large as the error of their mean, which
            `pixels` is, and independent of it. None where the reference's own noise is not known.
    """

    pixels: Values
    half_difference: Values | None = None

    @property
    def relative(self) -> Values:
        """The weight that makes a squared error relMSE's."""
        return 1.0 / (self.pixels**2 + RELATIVE_FLOOR)


@dataclass(frozen=True)
class SplitError:
    """A mean squared error, taken apart, with intervals of 95 %.

    Attributes:
        error: expected of one seed, against the truth: noise + bias.
        noise: its part that differs from seed to seed.
        bias: its part that does not, squared; below zero by chance where there is none.
    """

    error: ErrorFigure
    noise: ErrorFigure
    bias: ErrorFigure


def split_error(images: Sequence[NDArray[Any]], truth: Truth, weight: Values) -> SplitError:
    """Noise and bias of images that differ by nothing but their seeds.

    Args:
        images: one for each seed, shape [height, width, 3].
        weight: of a squared error, shape [height, width, 3]: `Truth.relative`, or ones.

    Raises:
        SettingsError: too few images.
    """
    count = len(images)
    if count < LEAST_SEEDS:
        raise SettingsError(f"{count} seeds cannot tell noise from bias; expected at least {LEAST_SEEDS}")
    differences = [image.astype(np.float64) - truth.pixels for image in images]
    finite = np.logical_and.reduce([np.isfinite(each) for each in differences])
    weight = np.where(finite, weight, 0.0) / max(int(finite.sum()), 1)
    differences = [np.where(finite, each, 0.0) for each in differences]
    products = _products(differences, weight)
    parts = _parts(products)
    spread = _jackknife(products)
    own, own_spread = _noise_of(truth, weight, np.mean(differences, axis=0))
    error, noise, bias = (float(part.sum()) for part in parts)
    return SplitError(
        _figure(error - own, spread[0] + own_spread),
        _figure(noise, spread[1]),
        _figure(bias - own, spread[2] + own_spread),
    )


def error_gained(
    images: Sequence[NDArray[Any]], base: Sequence[NDArray[Any]], truth: Truth, weight: Values
) -> ErrorFigure:
    """How much larger the error of some images is than that of others with the same seeds.

    Settings share the random numbers of a seed, and with them much of their error, so the difference of two errors is
    known far better than either.

    Args:
        images, base: one for each seed, shape [height, width, 3].
        weight: as of split_error.
    """
    both = [(one.astype(np.float64), other.astype(np.float64)) for one, other in zip(images, base, strict=True)]
    finite = np.logical_and.reduce([np.isfinite(each) for pair in both for each in pair])
    weight = np.where(finite, weight, 0.0) / max(int(finite.sum()), 1)
    both = [(np.where(finite, one, truth.pixels), np.where(finite, other, truth.pixels)) for one, other in both]
    blocks = np.array(
        [_blocks(weight * ((one - truth.pixels) ** 2 - (other - truth.pixels) ** 2)) for one, other in both]
    )
    variance = float(blocks.var(axis=0, ddof=1).sum()) / len(blocks)
    if truth.half_difference is not None:
        apart = np.mean([one - other for one, other in both], axis=0)
        variance += float(((2.0 * weight * apart * truth.half_difference).sum(axis=2) ** 2).sum())
    return _figure(float(blocks.mean(axis=0).sum()), variance)


def own_noise(truth: Truth, weight: Values) -> float | None:
    """The mean squared error of the truth itself, as its two halves tell; None where it has none."""
    if truth.half_difference is None:
        return None
    return float((weight * truth.half_difference**2).mean())


def _products(differences: list[Values], weight: Values) -> Values:
    """Of all pairs of seeds, in each block, shape [seeds, seeds, blocks]."""
    count = len(differences)
    rows = [[_blocks(weight * one * other) for other in differences[: i + 1]] for i, one in enumerate(differences)]
    return np.array([[rows[max(i, j)][min(i, j)] for j in range(count)] for i in range(count)])


def _parts(products: Values) -> tuple[Values, Values, Values]:
    """Error, noise and bias² of each block."""
    count = len(products)
    own = np.einsum("iib->b", products)
    error = own / count
    bias = (products.sum(axis=(0, 1)) - own) / (count * (count - 1))
    return error, error - bias, bias


def _jackknife(products: Values) -> tuple[float, float, float]:
    """Variances of the sums over blocks of error, noise and bias²."""
    count = len(products)
    without = []
    for left_out in range(count):
        kept = np.delete(np.delete(products, left_out, axis=0), left_out, axis=1)
        without.append(_parts(kept))
    error, noise, bias = (
        float(((count - 1) * np.var(np.array([each[part] for each in without]), axis=0)).sum()) for part in range(3)
    )
    return error, noise, bias


def _noise_of(truth: Truth, weight: Values, difference: Values) -> tuple[float, float]:
    """Mean squared error of the truth itself, and the variance that it adds to an error against it.

    Pixels of a path tracer are independent of each other. A squared normal number varies by twice its square, and the
    square of the estimate is thrice that on average, hence 2 / 3. The error of the truth is seen through its product
    with the image's own, too.
    """
    if truth.half_difference is None:
        return 0.0, 0.0
    half = np.where(weight > 0, truth.half_difference, 0.0)
    own = (weight * half**2).sum(axis=2)
    crossed = 2.0 * (weight * difference * half).sum(axis=2)
    return float(own.sum()), float((own**2).sum()) * 2 / 3 + float((crossed**2).sum())


def _blocks(values: Values) -> Values:
    """Sums over the blocks of an image, shape [blocks]."""
    height, width = values.shape[:2]
    side = -(-max(height, width) // BLOCKS)
    pixels = values.sum(axis=2)
    rows = np.add.reduceat(pixels, np.arange(0, height, side), axis=0)
    return np.asarray(np.add.reduceat(rows, np.arange(0, width, side), axis=1)).ravel()


def _figure(value: float, variance: float) -> ErrorFigure:
    reach = NORMAL_QUANTILE * math.sqrt(max(variance, 0.0))
    return ErrorFigure(value, value - reach, value + reach)
