"""Blotches: error that is as wide as areas, told from grain of the same squared error."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rich.console import Console

from wdpm.images.blotches import WIDTH, Blotches, blotches
from wdpm.images.comparison import compare
from wdpm.images.image import Image

SIDE = 128


def found(error: np.ndarray) -> Blotches:
    """Blotches of a grey error, shape [height, width]."""
    told = blotches(np.repeat(error[:, :, None], 3, axis=2))
    assert told is not None
    return told


def grain(scale: float, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, scale, (SIDE, SIDE))


def wave(length: float, height: float) -> np.ndarray:
    """A wave across the image of so many pixels; its root mean square is height / sqrt(2)."""
    x = np.arange(SIDE)
    return np.broadcast_to(height * np.sin(2 * math.pi * x / length), (SIDE, SIDE)).copy()


def test_grain_has_as_many_as_white_noise() -> None:
    assert np.mean([found(grain(0.1, seed)).times for seed in range(8)]) == pytest.approx(1.0, abs=0.1)


def test_a_long_wave_is_a_blotch_and_a_short_one_is_not() -> None:
    assert found(wave(32, 0.1)).error == pytest.approx(0.1 / math.sqrt(2), rel=1e-9)
    assert found(wave(8, 0.1)).error == pytest.approx(0.0, abs=1e-9)
    assert found(wave(2 * WIDTH, 0.02) + grain(0.02)).times > 10


def test_the_same_squared_error_is_told_apart() -> None:
    rough, smooth = grain(0.1), np.repeat(np.repeat(grain(0.1)[::32, ::32], 32, axis=0), 32, axis=1)
    assert found(smooth).error > 5 * found(rough).error
    assert found(smooth).times > 20


def test_what_all_pixels_are_off_by_is_no_blotch() -> None:
    assert found(wave(32, 0.1) + 0.3).error == pytest.approx(found(wave(32, 0.1)).error, rel=1e-9)
    assert blotches(np.full((SIDE, SIDE, 3), 0.3)) is None


def test_a_single_bright_pixel_hides_nothing() -> None:
    error = wave(32, 0.1)
    before = found(error)
    error[5, 7] = 1e6
    assert found(error).error == pytest.approx(before.error, rel=0.1)


def test_what_is_not_finite_counts_as_right() -> None:
    error = wave(32, 0.1)
    error[3, 4], error[5, 6] = math.nan, math.inf
    assert found(error).error == pytest.approx(found(wave(32, 0.1)).error, rel=0.01)


def test_a_small_image_has_none() -> None:
    assert blotches(np.random.default_rng(0).random((8, 8, 3))) is None


def test_a_comparison_tells_them_as_a_share_of_the_light() -> None:
    light = np.full((SIDE, SIDE, 3), 10.0, np.float32)
    off = (light * (1.0 + wave(32, 0.1)[:, :, None])).astype(np.float32)
    figures = compare(Image({"beauty": off}), Image({"beauty": light}))
    assert figures.blotches is not None
    assert figures.blotches.error == pytest.approx(0.1 / math.sqrt(2), rel=1e-4)
    console = Console(width=120)
    with console.capture() as shown:
        figures.print(console)
    assert "7.07% over 16 pixels and more" in shown.get()
    assert '"blotches"' in figures.to_json()
