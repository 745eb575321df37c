"""Records are smoothed by as much as they may err, and no further."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.kernels.irradiance.record_smoothing import smoothed

Records = dict[str, NDArray[Any]]
NOISE = 0.05


def records(x: NDArray[Any], light: NDArray[Any], slope: NDArray[Any], error: float, radius: float = 0.1) -> Records:
    """On the plane z = 0, at places [N, 2]; the light changes along the first axis, alike in all channels."""
    count = len(x)
    translation = np.zeros((count, 3, 3), np.float32)
    translation[:, :, 0] = slope[:, None]
    return {
        "number": np.arange(count, dtype=np.int64),
        "position": np.column_stack([x, np.zeros(count)]).astype(np.float32),
        "normal": np.tile(np.float32([0, 0, 1]), (count, 1)),
        "irradiance": np.tile(light[:, None], (1, 3)).astype(np.float32),
        "rotation": np.zeros((count, 3, 3), np.float32),
        "translation": translation,
        "grazing": np.zeros(count, np.float32),
        "radius": np.full(count, radius, np.float32),
        "error": np.full(count, error, np.float32),
    }


def places(count: int = 600) -> NDArray[np.float64]:
    return np.random.default_rng(1).random((count, 2))


def inner(x: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray((np.abs(x - 0.5) < 0.3).all(axis=1))


def test_no_records_are_smooth() -> None:
    nothing = smoothed(records(np.zeros((0, 2)), np.zeros(0), np.zeros(0), NOISE))
    assert {name: array.shape for name, array in nothing.items()} == {
        "irradiance": (0, 3),
        "rotation": (0, 3, 3),
        "translation": (0, 3, 3),
    }


def test_one_record_stays_what_it_is() -> None:
    one = records(np.zeros((1, 2)), np.ones(1), np.ones(1), NOISE)
    after = smoothed(one)
    for name in after:
        np.testing.assert_array_equal(after[name], one[name])


def test_noise_averages_out_and_no_light_is_lost() -> None:
    """A third of the noise is left where some dozen records lie within reach; the mean is that of the records."""
    x = places()
    noise = NOISE * np.random.default_rng(2).normal(size=len(x))
    after = smoothed(records(x, 1.0 + noise, 0 * noise, NOISE))["irradiance"][:, 0]
    assert np.std(after[inner(x)]) < 0.5 * NOISE
    assert after.mean() == pytest.approx(1.0 + noise.mean(), abs=0.1 * NOISE)


def test_light_that_bends_stays_bent() -> None:
    """What is a square is what it was: derivatives of both ends tell it exactly. A mean of the values is too bright."""
    x = places()
    light, slope = 1.0 + 4.0 * x[:, 0] ** 2, 8.0 * x[:, 0]
    after = smoothed(records(x, light, slope, NOISE))["irradiance"][:, 0]
    np.testing.assert_allclose(after, light, rtol=1e-5)
    unaware = smoothed(records(x, light, 0 * slope, 10.0))["irradiance"][:, 0]
    assert np.abs(unaware - light)[inner(x)].max() > 0.01


def test_the_edge_of_a_shadow_stays_where_it_is() -> None:
    """Records on both sides of a step differ by more than they may err; those that may err by it blur it."""
    x = places()
    light = np.where(x[:, 0] < 0.5, 1.0, 2.0)
    sure = smoothed(records(x, light, 0 * light, NOISE))["irradiance"][:, 0]
    np.testing.assert_allclose(sure, light, rtol=1e-6)
    unsure = smoothed(records(x, light, 0 * light, 1.0))["irradiance"][:, 0]
    assert np.abs(unsure - light).max() > 0.1


@pytest.mark.parametrize("power", [-70, -50, 50, 70])
def test_lamps_of_any_unit_are_smoothed_alike(power: int) -> None:
    x = places()
    noise = NOISE * np.random.default_rng(2).normal(size=len(x))
    given = records(x, np.where(x[:, 0] < 0.5, 1.0, 2.0) + noise, 0 * noise, NOISE)
    times = np.float32(2.0**power)
    other = {**given, **{name: given[name] * times for name in ("irradiance", "rotation", "translation", "error")}}
    after = smoothed(other)
    for name, expected in smoothed(given).items():
        np.testing.assert_array_equal(after[name], expected * times)


def test_a_record_that_is_sure_by_chance_is_smoothed_as_well() -> None:
    x = places()
    noise = NOISE * np.random.default_rng(3).normal(size=len(x))
    given = records(x, 1.0 + noise, 0 * noise, NOISE)
    sure = inner(x) & (np.arange(len(x)) % 4 == 0)
    given["error"][sure] = 0.0
    after = smoothed(given)["irradiance"][:, 0]
    assert np.std(after[sure]) < 0.5 * np.std(noise[sure])


def test_other_walls_and_far_places_have_no_say() -> None:
    x = np.array([[0.0, 0.0], [0.0, 0.0], [0.21, 0.0]])
    light = np.array([1.0, 1.01, 0.99])
    given = records(x, light, 0 * light, NOISE)
    given["normal"][1] = (1, 0, 0)
    after = smoothed(given)["irradiance"]
    np.testing.assert_allclose(after, given["irradiance"], rtol=1e-6)


def test_it_does_not_matter_which_others_there_are() -> None:
    """Bit for bit, as long as these are out of reach."""
    x = places(200)
    light = 1.0 + NOISE * np.random.default_rng(4).normal(size=len(x))
    given = records(x, light, 0 * light, NOISE)
    left = x[:, 0] < 0.5
    some = smoothed({name: array[left] for name, array in given.items()})
    every = smoothed(given)
    far = x[left][:, 0] < 0.5 - 0.45  # what is within reach of it, and within reach of that
    for name in some:
        np.testing.assert_array_equal(some[name][far], every[name][left][far])


def test_what_one_ray_met_by_chance_is_shared_out_and_not_what_it_says_of_changes() -> None:
    """One record is twice as bright, and says that light changes by as much on its way; it knows that it errs."""
    x = places()
    light = np.ones(len(x))
    chance = int(np.argmin(((x - 0.5) ** 2).sum(axis=1)))
    slope = np.zeros(len(x))
    light[chance], slope[chance] = 2.0, 20.0
    given = records(x, light, slope, NOISE)
    given["error"][chance] = 1.0
    after = smoothed(given)
    found = after["irradiance"][:, 0]
    assert found.max() < 1.3
    assert found.sum() == pytest.approx(light.sum(), abs=0.3)
    assert abs(after["translation"][:, 0, 0]).max() < 5.0
