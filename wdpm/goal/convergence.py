"""How far the mean of the passes so far is from the truth: an estimate that a render may stop at.

It adds two parts, each with an interval of 80 %, so that the upper end holds in 9 of 10 cases.

**Noise**, from the spread of the passes (error_layers.Batches). A relative error divides by the truth, for which the
mean stands in; but a pixel that a rare bright sample hit has a large spread and a large mean, which would hide each
other. So passes are dealt to two halves. What both halves have seen of a pixel is believed; beyond that it is taken to
be no brighter than the pixels around it (believed_light): dark where all around is dark, and as bright as a lamp
beside a lamp, along whose edge a few samples meet it or do not. Held against references that is the error within a
fifth or so, where dividing by the darker half called it ten times as large along edges of lamps. A pixel
that one pass alone saw bright may be darker yet; the upper end of the interval knows (with_rare).

**Bias**, from a pair of references: path-traced images a and b of fewer pixels (reference_pair.py), which are noisy
but not biased. For the mean image x, (x - a)(x - b) is on average exactly x's squared error, whatever causes it, since
the noise of a and that of b are independent of each other. What noise does not explain of it is bias. Where caustics
are seen, paths find their light too rarely to tell; there, and where there is no reference, bias is told by how
the passes change with their radius (error_layers).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.goal.goal import Metric
from wdpm.goal.reference_pair import ReferencePair, coarser
from wdpm.rendering.error_layers import (
    BY_PHOTONS,
    NORMAL_QUANTILE,
    Batches,
    BiasFit,
    Weight,
    bias_figure,
    block_sums,
    chi_square_quantile,
    freedom_of,
    share_of,
    spread_of,
)
from wdpm.report.report import ErrorFigure

Values = NDArray[np.float64]

LEAST_PASSES = 2
"""One in each half."""

ONE_SIDED = 1.2815515655446004
"""Quantile of a normal distribution at 0.9: what lies above the upper end."""

ONE_HIT = 0.15
"""Of the mean of a pixel that one half alone has seen bright, what the truth is at least, for the upper end. If any
share of a pixel may be a lamp's, as likely one as another, and one sample of n met it, the share is above 0.39 / n in
nine of ten cases where n is 2, and above 0.53 / n where n is large; less is safer, as lamps are seen in glass as well.
Of 140 stops on twelve scenes 96 % had reached their error with 0.1, 93 % with 0.25, for a fifth fewer samples."""

MOST_BIAS = 0.01
"""relMSE of bias alone, where nothing tells it: not more on twelve scenes, by the photons that a pilot begins with."""

CAUSTIC_SHARE = 0.1
"""Of a pixel's light that comes from the caustic map, where the reference is not believed."""


@dataclass(frozen=True)
class Estimate:
    """Of an image's error, as weighted mean squares; intervals are of 80 %.

    Attributes:
        noise, bias: its parts, the bias squared.
        total: their sum.
    """

    noise: ErrorFigure
    bias: ErrorFigure
    total: ErrorFigure


class ConvergenceEstimator:
    """Takes in pass after pass.

    Args:
        shape: of the image, (height, width, 3).
        metric: that the error is measured with.
        biased: whether light comes from photon maps.
        reference: to measure bias with; None for the passes' radii alone.
        most_bias: relMSE of it, where neither tells.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        metric: Metric,
        biased: bool,
        reference: ReferencePair | None = None,
        most_bias: float = MOST_BIAS,
    ) -> None:
        self.metric = metric
        self._most_bias = most_bias
        self._biased = biased
        self._reference = reference if biased else None
        self._halves: list[Values] = [np.zeros(shape), np.zeros(shape)]
        self._weights: list[Values] = [np.zeros(()), np.zeros(())]
        self._batches = Batches(shape)
        self._coarse = Batches((0,) if self._reference is None else self._reference.a.shape)
        self._by_radius = BiasFit(shape if biased else (0,))
        self._caustic: Values = np.zeros(shape)
        self._passes = 0
        self._estimate: Estimate | None = None

    @property
    def passes(self) -> int:
        """How many were taken in."""
        return self._passes

    def add(self, layers: dict[str, NDArray[np.float32]], spp: Weight, share: float) -> None:
        """Take in the next pass.

        Args:
            layers: at least `beauty`, and those of light from photon maps.
            spp: samples a pixel, those of the reference's pixels alike.
            share: its squared radius, as a share of the first pass's.
        """
        self._estimate = None
        image = layers["beauty"].astype(np.float64)
        image = np.where(np.isfinite(image), image, 0.0)
        half = self._passes % 2
        self._weights[half] = np.asarray(self._weights[half] + spp)
        self._halves[half] += (image - self._halves[half]) * share_of(spp, self._weights[half])
        self._batches.add(image, spp)
        if self._reference is not None:
            factor = self._reference.factor
            self._coarse.add(coarser(image, factor), spp if np.ndim(spp) == 0 else np.asarray(spp)[::factor, ::factor])
        if self._biased:
            # Of a surface that no photon map lights there is no such layer.
            known = layers if any(name in layers for name in BY_PHOTONS) else layers | {"indirect": _black(layers)}
            self._by_radius.add(known, spp, share)
            if "caustic" in layers:
                self._caustic += spp * layers["caustic"].astype(np.float64)
        self._passes += 1

    def mean(self) -> Values:
        """Of all passes."""
        one, other = self._weights
        return np.asarray((self._halves[0] * one + self._halves[1] * other) / (one + other))

    def estimate(self) -> Estimate | None:
        """What the passes so far tell; None before there are enough."""
        if self._estimate is None and self._passes >= LEAST_PASSES:
            self._estimate = self.estimate_of(*self.variance())
        return self._estimate

    def estimate_of(self, variance: Values, freedom: float) -> Estimate:
        """The estimate, by a variance of the image that is known otherwise, and its degrees of freedom."""
        noise = self.noise_of(variance, freedom, *self.weights())
        bias = self._bias(self.mean())
        return Estimate(noise, bias, _sum(noise, bias))

    def noise_of(self, variance: Values, freedom: float, weight: Values, most_weight: Values) -> ErrorFigure:
        """The weighted mean of a variance of the mean image, of so many degrees of freedom."""
        return with_rare(spread_figure(variance * weight, freedom), variance * (most_weight - weight))

    def variance(self) -> tuple[Values, float]:
        """Of the mean of the passes, pixel by pixel, and its degrees of freedom."""
        return variance_of_mean(self._batches)

    def weights(self) -> tuple[Values, Values]:
        """Of a pixel's variance, in place of the truth's; and the same in nine of ten cases at most (ONE_HIT)."""
        mean, darker = self.mean(), self._darker()
        believed = believed_light(mean, darker)
        least = np.maximum(darker, ONE_HIT * np.abs(mean))
        return self.metric.weight(believed), self.metric.weight(np.minimum(believed, least))

    def _darker(self) -> Values:
        return np.minimum(np.abs(self._halves[0]), np.abs(self._halves[1]))

    def _bias(self, mean: Values) -> ErrorFigure:
        if not self._biased:
            return ErrorFigure(0.0, 0.0, 0.0)
        if self._reference is None:
            return self._bias_by_radius(np.ones(mean.shape[:2], np.bool_), mean)
        lit = self._caustic > CAUSTIC_SHARE * sum(self._weights) * np.maximum(mean, 0.0)
        caustic = np.asarray(lit.any(axis=2))
        heard = ~self._reference.any_of(caustic)
        by_reference = self._bias_by_reference(heard, mean)
        deaf = ~self._reference.finer(heard)
        return by_reference if not deaf.any() else _sum(by_reference, self._bias_by_radius(deaf, mean))

    def _bias_by_reference(self, heard: NDArray[np.bool_], mean: Values) -> ErrorFigure:
        """Where `heard`, in pixels of the reference."""
        reference = self._reference
        assert reference is not None
        seen = coarser(mean, reference.factor)
        weight = self.metric.weight(seen) * heard[..., np.newaxis]
        noise, _ = variance_of_mean(self._coarse)
        squared = (seen - reference.a) * (seen - reference.b) - noise
        return centred_figure(squared * weight)

    def _bias_by_radius(self, where: NDArray[np.bool_], mean: Values) -> ErrorFigure:
        alone = self._reference is None and self.metric.is_relative
        if not self._by_radius.known:
            return ErrorFigure(0.0, 0.0, self._most_bias if alone else 0.0)
        weight = self.metric.weight(mean) * where[..., np.newaxis]
        figure = bias_figure(self._by_radius.squared_bias() * weight)
        narrower = ONE_SIDED / NORMAL_QUANTILE  # from an interval of 95 % to one of 80 %
        low, high = figure.value - figure.low, figure.high - figure.value
        upper = figure.value + narrower * high
        if alone:
            upper = min(upper, max(figure.value, self._most_bias))
        return ErrorFigure(figure.value, figure.value - narrower * low, upper)


def most_bias(metric: Metric) -> float:
    """Squared bias at most where nothing tells it. An error that is not relative has a unit, and no such figure."""
    return MOST_BIAS if metric.is_relative else 0.0


def variance_of_mean(batches: Batches) -> tuple[Values, float]:
    """Of the mean of all images that batches hold, and its degrees of freedom.

    The batch that is not full counts, too, by its weight: a rare sample in it is in the mean.
    """
    means: list[NDArray[Any]] = [*batches.means, *([batches.open_mean] if batches.open_count else [])]
    weights = [*batches.weights, *([batches.open_weight] if batches.open_count else [])]
    freedom = freedom_of(weights)
    return spread_of(means, weights) / (sum(weights) * freedom), float(freedom.mean())


def believed_light(mean: Values, darker: Values) -> Values:
    """How bright pixels are taken to be: as both halves saw them, or no brighter than those around.

    Args:
        mean: of both halves, shape [height, width, 3]; darker: of the two, by pixel and channel.
    """
    believed: Values = np.maximum(darker, np.minimum(np.abs(mean), mean_of_neighbours(mean)))
    return believed


def mean_of_neighbours(image: Values) -> Values:
    """Of the eight pixels around each, without itself; those at the edge count twice. Shape [height, width, 3]."""
    height, width = image.shape[:2]
    padded = np.pad(np.abs(image), ((1, 1), (1, 1), (0, 0)), mode="edge")
    around = (padded[y : y + height, x : x + width] for y in range(3) for x in range(3) if (y, x) != (1, 1))
    total = np.zeros(image.shape)
    for each in around:
        total += each
    return total / 8.0


def spread_figure(variance: Values, freedom: float) -> ErrorFigure:
    """The mean of estimated variances over the image, with its interval of 80 %.

    As error_layers.noise_figure: blocks are independent, each spread like a chi-square (Satterthwaite 1946).

    Args:
        variance: shape [height, width, 3].
        freedom: degrees of freedom of the estimates.
    """
    blocks = block_sums(variance)
    value = float(blocks.sum())
    if not value > 0:
        return ErrorFigure(value, value, value)
    together = value**2 * (freedom + 2) / float((blocks**2).sum())
    low, high = (value * together / chi_square_quantile(together, side * ONE_SIDED) for side in (1, -1))
    return ErrorFigure(value, low, high)


def with_rare(noise: ErrorFigure, excess: Values) -> ErrorFigure:
    """A figure of noise whose upper end knows that some pixels may be far darker than their mean.

    Whether they are is a matter of chance for each by itself, so what they add to the upper end adds as squares do: a
    single pixel may make up most of it, a thousand of them are as bright as they should be on the whole.

    Args:
        excess: what the variance of each would weigh more, at most in nine of ten cases, shape [height, width, 3].
    """
    each = excess.mean(axis=2) / (excess.shape[0] * excess.shape[1])
    high = math.hypot(noise.high - noise.value, float(np.sqrt((each**2).sum())))
    return ErrorFigure(noise.value, noise.low, noise.value + high)


def centred_figure(values: Values) -> ErrorFigure:
    """The mean of values over the image, at least 0, with its interval of 80 % from the spread over blocks."""
    blocks = block_sums(values)
    value = float(blocks.sum())
    half = ONE_SIDED * math.sqrt(float(((blocks - blocks.mean()) ** 2).sum()))
    return ErrorFigure(max(value, 0.0), max(value - half, 0.0), max(value + half, 0.0))


def _sum(one: ErrorFigure, other: ErrorFigure) -> ErrorFigure:
    """Of two figures whose errors are independent."""
    value = one.value + other.value
    low = math.hypot(one.value - one.low, other.value - other.low)
    high = math.hypot(one.high - one.value, other.high - other.value)
    return ErrorFigure(value, max(value - low, 0.0), value + high)


def _black(layers: dict[str, NDArray[np.float32]]) -> NDArray[Any]:
    return np.zeros_like(layers["beauty"])
