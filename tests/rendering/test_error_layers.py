"""Noise and bias from passes, held against passes whose noise and bias are known because they were made up."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.rendering.error_layers import (
    BATCHES,
    Batches,
    ErrorEstimate,
    Slope,
    bias_figure,
    block_sums,
    chi_square_quantile,
    noise_figure,
)
from wdpm.rendering.pass_plan import shrink
from wdpm.report.report import ErrorFigure, ErrorReport

SHAPE = (64, 64, 3)
PIXEL = 4
"""Side of the squares of pixels that share their photons, and so their noise."""


def noise(rng: np.random.Generator, shape: tuple[int, ...] = SHAPE) -> NDArray[np.float64]:
    """Standard normal, the same for all pixels of a square."""
    coarse = rng.standard_normal((shape[0] // PIXEL, shape[1] // PIXEL, 3))
    return np.repeat(np.repeat(coarse, PIXEL, 0), PIXEL, 1)


def estimate(
    rng: np.random.Generator,
    passes: int,
    sigma: float,
    slope: float,
    direct: float = 1.0,
    weights: tuple[int, ...] = (4,),
) -> tuple[ErrorEstimate, NDArray[np.float64]]:
    """The estimate from made-up passes, and their mean."""
    found, total, weight = ErrorEstimate(SHAPE, biased=True), np.zeros(SHAPE), 0
    for number in range(passes):
        spp = weights[number % len(weights)]
        indirect = 1.0 + slope * shrink(number) + sigma * noise(rng) / np.sqrt(spp)
        layers = {"indirect": indirect.astype(np.float32), "direct": np.full(SHAPE, direct, np.float32)}
        layers["beauty"] = (indirect + direct).astype(np.float32)
        found.add(layers, spp, shrink(number))
        total, weight = total + spp * layers["beauty"].astype(np.float64), weight + spp
    return found, total / weight


def report_of(found: ErrorEstimate) -> ErrorReport:
    report = found.report()
    assert report is not None
    return report


def covers(figure: ErrorFigure | None, truth: float) -> bool:
    assert figure is not None
    assert figure.low <= figure.value <= figure.high
    return figure.low <= truth <= figure.high


def test_batches_are_means_of_equally_many_images() -> None:
    rng = np.random.default_rng(0)
    images, weights = rng.normal(5, 1, (37, 3, 2)), rng.integers(1, 9, 37).astype(float)
    batches = Batches((3, 2))
    for number, (image, weight) in enumerate(zip(images, weights, strict=True), 1):
        batches.add(image, weight)
        full = number // batches.size
        assert len(batches.means) == full
        assert number < 2 or 2 <= full < BATCHES
    assert batches.size == 8
    for index, (mean, weight) in enumerate(zip(batches.means, batches.weights, strict=True)):
        run = slice(8 * index, 8 * index + 8)
        assert weight == weights[run].sum()
        np.testing.assert_allclose(mean, np.average(images[run], axis=0, weights=weights[run]), rtol=1e-6)
    assert (batches.open_count, batches.open_weight) == (5, weights[32:].sum())


def test_a_slope_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(0)
    x, weights = rng.normal(2, 1, 9), rng.integers(1, 9, 9).astype(float)
    images = rng.normal(5, 1, (9, 3, 2)) + x[:, None, None]
    slope = Slope((3, 2))
    for image, number, weight in zip(images, x, weights, strict=True):
        slope.add(image, number, weight)
    expected = np.polyfit(x, images.reshape(9, -1), 1, w=np.sqrt(weights))[0]
    np.testing.assert_allclose(slope.value().ravel(), expected)


def test_samples_of_one_sequence_are_known_to_be_better_than_independent_ones() -> None:
    """Where errors of passes cancel, batches of them show it: here every odd pass takes back what the even one did."""
    rng = np.random.default_rng(0)
    found = ErrorEstimate(SHAPE, biased=False)
    error = np.zeros(SHAPE)
    for number in range(16):
        error = noise(rng) if number % 2 == 0 else -0.9 * error
        found.add({"beauty": (2 + error).astype(np.float32)}, 4, shrink(number))
    # Each pair is off by a tenth of a pass, halved; there are eight.
    assert report_of(found).mse.noise.value == pytest.approx(0.05**2 / 8, rel=0.3)


@pytest.mark.parametrize("passes", [2, 3, 8, 32])
@pytest.mark.parametrize("weights", [(4,), (5, 4, 4)])
def test_the_estimate_of_noise_is_unbiased(passes: int, weights: tuple[int, ...]) -> None:
    rng, runs = np.random.default_rng(passes), 40
    spp = sum(weights[number % len(weights)] for number in range(passes))
    found = [report_of(estimate(rng, passes, 0.3, 0.0, weights=weights)[0]).mse.noise for _ in range(runs)]
    truth = 0.3**2 / spp
    # 256 independent squares of 3 channels, and one degree of freedom, two, or at least three, in each of 40 runs.
    freedom = min(passes - 1, 3)
    assert np.mean([f.value for f in found]) == pytest.approx(truth, rel=4 * np.sqrt(2 / (256 * 3 * freedom * runs)))
    assert sum(covers(f, truth) for f in found) >= 0.85 * runs


def test_noise_that_few_blocks_have_is_told_with_a_wide_interval() -> None:
    """A caustic in one block of 256: the estimate is no better than that one block's."""
    variance = np.zeros(SHAPE)
    variance[:4, :4] = 1.0
    few = noise_figure(variance, freedom=3)
    even = noise_figure(np.full(SHAPE, variance.mean()), freedom=3)
    assert few.value == pytest.approx(even.value)
    assert few.high / few.low > 10 > 2 > even.high / even.low


@pytest.mark.parametrize("passes", [4, 7, 24])
def test_the_bias_is_found(passes: int) -> None:
    rng, runs = np.random.default_rng(passes), 40
    found = [estimate(rng, passes, 0.01, -0.2)[0] for _ in range(runs)]
    share = np.mean([shrink(number) for number in range(passes)])
    truth = -0.2 * share
    layers = [each.layers() for each in found]
    assert np.mean([layer["bias"].mean() for layer in layers]) == pytest.approx(truth, rel=0.03)
    figures = [report_of(each).mse.bias for each in found]
    assert np.mean([figure.value for figure in figures if figure]) == pytest.approx(truth**2, rel=0.06)
    assert all(covers(figure, truth**2) for figure in figures)
    # A bias that is proportional to the radius is twice what the fit says, and below the upper end.
    assert all(figure.high > 4 * 0.9 * truth**2 for figure in figures if figure)


@pytest.mark.parametrize("passes", [4, 8, 15])
def test_noise_is_not_taken_for_bias(passes: int) -> None:
    rng = np.random.default_rng(1)
    found = [estimate(rng, passes, 0.5, 0.0)[0] for _ in range(40)]
    figures = [report_of(each).mse.bias for each in found]
    raw = [float((each.bias() ** 2).mean()) for each in found]
    assert abs(np.mean([float(each.squared_bias().mean()) for each in found])) < 0.03 * np.mean(raw)
    assert sum(covers(figure, 0.0) for figure in figures) >= 0.9 * len(figures)


def test_direct_light_has_no_bias_and_takes_no_part_in_its_noise() -> None:
    faint, _ = estimate(np.random.default_rng(2), 5, 0.1, 0.3, direct=0.0)
    bright, _ = estimate(np.random.default_rng(2), 5, 0.1, 0.3, direct=1000.0)
    np.testing.assert_array_equal(faint.bias(), bright.bias())


def test_the_total_is_what_the_mean_image_is_off() -> None:
    rng, runs = np.random.default_rng(3), 40
    totals, errors, relative, relative_errors = [], [], [], []
    for _ in range(runs):
        found, mean = estimate(rng, 6, 0.4, 0.3)
        report = report_of(found)
        assert report.mse.total is not None
        assert report.rel_mse.total is not None
        totals.append(report.mse.total.value)
        relative.append(report.rel_mse.total.value)
        errors.append(((mean - 2.0) ** 2).mean())
        relative_errors.append(((mean - 2.0) ** 2 / (2.0**2 + 0.01)).mean())
    assert np.mean(totals) == pytest.approx(np.mean(errors), rel=0.1)
    # The relative figure divides by the image's own square, which the bias makes larger here: (2.2 / 2)².
    assert np.mean(relative) == pytest.approx(np.mean(relative_errors), rel=0.3)


def test_too_few_passes_tell_less() -> None:
    rng = np.random.default_rng(4)
    one, two = estimate(rng, 1, 0.1, 0.1)[0], estimate(rng, 2, 0.1, 0.1)[0]
    assert one.report() is None
    assert one.layers() == {}
    assert report_of(two).mse.bias is None
    assert report_of(two).mse.total is None
    assert two.layers().keys() == {"noise"}
    three, four = (estimate(rng, count, 0.1, 0.1)[0] for count in (3, 4))
    assert report_of(three).mse.bias is None
    assert report_of(four).mse.bias is not None


def test_passes_that_are_all_alike_have_no_error() -> None:
    found, _ = estimate(np.random.default_rng(5), 4, 0.0, 0.0)
    report = report_of(found)
    assert report.mse.noise == ErrorFigure(0.0, 0.0, 0.0)
    assert report.mse.bias == ErrorFigure(0.0, 0.0, 0.0)


def test_values_that_are_not_finite_are_left_out() -> None:
    values = np.ones((5, 7, 3))
    values[2, 3, 1] = np.nan
    assert block_sums(values).sum() == pytest.approx(1.0)


def test_a_bias_below_its_own_noise_is_told_as_none() -> None:
    squared = np.random.default_rng(0).standard_normal(SHAPE) - 0.1
    figure = bias_figure(squared)
    assert (figure.value, figure.low) == (0.0, 0.0)
    assert figure.high > 0


@pytest.mark.parametrize(
    ("freedom", "low", "high"),
    [(1, 0.000982, 5.024), (5, 0.831, 12.833), (30, 16.791, 46.979), (1000, 914.26, 1089.53)],
)
def test_quantiles_of_chi_square(freedom: float, low: float, high: float) -> None:
    assert chi_square_quantile(freedom, 1.959964) == pytest.approx(high, rel=0.02)
    if freedom >= 5:  # below, it is bounded away from 0
        assert chi_square_quantile(freedom, -1.959964) == pytest.approx(low, rel=0.05)
