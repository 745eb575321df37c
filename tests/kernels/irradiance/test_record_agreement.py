"""How far irradiance records reach without contradicting each other."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.irradiance.cache import interpolate
from wdpm.kernels.irradiance.record_agreement import LEAST_SHARE, agreeing
from wdpm.kernels.irradiance.record_tree import build

Floats = NDArray[np.float64]
Records = dict[str, NDArray[np.generic]]

RADIUS, TOLERANCE, SLOPE, BEND = 0.3, 0.1, 4.0, 0.5


def bent(x: Floats) -> tuple[Floats, Floats]:
    """Irradiance that is 1 up to BEND and rises from there on, and its slope."""
    return 1.0 + SLOPE * np.maximum(x - BEND, 0.0), np.where(x > BEND, SLOPE, 0.0)


def straight(x: Floats) -> tuple[Floats, Floats]:
    return 2.0 - x, np.full(len(x), -1.0)


def records_of(x: Floats, value: Floats, slope: Floats, radius: float = RADIUS) -> Records:
    """On a line of a floor, without any turn."""
    count = len(x)
    translation = np.zeros((count, 3, 3), np.float32)
    translation[:, :, 0] = slope[:, None]
    return {
        "number": np.arange(count, dtype=np.int64),
        "position": np.stack([x, 0 * x, 0 * x], axis=1).astype(np.float32),
        "normal": np.tile(np.float32([0, 0, 1]), (count, 1)),
        "radius": np.full(count, radius, np.float32),
        "irradiance": np.tile(value[:, None], (1, 3)).astype(np.float32),
        "rotation": np.zeros((count, 3, 3), np.float32),
        "translation": translation,
        "grazing": np.zeros(count, np.float32),
    }


def error_between(records: Records, radius: NDArray[np.float32]) -> float:
    """Largest relative error of what is read between records of the bent irradiance."""
    x = np.linspace(0.05, 0.95, 400)
    place = wp.array(np.stack([x, 0 * x, 0 * x], axis=1), dtype=wp.vec3, device="cpu")
    normal = wp.full(len(x), wp.vec3(0.0, 0.0, 1.0), dtype=wp.vec3, device="cpu")
    out = [wp.empty(len(x), dtype=kind, device="cpu") for kind in (wp.vec3, wp.float32, wp.float32, wp.int32)]
    wp.launch(interpolate, len(x), inputs=[build({**records, "radius": radius}), place, normal, 0, *out], device="cpu")
    assert out[2].numpy().min() > 0
    return float(np.abs(out[0].numpy()[:, 0] / bent(x)[0] - 1.0).max())


@pytest.mark.parametrize("value", [1.0, 0.0])
def test_records_that_agree_reach_as_far_as_before(value: float) -> None:
    x = np.linspace(0, 1, 30)
    light, slope = straight(x)
    same = records_of(x, value * light, value * slope)
    np.testing.assert_array_equal(agreeing(same, TOLERANCE), same["radius"])


def test_records_end_where_what_they_expect_is_wrong() -> None:
    """The rule, record by record: the least of way * sqrt(tolerance / error), but a quarter of the reach."""
    x = np.linspace(0.013, 0.991, 41)
    light, slope = bent(x)
    found = agreeing(records_of(x, light, slope), TOLERANCE)
    way = np.abs(x[:, None] - x[None, :])
    expected = np.maximum(light[:, None] + slope[:, None] * (x[None, :] - x[:, None]), 0.0)
    error = np.abs(expected - light[None, :]) / np.maximum(expected, light[None, :])
    wrong = (way < RADIUS) & (error > TOLERANCE)
    limit = np.where(wrong, way * np.sqrt(TOLERANCE / np.maximum(error, TOLERANCE)), RADIUS).min(axis=1)
    np.testing.assert_allclose(found, np.maximum(limit, float(LEAST_SHARE) * RADIUS), rtol=1e-5)
    far = np.abs(x - BEND) > RADIUS + 0.01
    assert far.any()
    assert (found[far] == np.float32(RADIUS)).all()
    assert found[~far].min() < 0.6 * RADIUS


def test_what_is_read_about_a_bend_is_nearer_to_the_light() -> None:
    x = np.linspace(0, 1, 41)
    light, slope = bent(x)
    made = records_of(x, light, slope)
    before = error_between(made, made["radius"].astype(np.float32))
    after = error_between(made, agreeing(made, 0.5 * TOLERANCE))
    assert before > 0.05
    assert after < 0.5 * before


def test_the_order_of_records_does_not_matter() -> None:
    rng = np.random.default_rng(5)
    x = rng.uniform(0, 1, 200)
    made = records_of(x, rng.uniform(0.5, 1, 200), rng.normal(size=200))
    made["position"] = rng.uniform(0, 1, (200, 3)).astype(np.float32) * np.float32([1, 1, 0.01])
    found = agreeing(made, TOLERANCE)
    assert (found < made["radius"]).any()
    shuffled = rng.permutation(200)
    other = {name: column[shuffled] for name, column in made.items() if name != "number"}
    np.testing.assert_array_equal(agreeing({**other, "number": made["number"]}, TOLERANCE), found[shuffled])


def test_of_no_records() -> None:
    assert agreeing(records_of(np.zeros(0), np.zeros(0), np.zeros(0)), TOLERANCE).shape == (0,)
