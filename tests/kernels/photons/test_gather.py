"""Gathers do not depend on photons out of reach nor on launches, and are the closed forms of even light.

That they are those of all photons sorted, bit for bit, tests/fuzz/test_fuzz_gather.py holds.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import warp as wp
from awkward_places import AXES, COUNTS, F32, KINDS, SEEDS, Array, make_ids, make_positions, make_queries, unit
from gather_rig import Photons, Queries, gather_all
from hypothesis import given, settings
from hypothesis import strategies as st

from wdpm.bench import gather as bench_gather
from wdpm.kernels.constants import (
    EXACT_SUM_BITS,
    FLATTENING,
)
from wdpm.kernels.maths import exact_sum
from wdpm.kernels.photons import gather, photon_map
from wdpm.kernels.photons.gather_settings import check_settings
from wdpm.scenes.errors import SettingsError, WdpmError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

examples = settings(max_examples=60, deadline=None, derandomize=True)


def exact(terms: Array) -> float:
    """The exact sum of exact_sum.py, by Python's integers and fractions."""
    e = math.frexp(float(np.abs(terms).max(initial=0)))[1]
    e = max(e, -126)
    quantum = Fraction(2) ** (e - EXACT_SUM_BITS)
    return float(sum(round(Fraction(float(term)) / quantum) for term in terms) * quantum)


def make_case(seed: int, kind: str, count: int, query_count: int = 40) -> tuple[Photons, Queries]:
    rng = np.random.default_rng(seed)
    position = make_positions(rng, kind, count)
    normal = AXES[rng.choice([0, 1, 2, 2, 2, 5], count)]
    direction = unit(rng.standard_normal((count, 3)) + normal)
    flux = (rng.random((count, 3)) * 10.0 ** rng.integers(-8, 8, (count, 1))).astype(F32)
    ids = make_ids(rng, count)
    x = make_queries(rng, kind, position, query_count)
    n = AXES[rng.choice([2, 2, 5, 1], query_count)]
    tilted = unit(n + 0.3 * rng.standard_normal((query_count, 3)))
    shading = np.where(rng.random((query_count, 1)) < 0.5, n, tilted)
    return Photons(position, flux, normal, direction, ids), Queries(x, n, shading.astype(F32))


NEIGHBOURS = st.sampled_from([1, 2, 3, 8, 50, 200, gather.MAX_K])


@examples
@given(SEEDS, KINDS, st.integers(1, 3000), NEIGHBOURS, st.sampled_from([0.05, 0.2, 0.5]), st.floats(0, 1))
def test_photons_out_of_reach_do_not_matter(
    seed: int, kind: str, count: int, k: int, r_max: float, share: float
) -> None:
    """A slave has the photons within r_max of its queries, as owned ones or ghosts, and any number of others."""
    photons, queries = make_case(seed, kind, count)
    cell = queries.position[:, 0] < 0.5 + (4096 if kind == "far off" else 0)
    for inside in (cell, ~cell):
        mine = Queries(*(column[inside] for column in vars(queries).values()))
        gap = np.linalg.norm(photons.position[:, None].astype(float) - mine.position[None], axis=-1)
        reach = gap.min(axis=1, initial=np.inf) <= r_max * 1.0001
        partition = photons[reach | (np.random.default_rng(seed).random(count) < share)]
        gather_all(partition.build(), mine, k, r_max).assert_same_bits(gather_all(photons.build(), mine, k, r_max))


@examples
@given(SEEDS, KINDS, COUNTS, NEIGHBOURS, st.integers(1, 50), st.integers(1, 6))
def test_runs_and_chunks_do_not_matter(seed: int, kind: str, count: int, k: int, run: int, chunks: int) -> None:
    photons, queries = make_case(seed, kind, count)
    built = photons.build()
    gather_all(built, queries, k, 0.3, run, chunks).assert_same_bits(gather_all(built, queries, k, 0.3, run=1))


def test_photons_of_another_surface_do_not_count() -> None:
    """Both sides of a wall, and the two walls of a corner: no other takes a place in k."""
    up, down, side = AXES[2], AXES[5], AXES[0]
    normal = np.array([up, down, side, up])
    position = np.zeros((4, 3), F32)
    position[3] = [0.5, 0, 0]
    photons = Photons(position, np.ones((4, 3), F32), normal, normal, np.arange(4))
    queries = Queries(np.zeros((1, 3), F32), up[None], up[None])
    result = gather_all(photons.build(), queries, 1, 1.0)
    assert result.count[0] == 1
    assert result.radius[0] == 0.5  # that of the second photon that counts, the fourth
    np.testing.assert_allclose(result.irradiance[0], 1 / (math.pi * 0.25), rtol=1e-6)


@pytest.mark.parametrize("lean", [0.0, 0.1])
def test_even_light_is_as_bright_where_the_surface_bends(lean: float) -> None:
    """Photons of even light on facets that turn by 25 degrees to either side: irradiance is that of a plane.

    With those left out that came from below the plane of the query it would be too dark by (1 - cos 25°) / 2 = 4.7 %.
    """
    rng, count = np.random.default_rng(3), 100_000
    angle = np.deg2rad(25.0) * np.where(np.arange(count) % 2, 1.0, -1.0)
    across = np.stack([np.cos(angle), np.zeros(count), -np.sin(angle)], axis=1)
    normal = np.stack([np.sin(angle), np.zeros(count), np.cos(angle)], axis=1)
    sine2, turn = rng.random((count, 1)), 2 * np.pi * rng.random((count, 1))
    local = np.sqrt(sine2) * (np.cos(turn) * across + np.sin(turn) * AXES[1]) + np.sqrt(1 - sine2) * normal
    position = np.concatenate([rng.random((count, 2)) - 0.5, np.zeros((count, 1))], axis=1)
    photons = Photons(*(c.astype(F32) for c in (position, np.ones((count, 3)), normal, local)), np.arange(count))
    leaning = unit(AXES[2] + lean * AXES[1])
    spots = np.stack([*np.meshgrid(*[np.linspace(-0.4, 0.4, 20)] * 2), np.zeros((20, 20))], axis=-1).reshape(-1, 3)
    queries = Queries(spots.astype(F32), *(np.tile(n, (len(spots), 1)).astype(F32) for n in (AXES[2], leaning)))
    found = gather_all(photons.build(), queries, 500, 0.1)
    assert found.irradiance.mean() == pytest.approx(count, rel=0.01)


def test_photons_off_the_tangent_plane_count_as_further_away() -> None:
    up = AXES[2]
    position = np.array([[0, 0, 0.25], [0.5, 0, 0]], F32)
    photons = Photons(position, np.eye(2, 3, dtype=F32), np.array([up, up]), np.array([up, up]), np.arange(2))
    queries = Queries(np.zeros((1, 3), F32), up[None], up[None])
    result = gather_all(photons.build(), queries, 1, 2.0)
    assert result.radius[0] == 0.25 * FLATTENING
    assert result.irradiance[0, 0] == 0
    assert result.irradiance[0, 1] > 0


def test_estimate_is_unbiased() -> None:
    """Mean over 40 x 40 discs that do not touch, of a uniform plane, k = 10.

    An estimate k / area with a gamma-distributed area of shape k + 1 has relative variance 1 / (k - 1), so the mean of
    1600 has a standard error of 1 / sqrt(9 * 1600) = 0.83 %; 4 of them are 3.3 %. The textbook's estimate is off by
    k / (k - 1): 11 %.
    """
    rng = np.random.default_rng(11)
    count, k, side = 400_000, 10, 40
    position = np.zeros((count, 3), F32)
    position[:, :2] = rng.random((count, 2))
    up = np.broadcast_to(AXES[2], (count, 3))
    photons = Photons(position, np.full((count, 3), 1 / count, F32), up, up, np.arange(count))
    grid = (np.arange(side, dtype=F32) + F32(0.5)) / side
    x = np.stack([*np.meshgrid(grid, grid), np.zeros((side, side), F32)], axis=-1).reshape(-1, 3)
    result = gather_all(photons.build(), Queries(x, up[: side**2], up[: side**2]), k, 1.0)
    assert (result.count == k).all()
    assert result.radius.max() < 0.5 / side
    assert abs(result.irradiance.mean() - 1) < 4 / math.sqrt((k - 1) * side**2)


def test_a_large_map_holds_every_photon_once() -> None:
    """Every photon of a tree of several levels finds itself: k = 1 at its own position, with its own flux."""
    for count in (1, 8, 9, 70, 130, 520, 1000, 5000, 40_000):
        rng = np.random.default_rng(count)
        position = rng.random((count, 3)).astype(F32)
        up = np.broadcast_to(AXES[2], (count, 3))
        flux = np.repeat(np.arange(1, count + 1, dtype=F32)[:, None], 3, axis=1)
        photons = Photons(position, flux, up, up, np.arange(count))
        result = gather_all(photons.build(), Queries(position, up, up), 1, 4.0)
        area = math.pi * result.radius.astype(float) ** 2
        np.testing.assert_allclose(result.irradiance[:, 0] * area, flux[:, 0], rtol=1e-6)


def test_maps_split_over_threads_are_the_same() -> None:
    def launch(kernel: Any, count: int, inputs: list[Any], outputs: list[Any]) -> None:
        for offset in reversed(range(0, count, 7)):
            wp.launch(kernel, dim=min(7, count - offset), inputs=[*inputs, offset, *outputs], device="cpu")

    photons, _ = make_case(3, "volume", 3000)
    whole, split = photons.build(), photon_map.build(**vars(photons), launch=launch)
    for name in ("nodes", "leaves", "flux", "rank"):
        np.testing.assert_array_equal(getattr(whole, name).numpy(), getattr(split, name).numpy())


def test_bench_compares_gathers_and_builds() -> None:
    rows = bench_gather.measure(photon_count=500, k=5, resolution=8, rounds=1)
    assert [row.work for row in rows] == [
        "5 nearest of 500 photons, coherent",
        "5 nearest of 500 photons, incoherent",
        "map of 500 photons",
    ]
    assert all(row.seconds > 0 and row.ratio == row.peer_seconds / row.seconds for row in rows)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"flux": np.full((3, 3), np.nan)}, "photon 0 has flux .*nan.*, expected finite"),
        ({"position": np.full((3, 3), np.inf)}, "photon 0 has position .*inf.*, expected finite"),
        ({"position": np.full((3, 3), 1e20)}, "a coordinate is 1e"),
        ({"normal": np.zeros((2, 3))}, r"normal has shape \(2, 3\), expected \(3, 3\)"),
        ({"id": np.array([7, 5, 7])}, "photon id 7 comes twice"),
        ({"id": np.zeros((3, 1), int)}, r"id has shape \(3, 1\), expected \[N\]"),
    ],
)
def test_bad_photons_are_errors(change: dict[str, Array], message: str) -> None:
    good = {name: np.ones((3, 3), F32) for name in ("position", "flux", "normal", "direction")}
    with pytest.raises(WdpmError, match=message):
        photon_map.build(**{**good, "id": np.arange(3), **change})


@pytest.mark.parametrize(
    ("k", "r_max"), [(0, 1.0), (gather.MAX_K + 1, 1.0), (5, 0.0), (5, -1.0), (5, math.nan), (5, math.inf)]
)
def test_bad_settings_are_errors(k: int, r_max: float) -> None:
    with pytest.raises(SettingsError, match="expected"):
        check_settings(k, r_max)


@wp.kernel
def _sum_kernel(
    terms: wp.array(dtype=wp.float32), quanta_out: wp.array(dtype=wp.int64), sum_out: wp.array(dtype=wp.float64)
) -> None:
    largest = wp.int32(0)
    for i in range(terms.shape[0]):
        largest = wp.max(largest, exact_sum.magnitude_bits(terms[i]))
    e = exact_sum.exponent(largest)
    total = wp.int64(0)
    for i in range(terms.shape[0]):
        total += exact_sum.quantise(terms[i], e)
    quanta_out[0] = total
    sum_out[0] = exact_sum.dequantise(total, e)


def exact_sum_of(terms: Array) -> tuple[int, float]:
    quanta = wp.zeros(1, dtype=wp.int64, device="cpu")
    total = wp.zeros(1, dtype=wp.float64, device="cpu")
    wp.launch(_sum_kernel, dim=1, inputs=[wp.array(terms, dtype=wp.float32, device="cpu"), quanta, total], device="cpu")
    return int(quanta.numpy()[0]), float(total.numpy()[0])


TERMS = st.lists(st.floats(width=32, allow_nan=False, allow_infinity=False), max_size=60)


@examples
@given(TERMS, st.randoms(use_true_random=False))
def test_exact_sum_has_no_order(terms: list[float], random: Any) -> None:
    shuffled = list(terms)
    random.shuffle(shuffled)
    assert exact_sum_of(np.array(terms, F32)) == exact_sum_of(np.array(shuffled, F32))


@examples
@given(TERMS)
def test_exact_sum_is_within_its_bound(terms: list[float]) -> None:
    """And equals that of Python's fractions."""
    column = np.array(terms, F32)
    total = exact_sum_of(column)[1]
    assert total == exact(column)
    largest = Fraction(float(np.abs(column).max(initial=0)))
    error = abs(Fraction(total) - sum(Fraction(float(term)) for term in column))
    assert error <= len(terms) * max(largest * Fraction(2) ** -40, Fraction(2) ** -167)
