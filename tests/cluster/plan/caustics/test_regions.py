"""Regions of places: all hold about as many, wherever these lie."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.cluster.plan.regions import divide

PLACES = 1024


def scattered(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).random((PLACES, 3)).astype(np.float32)


def on_a_wall() -> np.ndarray:
    """Most at one and the same x, on which the others lie apart: x is the longest side."""
    places = scattered() * np.float32(0.5)
    places[:, 0] = np.where(np.arange(PLACES) % 8 == 0, np.linspace(0.0, 9.0, PLACES), 0.0)
    return places


def in_corners() -> np.ndarray:
    """On three walls that meet."""
    places = scattered()
    places[np.arange(PLACES), np.arange(PLACES) % 3] = 0.0
    return places


@pytest.mark.parametrize("places", [scattered(), on_a_wall(), in_corners()], ids=["scattered", "wall", "corner"])
def test_regions_hold_about_as_many_places(places: np.ndarray) -> None:
    count = np.bincount(divide(places, 32).of(places), minlength=32)
    assert count.sum() == PLACES
    assert len(count) == 32
    assert count.min() >= 16
    assert count.max() <= 64


def test_places_that_coincide_share_a_region() -> None:
    places = np.zeros((PLACES, 3), np.float32)
    places[:8] = 1.0
    region = divide(places, 32).of(places)
    assert len(set(region[8:])) == 1
    assert len(set(region[:8])) == 1
    assert region[0] != region[8]
