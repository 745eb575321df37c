"""Noise and bias from several seeds: against their definitions, and against errors that are known."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.accuracy.error import SplitError, Truth, error_gained, own_noise, split_error
from wdpm.scenes.errors import SettingsError

SHAPE = (48, 64, 3)


def renders(
    seed: int, count: int, noise: float, bias: NDArray[np.float64] | float, blur: int = 1
) -> list[NDArray[np.float32]]:
    """Images around 1, with noise that `blur` neighbouring rows share."""
    rng = np.random.default_rng(seed)
    images = []
    for _ in range(count):
        rows = rng.normal(0, noise, (SHAPE[0] // blur, *SHAPE[1:]))
        images.append((1 + bias + np.repeat(rows, blur, axis=0)).astype(np.float32))
    return images


def test_against_their_definitions() -> None:
    images = renders(1, 4, 0.3, 0.2)
    reference = np.random.default_rng(2).uniform(0.5, 1.5, SHAPE)
    truth = Truth(reference)
    split = split_error(images, truth, truth.relative)
    stack = np.stack(images).astype(np.longdouble)
    weight = 1 / (reference**2 + 0.01)
    error = (weight * (stack - reference) ** 2).mean()
    noise = (weight * stack.var(axis=0, ddof=1)).mean()
    mean_error = (weight * (stack.mean(axis=0) - reference) ** 2).mean()
    assert split.error.value == pytest.approx(float(error), rel=1e-12)
    assert split.noise.value == pytest.approx(float(noise), rel=1e-12)
    assert split.bias.value == pytest.approx(float(mean_error - noise / 4), rel=1e-12)
    assert split.noise.value + split.bias.value == pytest.approx(split.error.value, rel=1e-12)


def test_the_noise_of_the_reference_is_taken_off() -> None:
    rng = np.random.default_rng(3)
    a, b = (1 + rng.normal(0, 0.1, SHAPE) for _ in range(2))
    truth = Truth((a + b) / 2, (a - b) / 2)
    split = split_error(renders(4, 3, 0.2, 0.0), truth, np.ones(SHAPE))
    assert own_noise(truth, np.ones(SHAPE)) == pytest.approx(0.1**2 / 2, rel=0.05)
    assert split.bias.low < 0 < split.bias.high
    assert split.error.value == pytest.approx(0.2**2, rel=0.05)


@pytest.mark.parametrize("blur", [1, 3])
def test_intervals_hold_what_is_true(blur: int) -> None:
    y, x, _ = np.meshgrid(*map(np.arange, SHAPE), indexing="ij")
    bias = 0.05 * np.sin(x / 7) * np.cos(y / 5)
    true = {"noise": 0.1**2, "bias": float((bias**2).mean())}
    true["error"] = true["noise"] + true["bias"]
    held = dict.fromkeys(true, 0)
    trials = 60
    for trial in range(trials):
        rng = np.random.default_rng(1000 + trial)
        halves = [1 + rng.normal(0, 0.05, SHAPE) for _ in range(2)]
        truth = Truth((halves[0] + halves[1]) / 2, (halves[0] - halves[1]) / 2)
        split: SplitError = split_error(renders(trial, 3, 0.1, bias, blur), truth, np.ones(SHAPE))
        for name, value in true.items():
            figure = getattr(split, name)
            held[name] += figure.low <= value <= figure.high
    assert all(count >= 0.9 * trials for count in held.values()), held


def test_noise_and_bias_are_unbiased() -> None:
    bias = np.full(SHAPE, 0.03)
    splits = [split_error(renders(trial, 3, 0.1, bias), Truth(np.ones(SHAPE)), np.ones(SHAPE)) for trial in range(40)]
    assert np.mean([split.noise.value for split in splits]) == pytest.approx(0.01, rel=0.01)
    assert np.mean([split.bias.value for split in splits]) == pytest.approx(0.0009, rel=0.05)


def test_errors_of_the_same_seeds_are_told_apart_by_their_difference() -> None:
    base = renders(8, 3, 0.3, 0.0)
    images = [
        (image + 0.004 * (image - 1)).astype(np.float32) for image in base
    ]  # 0.8 % more error, from the same noise
    truth = Truth(np.ones(SHAPE))
    gained = error_gained(images, base, truth, truth.relative)
    one, other = (split_error(each, truth, truth.relative).error for each in (images, base))
    assert gained.value == pytest.approx(one.value - other.value, rel=1e-9)
    assert gained.low > 0
    assert one.low < other.value, "alone, their intervals would not tell"
    assert error_gained(base, base, truth, truth.relative).high == 0


def test_what_is_not_finite_is_left_out() -> None:
    images = renders(5, 3, 0.1, 0.1)
    spoiled = [image.copy() for image in images]
    spoiled[1][3, 4, 0] = np.nan
    keep = np.ones(SHAPE, bool)
    keep[3, 4, 0] = False
    split = split_error(spoiled, Truth(np.ones(SHAPE)), np.ones(SHAPE))
    expected = np.mean([((image.astype(np.float64) - 1) ** 2)[keep].mean() for image in images])
    assert split.error.value == pytest.approx(float(expected), rel=1e-12)


def test_the_order_of_seeds_does_not_matter() -> None:
    images = renders(6, 3, 0.1, 0.1)
    truth = Truth(np.ones(SHAPE))
    figures = [split_error(list(order), truth, truth.relative).bias.value for order in itertools.permutations(images)]
    assert figures == pytest.approx([figures[0]] * len(figures), rel=1e-9)


def test_two_seeds_are_too_few() -> None:
    with pytest.raises(SettingsError, match="at least 3"):
        split_error(renders(7, 2, 0.1, 0.1), Truth(np.ones(SHAPE)), np.ones(SHAPE))
