"""The estimate that a render stops at, with simulated passes whose true error is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.goal.convergence import (
    LEAST_PASSES,
    MOST_BIAS,
    ConvergenceEstimator,
    believed_light,
    centred_figure,
    most_bias,
    spread_figure,
    with_rare,
)
from wdpm.goal.goal import Metric
from wdpm.goal.reference_pair import ReferencePair, coarser, factor_for
from wdpm.rendering.pass_plan import shrink
from wdpm.report.report import ErrorFigure

Values = NDArray[np.float64]

SIZE = 32


class Passes:
    """Simulated: light of 0.2 to 2, noise shared by squares of pixels as photons share it, and a smooth blur.

    Args:
        noise: standard deviation of a pixel of one pass, relative to its light; bias: the same of the first radius.
        rare: share of samples that are `bright` times too bright, and make up for it by all others.
    """

    def __init__(self, seed: int, noise: float, bias: float, rare: float = 0.0, bright: float = 50.0) -> None:
        self.random = np.random.default_rng(seed)
        x = np.linspace(0.2, 2.0, SIZE)
        self.truth: Values = np.repeat(np.add.outer(x, x)[..., np.newaxis] / 2, 3, axis=2)
        self.noise, self.bias, self.rare, self.bright = noise, bias, rare, bright
        wave = np.sin(np.arange(SIZE) / 4.0)
        self.blur: Values = self.truth * (np.outer(wave, wave) * 2.0)[..., np.newaxis]

    def render(self, number: int) -> dict[str, NDArray[np.float32]]:
        """The layers of a pass: half of its light is told to come from photons."""
        squares = self.random.normal(size=(SIZE // 2, SIZE // 2, 1)).repeat(2, axis=0).repeat(2, axis=1)
        pixels = self.random.normal(size=self.truth.shape)
        relative = self.noise * np.sqrt(0.5) * (squares + pixels)
        if self.rare:
            hit = self.random.random((SIZE, SIZE, 1)) < self.rare
            relative += np.where(hit, self.bright, -self.bright * self.rare / (1 - self.rare))
        photons = 0.5 * self.truth + shrink(number) * self.bias * self.blur
        image = photons + 0.5 * self.truth + relative * self.truth
        return {"beauty": image.astype(np.float32), "indirect": photons.astype(np.float32)}

    def reference(self, noise: float) -> ReferencePair:
        """Of the truth, with independent noise."""
        small = coarser(self.truth, 4)
        a, b = (small * (1.0 + noise * self.random.normal(size=small.shape)) for _ in range(2))
        return ReferencePair(a, b, 4, 1)

    def error(self, image: Values) -> float:
        return float(((image - self.truth) ** 2 / (self.truth**2 + 0.01)).mean())


def run_until(passes: Passes, error: float, reference: ReferencePair | None, biased: bool = True) -> tuple[float, int]:
    """The true error of where it stops, and after how many passes."""
    estimator = ConvergenceEstimator(passes.truth.shape, Metric.RELMSE, biased, reference)
    for number in range(2000):
        estimator.add(passes.render(number), 1, shrink(number))
        estimate = estimator.estimate()
        if estimate is not None and estimate.total.high <= error:
            return passes.error(estimator.mean()), number + 1
    raise AssertionError("never stopped")


@pytest.mark.parametrize("noise", [0.2, 0.6])
@pytest.mark.parametrize("bias", [0.0, 0.05])
def test_where_it_stops_the_true_error_is_within_what_was_asked_for_in_nine_of_ten_runs(
    noise: float, bias: float
) -> None:
    errors = []
    for seed in range(40):
        passes = Passes(seed, noise, bias)
        errors.append(run_until(passes, 0.02, passes.reference(0.1))[0])
    assert np.mean(np.array(errors) <= 0.02) >= 0.9
    assert np.median(errors) >= 0.02 / 4  # and little is spent in vain


def test_it_does_not_stop_while_a_bias_is_too_large() -> None:
    """Noise is small after a few passes; the blur is what has to shrink."""
    passes = Passes(1, 0.05, 0.3)
    first = passes.error(np.mean([passes.render(number)["beauty"] for number in range(4)], axis=0))
    assert first > 0.04
    error, count = run_until(Passes(1, 0.05, 0.3), 0.02, passes.reference(0.1))
    assert error <= 0.02
    assert count > 8


def test_rare_bright_samples_are_not_hidden_by_the_brightness_that_they_lend_a_pixel() -> None:
    """The spread over the mean's own square is at most one over the passes, whatever a sample's brightness."""
    told, naive, true = [], [], []
    for seed in range(12):
        passes = Passes(seed, 0.1, 0.0, rare=1e-4, bright=300.0)
        estimator = ConvergenceEstimator(passes.truth.shape, Metric.RELMSE, False)
        images = []
        for number in range(16):
            layers = passes.render(number)
            images.append(layers["beauty"].astype(np.float64))
            estimator.add(layers, 1, 1.0)
        estimate = estimator.estimate()
        assert estimate is not None
        mean = estimator.mean()
        told.append(estimate.noise.value)
        naive.append(float((np.var(images, axis=0, ddof=1) / 16 / (mean**2 + 0.01)).mean()))
        true.append(passes.error(mean))
    assert np.mean(true) > 10 * np.mean(naive)
    assert np.mean(told) > 5 * np.mean(naive)


def test_a_lamp_s_edge_that_few_samples_meet_is_within_the_upper_end() -> None:
    """A pixel of which any share may be a lamp's, all as likely: beside the lamp, and in the dark."""
    held: dict[bool, list[bool]] = {False: [], True: []}
    for seed in range(200):
        passes = Passes(seed, 0.01, 0.0)
        beside, share = bool(seed % 2), passes.random.random()
        middle = SIZE // 2
        if beside:
            passes.truth[: middle + 1, middle + 1 :] = 17.0
        passes.truth[middle, middle] = share * 17.0
        estimator = ConvergenceEstimator(passes.truth.shape, Metric.RELMSE, False)
        for _ in range(4):
            layers = passes.render(0)
            layers["beauty"][middle, middle] = 17.0 if passes.random.random() < share else 0.0
            estimator.add(layers, 1, 1.0)
        estimate = estimator.estimate()
        assert estimate is not None
        if 0.0 < estimator.mean()[middle, middle, 0] < 16.9:  # what samples agree on, right or wrong, no spread tells
            held[beside].append(passes.error(estimator.mean()) <= estimate.noise.high)
    assert min(map(len, held.values())) > 20
    assert np.mean(held[True]) >= 0.85
    assert np.mean(held[False]) >= 0.9


def test_what_may_be_off_by_chance_evens_out_over_many_pixels() -> None:
    one, many = np.zeros((10, 10, 3)), np.ones((10, 10, 3))
    one[0, 0] = 100.0
    noise = ErrorFigure(1.0, 0.5, 1.5)
    assert with_rare(noise, one).high == pytest.approx(1.0 + np.hypot(0.5, 1.0))
    assert with_rare(noise, many).high == pytest.approx(1.0 + np.hypot(0.5, 0.1))
    assert (with_rare(noise, many).value, with_rare(noise, many).low) == (1.0, 0.5)


def test_the_edge_of_a_lamp_is_not_taken_for_a_rare_bright_pixel() -> None:
    """One half saw a pixel beside the lamp lit: its error is that of a bright pixel, not of one in the dark."""
    mean, darker = np.zeros((8, 8, 3)), np.zeros((8, 8, 3))
    mean[:4] = darker[:4] = 10.0
    mean[4, 4] = mean[6, 2] = 5.0
    believed = believed_light(mean, darker)
    assert np.all(believed[4, 4] == 30.0 / 8)
    assert np.all(believed[6, 2] == 0.0)
    assert np.all(believed[:4] == 10.0)


def test_a_lamp_as_small_as_a_pixel_is_no_chance() -> None:
    """Every pass sees it, with noise of its own: its error counts beside its own brightness."""
    passes = Passes(6, 0.1, 0.0)
    passes.truth[SIZE // 2, SIZE // 2] = 100.0
    estimator = ConvergenceEstimator(passes.truth.shape, Metric.RELMSE, False)
    for number in range(4):
        estimator.add(passes.render(number), 1, 1.0)
    estimate = estimator.estimate()
    assert estimate is not None
    assert estimate.noise.value == pytest.approx(0.1**2 / 4, rel=0.3)


def test_without_photons_there_is_no_bias() -> None:
    passes = Passes(3, 0.1, 0.0)
    estimator = ConvergenceEstimator(passes.truth.shape, Metric.RELMSE, False)
    for number in range(5):
        estimator.add(passes.render(number), 2, 1.0)
    estimate = estimator.estimate()
    assert estimate is not None
    assert estimate.bias.high == 0
    assert estimate.total == estimate.noise
    assert estimate.noise.value == pytest.approx(0.1**2 / 5, rel=0.3)


def test_rmse_is_of_unweighted_squares() -> None:
    passes = Passes(4, 0.1, 0.0)
    estimator = ConvergenceEstimator(passes.truth.shape, Metric.RMSE, False)
    for number in range(5):
        estimator.add(passes.render(number), 1, 1.0)
    estimate = estimator.estimate()
    assert estimate is not None
    expected = float(((0.1 * passes.truth) ** 2).mean() / 5)
    assert estimate.noise.value == pytest.approx(expected, rel=0.3)
    assert Metric.RMSE.figure(Metric.RMSE.mean_square(0.3)) == pytest.approx(0.3)


def test_one_pass_tells_nothing() -> None:
    passes = Passes(5, 0.1, 0.0)
    estimator = ConvergenceEstimator(passes.truth.shape, Metric.RELMSE, True)
    for number in range(LEAST_PASSES - 1):
        estimator.add(passes.render(number), 1, 1.0)
        assert estimator.estimate() is None


def test_a_noisy_reference_widens_the_interval_and_does_not_shift_it() -> None:
    figures = []
    for seed in range(30):
        passes = Passes(seed, 0.02, 0.1)
        estimator = ConvergenceEstimator(passes.truth.shape, Metric.RELMSE, True, passes.reference(0.3))
        for _ in range(4):
            estimator.add(passes.render(0), 1, 1.0)
        estimate = estimator.estimate()
        assert estimate is not None
        figures.append(estimate.bias)
    small = Passes(0, 0.0, 0.1)
    bias, truth = coarser(small.blur * 0.1, 4), coarser(small.truth, 4)
    true = float((bias**2 / (truth**2 + 0.01)).mean())
    assert np.mean([figure.value for figure in figures]) == pytest.approx(true, rel=0.3)
    assert np.mean([figure.high >= true for figure in figures]) >= 0.8


def test_a_bias_that_nothing_tells_is_counted_as_the_most_by_experience() -> None:
    for metric, most in ((Metric.RELMSE, MOST_BIAS), (Metric.RMSE, 0.0)):
        passes = Passes(8, 0.1, 0.0)
        estimator = ConvergenceEstimator(passes.truth.shape, metric, True)
        for number in range(2):
            estimator.add(passes.render(number), 1, shrink(number))
        estimate = estimator.estimate()
        assert estimate is not None
        assert (estimate.bias.value, estimate.bias.high) == (0.0, most)
        assert most_bias(metric) == most


def test_caustics_are_not_the_reference_s_to_judge() -> None:
    """Paths that miss a caustic would call it bias."""
    passes = Passes(6, 0.02, 0.0)
    dark = passes.reference(0.0)
    blind = ReferencePair(dark.a * 0.5, dark.b * 0.5, 4, 1)
    figures = {}
    for with_caustic in (False, True):
        estimator = ConvergenceEstimator(passes.truth.shape, Metric.RELMSE, True, blind)
        for number in range(6):
            layers = passes.render(number)
            if with_caustic:
                layers["caustic"] = layers["beauty"] * np.float32(0.5)
            estimator.add(layers, 1, shrink(number))
        estimate = estimator.estimate()
        assert estimate is not None
        figures[with_caustic] = estimate.bias.value
    assert figures[False] > 0.1
    assert figures[True] < 0.05


def test_intervals_hold_the_truth() -> None:
    random = np.random.default_rng(7)
    held, freedom = [], 4
    for _ in range(200):
        variance = random.chisquare(freedom, (16, 16, 1)).repeat(4, axis=0).repeat(4, axis=1) / freedom
        figure = spread_figure(np.repeat(variance, 3, axis=2), freedom)
        held.append(figure.low <= 1.0 <= figure.high)
    assert 0.7 <= np.mean(held) <= 0.95
    centred = [centred_figure(1.0 + random.normal(size=(64, 64, 3))) for _ in range(200)]
    assert 0.7 <= np.mean([figure.low <= 1.0 <= figure.high for figure in centred]) <= 0.9


def test_a_reference_s_pixels_cover_whole_pixels() -> None:
    assert [factor_for(*size) for size in ((256, 256), (320, 180), (198, 122), (255, 256), (64, 64))] == [4, 2, 2, 1, 1]
    image = np.arange(2 * 4 * 3, dtype=np.float64).reshape(2, 4, 3)
    assert np.array_equal(coarser(image, 2), image.reshape(1, 2, 2, 2, 3).mean(axis=(1, 3)))
