"""Interpolation between irradiance records against a plain reckoning, and what it must not depend on."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from wdpm.kernels.irradiance.cache import CAPACITY, interpolate
from wdpm.kernels.irradiance.record_clamp import clamped
from wdpm.kernels.irradiance.record_tree import build
from wdpm.scenes.errors import WdpmError

Array = NDArray[np.float64]
Records = dict[str, NDArray[np.float32]]
UP = np.array([0.0, 0.0, 1.0])


def unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def records(seed: int, count: int, size: float = 0.1, bent: float = 0.1) -> Records:
    """Records on a bumpy plane, some in one place, with radii over two decades."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(0, 1, (count, 3)) * [1, 1, 0.01]
    position[count // 2 : count // 2 + count // 10] = 0.5
    out = {
        "number": rng.permutation(10 * count)[:count] + (1 << 33),
        "position": position,
        "normal": unit(UP + bent * rng.normal(size=(count, 3))),
        "radius": size * 10.0 ** rng.uniform(-1, 1, count),
        "irradiance": rng.uniform(0, 1, (count, 3)) ** 4,
        "rotation": rng.normal(size=(count, 3, 3)),
        "translation": rng.normal(size=(count, 3, 3)),
        "grazing": rng.uniform(-0.05, 0.5, count),
    }
    return {name: value if name == "number" else value.astype(np.float32) for name, value in out.items()}


def queries(seed: int, count: int, bent: float = 0.1) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    rng = np.random.default_rng(seed + 1000)
    position = rng.uniform(-0.1, 1.1, (count, 3)) * [1, 1, 0.01]
    return position.astype(np.float32), unit(UP + bent * rng.normal(size=(count, 3))).astype(np.float32)


def read(made: Records, position: Array, normal: Array) -> tuple[NDArray[np.float32], ...]:
    """Irradiance, weight and count."""
    irradiance, _, weight, count = read_all(made, position, normal)
    return irradiance, weight, count


def read_all(made: Records, position: Array, normal: Array) -> tuple[NDArray[np.float32], ...]:
    """Irradiance, how much it grazes, weight and count."""
    out = [wp.empty(len(position), dtype=t, device="cpu") for t in (wp.vec3, wp.float32, wp.float32, wp.int32)]
    at = [wp.array(np.ascontiguousarray(v, np.float32), dtype=wp.vec3, device="cpu") for v in (position, normal)]
    wp.launch(interpolate, len(position), inputs=[build(made), *at, 0, *out], device="cpu")
    return tuple(o.numpy() for o in out)


def reaches(made: Records, position: Array, normal: Array) -> Array:
    """t of the file's formula, in double, shape [queries, records]."""
    d = position[:, None].astype(np.float64) - made["position"][None]
    n, m = normal[:, None].astype(np.float64), made["normal"][None].astype(np.float64)
    height = np.sum(d * (n + m), axis=2) / 2
    turn = np.sum((n - m) ** 2, axis=2) / 2 / (1 - math.cos(math.radians(10)))
    return 1 - (np.sum(d * d, axis=2) + 63 * height**2) / made["radius"].astype(np.float64) ** 2 - turn


def expected(made: Records, position: Array, normal: Array) -> tuple[Array, Array]:
    """Irradiance and weight by the file's formula, in double."""
    t = np.maximum(reaches(made, position, normal), 0.0)
    if t.shape[1] > CAPACITY:
        t[t < np.sort(t, axis=1)[:, -CAPACITY, None]] = 0.0
    d = position[:, None].astype(np.float64) - made["position"][None]
    turn = normal[:, None].astype(np.float64) - made["normal"][None]
    value = made["irradiance"] + np.einsum("jab,ijb->ija", made["rotation"], turn)
    value += np.einsum("jab,ijb->ija", made["translation"], d)
    w = t**2
    weight = w.sum(axis=1)
    shares = np.divide(w, weight[:, None], out=np.zeros_like(w), where=weight[:, None] > 0)
    tangents = np.einsum("ij,ija->ia", shares, np.maximum(value, 0.0))
    plane = shares @ made["irradiance"].astype(np.float64)
    for name, way in (("rotation", turn), ("translation", d)):
        slope = np.einsum("ij,jab->iab", shares, made[name].astype(np.float64))
        plane += np.einsum("iab,ib->ia", slope, np.einsum("ij,ijb->ib", shares, way))
    return (tangents + np.maximum(plane, 0.0)) / 2, weight


def test_how_much_light_grazes_is_the_weighted_mean_of_records() -> None:
    made = records(3, 60, 0.1)
    position, normal = queries(3, 200)
    _, grazing, weight, _ = read_all(made, position, normal)
    w = np.maximum(reaches(made, position, normal), 0.0) ** 2
    there = w.sum(axis=1) > 1e-3
    assert there.sum() > 50
    np.testing.assert_allclose(
        grazing[there], (w[there] @ made["grazing"]) / w[there].sum(axis=1), rtol=1e-4, atol=1e-5
    )
    assert (grazing[weight == 0] == 0).all()


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.sampled_from([0, 1, 8, 9, 64, 65, 300]), st.sampled_from([0.01, 0.1]))
def test_interpolation_is_the_formula(seed: int, count: int, size: float) -> None:
    made = records(seed, count, size)
    position, normal = queries(seed, 200)
    irradiance, weight, found = read(made, position, normal)
    true, true_weight = expected(made, position, normal)
    np.testing.assert_allclose(weight, true_weight, rtol=1e-3, atol=1e-4)
    clear = true_weight > 1e-2
    np.testing.assert_allclose(irradiance[clear], true[clear], rtol=2e-3, atol=2e-4)
    t = reaches(made, position, normal)
    assert (found >= np.minimum((t > 1e-5).sum(axis=1), CAPACITY)).all()
    assert (found <= (t > -1e-5).sum(axis=1)).all()
    assert (irradiance >= 0).all()
    assert (irradiance[found == 0] == 0).all()
    assert ((weight > 0) == (found > 0)).all()


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.integers(1, 400), st.sampled_from([0.02, 0.2]))
def test_only_the_records_that_reach_count(seed: int, count: int, size: float) -> None:
    """Not their order, nor what other records there are: the same bits from any partition that holds those."""
    made = records(seed, count, size)
    position, normal = queries(seed, 60)
    before = read(made, position, normal)
    shuffled = np.random.default_rng(seed).permutation(count)
    for after, value in zip(read({k: v[shuffled] for k, v in made.items()}, position, normal), before, strict=True):
        np.testing.assert_array_equal(after, value)
    half = position[:, 0] < 0.5
    near = (reaches(made, position[half], normal[half]) > -1e-3).any(axis=0)
    rest = read({k: v[near] for k, v in made.items()}, position[half], normal[half])
    for after, value in zip(rest, before, strict=True):
        np.testing.assert_array_equal(after, value[half])


def test_light_that_bends_is_neither_too_bright_nor_too_dark() -> None:
    """Between records that know value and slope of a parabola, where the tangents of all lie on one side of it."""
    at = np.stack(np.meshgrid(np.arange(21.0), np.arange(21.0)), axis=-1).reshape(-1, 2) / 20
    at += np.random.default_rng(2).uniform(-0.02, 0.02, at.shape)
    count, bend = len(at), -0.4
    slope = np.zeros((count, 3, 3))
    slope[:, :, 0] = 2 * bend * at[:, :1]
    light = np.tile(1 + bend * at[:, :1] ** 2, (1, 3))
    position = np.column_stack([at, np.zeros(count)])
    made = {"number": np.arange(count), "position": position, "normal": np.tile(UP, (count, 1))}
    made |= {"radius": np.full(count, 0.12), "irradiance": light, "rotation": 0 * slope, "translation": slope}
    made["grazing"] = np.zeros(count)
    made = {name: value if name == "number" else value.astype(np.float32) for name, value in made.items()}
    places = np.random.default_rng(5).uniform(0.15, 0.85, (1000, 2))
    irradiance, _, _ = read(made, np.column_stack([places, np.zeros(1000)]), np.tile(UP, (1000, 1)))
    error = irradiance[:, 0] - (1 + bend * places[:, 0] ** 2)
    of_tangents = -bend * 0.12**2 / 8  # by the mean square of the way along x, with these weights
    assert abs(error.mean()) < 0.05 * of_tangents
    assert np.abs(error).max() < 0.5 * of_tangents


def test_more_records_than_are_kept() -> None:
    made = records(3, 500, size=3.0, bent=0.0)
    made["position"][:, 2] = 0
    made["radius"] = np.maximum(made["radius"], 3.0)
    position, normal = queries(3, 50, bent=0.0)
    irradiance, weight, found = read(made, position * [1, 1, 0], normal)
    assert (found == CAPACITY).all()
    true, true_weight = expected(made, position * [1, 1, 0], normal)
    np.testing.assert_allclose(weight, true_weight, rtol=1e-5)
    np.testing.assert_allclose(irradiance, true, rtol=1e-3, atol=1e-4)


def test_many_more_records_than_are_kept_cost_little_more() -> None:
    """Where noisy records seem to disagree hundreds may reach a place. Most of them are passed over at once."""
    position, normal = queries(3, 2000, bent=0.0)

    def seconds(count: int) -> float:
        made = records(3, count, size=3.0, bent=0.0)
        made["position"][:, 2] = 0
        made["radius"] = np.maximum(made["radius"], 3.0)
        began = time.process_time()
        _, _, found = read(made, position * [1, 1, 0], normal)
        assert (found == CAPACITY).all()
        return time.process_time() - began

    few, many = (min(seconds(int(times * CAPACITY)) for _ in range(5)) for times in (1, 12))
    assert many < 10.0 * few, "with a search for the lightest at each of them: 80 times"


def test_of_equal_records_the_first_are_kept() -> None:
    made = {name: np.repeat(value[:1], 100, axis=0) for name, value in records(9, 1).items()}
    made["number"] = np.random.default_rng(9).permutation(100)
    made["irradiance"] = np.repeat(made["number"][:, None], 3, axis=1).astype(np.float32)
    irradiance, _, _ = read(made, made["position"][:1], made["normal"][:1])
    np.testing.assert_allclose(irradiance, (CAPACITY - 1) / 2)


def test_a_record_is_itself_where_it_lies() -> None:
    made = records(4, 1)
    irradiance, weight, found = read(made, made["position"], made["normal"])
    np.testing.assert_allclose(irradiance, made["irradiance"], rtol=1e-6)
    assert (weight[0], found[0]) == (1.0, 1)


def test_records_fade_without_a_step() -> None:
    """Across a support's end neither value nor slope jumps: squares of t, so weights of 4 (1 - d / R)² near it."""
    made = {k: v[:1] for k, v in records(5, 1, bent=0.0).items()} | {"radius": np.float32([1.0])}
    away = np.linspace(0.9, 1.1, 201)
    position = made["position"] + away[:, None] * np.array([[1.0, 0.0, 0.0]])
    _, weight, _ = read(made, position, np.tile(UP, (201, 1)))
    np.testing.assert_allclose(weight, np.maximum(1 - away**2, 0) ** 2, atol=1e-5)


def test_what_faces_away_or_lies_off_the_plane_is_left_out() -> None:
    one = {"number": np.array([7]), "position": np.zeros((1, 3)), "normal": UP[None], "radius": np.ones(1)}
    one |= {"irradiance": np.ones((1, 3)), "rotation": np.zeros((1, 3, 3)), "translation": np.zeros((1, 3, 3))}
    one["grazing"] = np.zeros(1)
    places = np.array([[0.1, 0, 0], [0.1, 0, 0], [0.1, 0, 0], [0, 0, 0.13], [0, 0, -0.13], [0, 0, 0.1]])
    normals = unit(np.array([[0, 0, 1.0], [0, 0, -1], [0.2, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, 1]]))
    np.testing.assert_array_equal(read(one, places, normals)[2], [1, 0, 0, 0, 0, 1])


def test_curved_surfaces_are_not_off_their_own_plane() -> None:
    """On a sphere the way between two points is square to the mean of their normals."""
    rng = np.random.default_rng(6)
    normal = unit(UP + 0.05 * rng.normal(size=(30, 3)))
    made = records(6, 1) | {"position": UP[None], "normal": UP[None], "radius": np.ones(1)}
    _, weight, _ = read(made, normal, normal)
    d2 = np.sum((normal - UP) ** 2, axis=1)
    t = 1 - d2 - d2 / 2 / (1 - math.cos(math.radians(10)))
    np.testing.assert_allclose(weight, np.maximum(t, 0) ** 2, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("irradiance", np.nan, "irradiance of record 5 is"),
        ("radius", 0.0, "radius of record 5 is 0.0, expected > 0"),
        ("number", 4, "record 4 comes twice"),
        ("normal", None, r"normal has shape \(9, 3\), expected \(10, 3\)"),
    ],
)
def test_bad_records_are_errors(name: str, value: float | None, message: str) -> None:
    made = records(8, 10) | {"number": np.arange(10)}
    if value is None:
        made[name] = made[name][:-1]
    else:
        made[name][5] = value
    with pytest.raises(WdpmError, match=message):
        build(made)


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.integers(1, 700))
def test_leaves_hold_every_record_once(seed: int, count: int) -> None:
    np.testing.assert_array_equal(np.sort(build(records(seed, count)).rank.numpy()[:count]), np.arange(count))


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.integers(0, 500), st.sampled_from([0.003, 0.05, 2.0]))
def test_neighbours_clamp_radii(seed: int, count: int, size: float) -> None:
    made = records(seed, count, size)
    x, r = made["position"].astype(np.float64), made["radius"].astype(np.float64)
    out = clamped(made["position"], made["radius"])
    way = np.sqrt(((x[:, None] - x[None]) ** 2).sum(axis=2))
    np.testing.assert_allclose(out, (way + r[None]).min(axis=1, initial=np.inf), rtol=1e-6)
    shuffled = np.random.default_rng(seed).permutation(count)
    np.testing.assert_array_equal(clamped(made["position"][shuffled], made["radius"][shuffled]), out[shuffled])
    assert (out[:, None] <= (out[None] + way) * (1 + 1e-6)).all()
