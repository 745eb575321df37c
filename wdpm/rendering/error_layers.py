"""How far the mean of several passes is from the truth, by what the passes themselves tell: noise, and bias.

**Noise** is what another seed would change. The spread of passes tells the variance of their mean, but it tells too
much: the passes share one sequence of camera samples, which fills the pixel the more evenly the longer it is, so the
mean is better than independent passes would make it. Batches of passes keep most of that; the variance is told by four
to seven of them, of more and more passes each.

**Bias** is what more passes of the same radius would not change: the blur of the density estimate. Where light is
smooth it is proportional to the squared radius (Jensen 2001, section 7; Hachisuka, Jarosz & Jensen 2010, "A progressive
error estimation framework for photon density estimation", section 4), and that is known of each pass. So the light of
the photon maps in pass i is fitted by L + b s_i, with s_i the squared radius as a share of the first one's, and the
mean image is off by b times the mean of s_i. The square of such a fit would be mostly its own noise. So it is fitted
twice, to the passes of even and of odd numbers, and the product of both is what their noise does not add to.

All of it is kept up with each pass: no pass is held any longer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.images.comparison import RELATIVE_FLOOR
from wdpm.report.report import ErrorFigure, ErrorParts, ErrorReport

Values = NDArray[np.float64]

Weight = float | Values
"""Samples of a pixel: one number, or where these differ one for each, shape [height, width, 1]."""

BY_PHOTONS = ("indirect", "caustic", "volume")
"""Layers whose light comes from photon maps; the rest of an image has no bias."""

BATCHES = 8
"""So many batches become half as many, of twice as many passes each."""

LEAST_FOR_NOISE = 2
LEAST_FOR_BIAS = 4
"""Passes: two for each of both fits."""

BLOCKS = 16
"""Blocks along the longer side of an image, whose errors count as independent of each other: photons are shared by the
pixels around them, so pixels are not. A block's own pixels count as one."""

AT_EDGES = 4.0
"""Where light changes at an edge (a shadow's, a caustic's) bias is proportional to the radius instead of its square,
and twice what the fit says; squared, four times. The upper end of the interval allows for that."""

NEIGHBOURS = 2.0
"""Blocks share photons with their neighbours: over seeds, the estimate of the squared bias was found to spread up to
1.6 times as far as independent blocks would let it."""

NORMAL_QUANTILE = 1.959963984540054
"""Of 0.975: intervals are of 95 %."""


_OF_SLOPES = ("weight", "x", "spread")


class Batches:
    """Means of runs of images: at most BATCHES, all of the same number of images, and one that is not full.

    Attributes:
        size: images of a full batch.
        means: float32, shape [height, width, 3], of the full batches; weights: of each (Weight, as an array).
        open_mean, open_weight, open_count: of the batch that is not full.

    Where a pixel has no weight in a batch, the batch says nothing of it.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.size = 1
        self.means: list[NDArray[np.float32]] = []
        self.weights: list[Values] = []
        self.open_mean: Values = np.zeros(shape)
        self.open_weight: Values = np.zeros(())
        self.open_count = 0

    def add(self, image: NDArray[Any], weight: Weight) -> None:
        """Take in an image."""
        self.open_weight = np.asarray(self.open_weight + weight)
        self.open_count += 1
        self.open_mean += (image - self.open_mean) * share_of(weight, self.open_weight)
        if self.open_count == self.size:
            self.means.append(self.open_mean.astype(np.float32))
            self.weights.append(self.open_weight)
            self.open_mean = np.zeros_like(self.open_mean)
            self.open_weight, self.open_count = np.zeros(()), 0
        if len(self.means) == BATCHES:
            self._pair()

    def _pair(self) -> None:
        """Make one batch of every two."""
        weights = [np.asarray(a + b) for a, b in zip(self.weights[::2], self.weights[1::2], strict=True)]
        shares = [share_of(a, both) for a, both in zip(self.weights[::2], weights, strict=True)]
        pairs = zip(self.means[::2], self.means[1::2], shares, strict=True)
        self.means = [(a * share + b.astype(np.float64) * (1.0 - share)).astype(np.float32) for a, b, share in pairs]
        self.weights = weights
        self.size *= 2

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of its state, by name."""
        state: dict[str, NDArray[Any]] = {
            "open": self.open_mean,
            "open weight": self.open_weight,
            "counts": np.array([len(self.means), self.size, self.open_count]),
        }
        for number, (mean, weight) in enumerate(zip(self.means, self.weights, strict=True)):
            state |= {f"{number}.mean": mean, f"{number}.weight": weight}
        return state

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Go on from what `arrays` gave. Raises KeyError or ValueError if that is of another image."""
        full, self.size, self.open_count = (int(count) for count in state["counts"])
        self.open_mean = same_shape(state["open"], self.open_mean)
        self.open_weight = weight_like(state["open weight"], self.open_mean)
        like = np.empty(self.open_mean.shape, np.float32)
        self.means = [same_shape(state[f"{number}.mean"], like) for number in range(full)]
        self.weights = [weight_like(state[f"{number}.weight"], like) for number in range(full)]

    @property
    def freedom(self) -> float:
        """Degrees of freedom of `variance`; the mean over pixels where they differ."""
        return float(freedom_of(self.weights).mean())

    def variance(self, weight: Weight) -> Values:
        """Of the mean of images of that much weight together, as the spread of the full batches tells it."""
        return spread_of(self.means, self.weights) / (weight * freedom_of(self.weights))


def share_of(weight: Weight, together: Weight) -> Values:
    """Of a sum of weights; 0 where that is none."""
    there = np.asarray(together) > 0
    out = np.zeros(np.broadcast_shapes(np.shape(weight), np.shape(together)))
    return np.asarray(np.divide(weight, together, out=out, where=there))


def freedom_of(weights: Sequence[Weight]) -> Values:
    """Degrees of freedom of a spread over batches: one less than those in which a pixel has weight, but at least 1."""
    there = [(np.asarray(weight) > 0).astype(np.float64) for weight in weights]
    return np.asarray(np.maximum(sum(there[1:], there[0]) - 1.0, 1.0))


def spread_of(means: Sequence[NDArray[Any]], weights: Sequence[Weight]) -> Values:
    """Weighted sum of squared distances of images from their mean."""
    total: Values = np.zeros(means[0].shape)
    for each, weight in zip(means, weights, strict=True):
        total += np.multiply(each, weight, dtype=np.float64)
    mean = total / sum(weights[1:], np.asarray(weights[0], np.float64))
    spread: Values = np.zeros(means[0].shape)
    for each, weight in zip(means, weights, strict=True):
        spread += weight * (each - mean) ** 2
    return spread


class Slope:
    """Least squares of images against a number, images coming one by one: image = a + b x.

    Attributes:
        count: of images; weight: the sum of their weights.
        x: weighted mean of the numbers; spread: weighted sum of squared distances from it.
        mean: of the images; together: weighted sum of distances of image times distances of x; float64.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.count = 0
        self.weight: Values = np.zeros(())
        self.x: Values = np.zeros(())
        self.spread: Values = np.zeros(())
        self.mean: Values = np.zeros(shape)
        self.together: Values = np.zeros(shape)

    def add(self, image: Values, x: float, weight: Weight) -> None:
        """Take in an image (West 1979)."""
        self.count += 1
        self.weight = np.asarray(self.weight + weight)
        share, before = share_of(weight, self.weight), x - self.x
        self.x = np.asarray(self.x + before * share)
        self.spread = np.asarray(self.spread + weight * before * (x - self.x))
        distance = image - self.mean
        self.mean += distance * share
        self.together += weight * distance * (x - self.x)

    @property
    def known(self) -> bool:
        """Whether there are images enough for a slope, of every pixel."""
        return self.count >= 2 and bool((self.spread > 0).all())

    def value(self) -> Values:
        """b."""
        return self.together / self.spread


class BiasFit:
    """How far the light of photon maps is off, by how passes change with their radius.

    Args:
        shape: of the image's colour, (height, width, 3).

    Attributes:
        passes: that were taken in.
        slopes: of the passes of even and of odd numbers.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.passes = 0
        self.slopes = (Slope(shape), Slope(shape))

    def add(self, layers: dict[str, NDArray[np.float32]], weight: Weight, share: float) -> None:
        """Take in a pass, as ErrorEstimate does."""
        self.slopes[self.passes % 2].add(sum_of_photons(layers), share, weight)
        self.passes += 1

    @property
    def known(self) -> bool:
        """Whether there are passes enough for both fits."""
        return self.passes >= LEAST_FOR_BIAS and all(slope.known for slope in self.slopes)

    def bias(self) -> Values:
        """Of the mean image, signed, shape [height, width, 3]: both fits together."""
        one, other = self.slopes
        together = one.spread + other.spread
        return (one.together + other.together) * (self._mean_share() / together)

    def squared_bias(self) -> Values:
        """Of the mean image: the product of both fits, which is below zero as often as above where there is no bias."""
        one, other = self.slopes
        return one.value() * other.value() * self._mean_share() ** 2

    def _mean_share(self) -> Values:
        one, other = self.slopes
        return np.asarray((one.x * one.weight + other.x * other.weight) / (one.weight + other.weight))


class ErrorEstimate:
    """What the passes so far tell about the error of their mean.

    Args:
        shape: of the image's colour, (height, width, 3).
        biased: whether it has light from photon maps.
    """

    def __init__(self, shape: tuple[int, ...], biased: bool) -> None:
        self.biased = biased
        self.passes = 0
        self._weight: Values = np.zeros(())
        self._mean: Values = np.zeros(shape)
        self._batches = Batches(shape)
        self._fit = BiasFit(shape if biased else (0,))

    def add(self, layers: dict[str, NDArray[np.float32]], weight: Weight, share: float) -> None:
        """Take in a pass.

        Args:
            weight: samples a pixel.
            share: its squared radius, as a share of the first pass's.
        """
        self._weight = np.asarray(self._weight + weight)
        self._mean += (layers["beauty"] - self._mean) * share_of(weight, self._weight)
        self._batches.add(layers["beauty"], weight)
        if self.biased:
            self._fit.add(layers, weight, share)
        self.passes += 1

    @property
    def has_noise(self) -> bool:
        return self.passes >= LEAST_FOR_NOISE

    @property
    def has_bias(self) -> bool:
        return self.biased and self._fit.known

    def variance(self) -> Values:
        """Of the mean image, shape [height, width, 3]."""
        return self._batches.variance(self._weight)

    def bias(self) -> Values:
        """Of the mean image, signed, shape [height, width, 3]."""
        return self._fit.bias()

    def squared_bias(self) -> Values:
        """Of the mean image, which is below zero as often as above where there is no bias."""
        return self._fit.squared_bias()

    @property
    def mean(self) -> Values:
        """The mean image, shape [height, width, 3]."""
        return self._mean

    def layers(self) -> dict[str, NDArray[np.float32]]:
        """`noise`, the standard error of the mean, and `bias`, as far as the passes tell."""
        found: dict[str, NDArray[np.float32]] = {}
        if self.has_noise:
            found["noise"] = np.sqrt(self.variance()).astype(np.float32)
        if self.has_bias:
            found["bias"] = self.bias().astype(np.float32)
        return found

    def report(self) -> ErrorReport | None:
        """Figures of the whole image; None before there are passes enough."""
        if not self.has_noise:
            return None
        variance = self.variance()
        # The square of a mean is too large by its variance. Left in, it would hide the error of pixels with rare
        # bright samples, which are wrong by most where they are brightest.
        relative = 1.0 / (np.maximum(self._mean**2 - variance, 0.0) + RELATIVE_FLOOR)
        mse, rel_mse = (self._parts(variance, weight) for weight in (np.ones(()), relative))
        return ErrorReport(self.passes, mse, rel_mse)

    def _parts(self, variance: Values, weight: Values) -> ErrorParts:
        noise = noise_figure(variance * weight, self._batches.freedom)
        bias = self._bias_figure(weight)
        return ErrorParts(noise, bias, None if bias is None else added_figures(noise, bias))

    def _bias_figure(self, weight: Values) -> ErrorFigure | None:
        if not self.biased:
            return ErrorFigure(0.0, 0.0, 0.0)
        return bias_figure(self.squared_bias() * weight) if self.has_bias else None

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of its state, by name."""
        state = {f"batches.{name}": array for name, array in self._batches.arrays().items()}
        state |= {"mean": self._mean, "weight": self._weight, "passes": np.array(self.passes)}
        for number, slope in enumerate(self._fit.slopes):
            state |= {f"slope.{number}.{name}": getattr(slope, name) for name in ("mean", "together", *_OF_SLOPES)}
            state[f"slope.{number}.count"] = np.array(slope.count)
        return state

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Go on from what `arrays` gave. Raises KeyError or ValueError if that is of another image."""
        prefix = "batches."
        self._batches.restore({n.removeprefix(prefix): a for n, a in state.items() if n.startswith(prefix)})
        self.passes = self._fit.passes = int(state["passes"])
        self._mean = same_shape(state["mean"], self._mean)
        self._weight = weight_like(state["weight"], self._mean)
        for number, slope in enumerate(self._fit.slopes):
            slope.mean = same_shape(state[f"slope.{number}.mean"], slope.mean)
            slope.together = same_shape(state[f"slope.{number}.together"], slope.together)
            for name in _OF_SLOPES:
                setattr(slope, name, weight_like(state[f"slope.{number}.{name}"], self._mean))
            slope.count = int(state[f"slope.{number}.count"])


def sum_of_photons(layers: dict[str, NDArray[np.float32]]) -> Values:
    """The light that comes from photon maps."""
    return np.sum([layers[name] for name in BY_PHOTONS if name in layers], axis=0, dtype=np.float64)


def noise_figure(variance: Values, freedom: float) -> ErrorFigure:
    """The mean of a variance over the image, with its interval.

    The blocks of the image are independent; the estimate of each is taken to be spread like a chi-square of `freedom`,
    as if all its pixels were one. Their sum is then about a chi-square again (Satterthwaite 1946).

    Args:
        variance: estimated, shape [height, width, channels].
        freedom: degrees of freedom of the estimates.
    """
    blocks = block_sums(variance)
    value = float(blocks.sum())
    if not value > 0:
        return ErrorFigure(value, value, value)
    # The square of such an estimate is too large by 1 + 2 / freedom on average.
    spread = float((blocks**2).sum()) * 2.0 / (freedom + 2)
    together = 2.0 * value**2 / spread
    return ErrorFigure(
        value,
        value * together / chi_square_quantile(together, NORMAL_QUANTILE),
        value * together / chi_square_quantile(together, -NORMAL_QUANTILE),
    )


def bias_figure(squared: Values) -> ErrorFigure:
    """The mean of a squared bias over the image, with its interval.

    Args:
        squared: unbiased estimate of the squared bias, shape [height, width, channels]; may be below zero.
    """
    blocks = block_sums(squared)
    value = float(blocks.sum())
    # The squares of the blocks are their variance, and what is true of them on top.
    half = NEIGHBOURS * NORMAL_QUANTILE * math.sqrt(float((blocks**2).sum()))
    return ErrorFigure(max(value, 0.0), max(value - half, 0.0), max(AT_EDGES * value, 0.0) + half)


def added_figures(noise: ErrorFigure, bias: ErrorFigure) -> ErrorFigure:
    """Noise and squared bias together: their estimates are taken to be independent."""
    value = noise.value + bias.value
    lower = math.hypot(noise.value - noise.low, bias.value - bias.low)
    upper = math.hypot(noise.high - noise.value, bias.high - bias.value)
    return ErrorFigure(value, max(value - lower, 0.0), value + upper)


def block_sums(values: Values) -> Values:
    """Sums over the blocks of an image, of shares of its mean: they add up to that; values that are not finite are 0.

    Args:
        values: shape [height, width, channels].
    """
    height, width = values.shape[:2]
    side = -(-max(height, width) // BLOCKS)
    shares = np.where(np.isfinite(values), values, 0.0).sum(axis=2) / max(np.isfinite(values).sum(), 1)
    rows = np.add.reduceat(shares, np.arange(0, height, side), axis=0)
    return np.asarray(np.add.reduceat(rows, np.arange(0, width, side), axis=1))


def chi_square_quantile(freedom: float, normal: float) -> float:
    """The quantile of a chi-square where a normal distribution has `normal` (Wilson & Hilferty 1931), above 0."""
    ninth = 2.0 / (9.0 * freedom)
    return freedom * max(1.0 - ninth + normal * math.sqrt(ninth), 0.05) ** 3


def same_shape(array: NDArray[Any], like: NDArray[Any]) -> NDArray[Any]:
    """An array that was read, if it is what was written."""
    if array.shape != like.shape or array.dtype != like.dtype:
        raise ValueError(f"{array.dtype} {array.shape}; expected {like.dtype} {like.shape}")
    return array


def weight_like(array: NDArray[Any], image: NDArray[Any]) -> Values:
    """Weights that were read, if they may be those of an image."""
    fits = array.dtype == np.float64 and array.shape in ((), (*image.shape[:-1], 1))
    if not fits:
        raise ValueError(f"weights {array.dtype} {array.shape} of an image {image.shape}")
    return array
