"""Irradiance read at the nearest of some photons, in Poisson processes of known density: no bias, dense or sparse."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.irradiance import at_photons
from wdpm.kernels.photons import photon_map
from wdpm.kernels.photons.gather_at_photons import gather_at_photons

ERRORS = 5.0
RADIUS = 1.0
REACH = 0.4
SHARE = 0.25


def read_on_a_plane(
    density: float, k: int, side: float, seed: int, *, reach: float = REACH, least: float = 0.0
) -> tuple[float, int]:
    """Mean of what places on a plane read, for photons of flux 1, and how many of the places found something.

    Args:
        density: photons a unit of area.
        side: of the square of places; photons reach further, so that none misses any.
        least: radius within which all photons are used.
    """
    rng = np.random.default_rng(seed)
    whole = side + 4 * RADIUS
    count = rng.poisson(density * whole**2)
    position = np.column_stack([rng.uniform(-2 * RADIUS, side + 2 * RADIUS, (count, 2)), np.zeros(count)])
    up = np.broadcast_to([0.0, 0.0, 1.0], (count, 3)).astype(np.float32)
    ids = np.arange(count)
    tree = photon_map.build(position, np.ones((count, 3)), up, up, ids)
    rows = np.flatnonzero(at_photons.chosen(ids, SHARE))
    irradiance, radius = wp.empty(len(rows), dtype=wp.vec3), wp.empty(len(rows), dtype=wp.float32)
    sites = [wp.array(rows, dtype=wp.int32), *(wp.array(a[rows], dtype=wp.vec3) for a in (position, up))]
    search = [k, RADIUS, least, SHARE, reach, 0, 1]
    wp.launch(
        gather_at_photons,
        len(rows),
        inputs=[tree, *sites, *search],
        outputs=[irradiance, radius, wp.empty(0, dtype=wp.float32)],
    )
    room = np.full(len(rows), reach)
    points = at_photons.build(position[rows], irradiance.numpy(), room, up[rows], radius.numpy(), room, ids[rows])

    queries = 1 << 14
    x = wp.array(np.column_stack([rng.uniform(0, side, (queries, 2)), np.zeros(queries)]), dtype=wp.vec3)
    n = wp.array(np.broadcast_to([0.0, 0.0, 1.0], (queries, 3)), dtype=wp.vec3)
    outputs = [wp.empty(queries, dtype=t) for t in (wp.vec3, wp.float32, wp.float32, wp.bool)]
    wp.launch(at_photons.read_irradiance, queries, inputs=[points, x, n, reach, 0], outputs=outputs)
    found = outputs[3].numpy()
    return float(outputs[0].numpy()[found, 0].sum()), int(found.sum())


@pytest.mark.parametrize(
    ("within", "k", "side"),
    [(1.5, 100, 60.0), (6.0, 100, 40.0), (25.0, 100, 20.0), (100.0, 500, 12.0), (400.0, 50, 8.0), (60.0, 20, 12.0)],
)
def test_what_places_read_is_the_density(within: float, k: int, side: float) -> None:
    """From 1.5 to 400 photons within the radius; the last two find k before, the others never.

    With the photon at the site in the sum, or without, one of the six would be off by 2 to 60 %.
    """
    density = within / math.pi
    assert_unbiased(np.array([read_on_a_plane(density, k, side, seed) for seed in range(24)]), density)


@pytest.mark.parametrize("within", [10.0, 20.0, 30.0, 100.0, 600.0])
def test_all_within_the_least_radius_tell_the_density(within: float) -> None:
    """Of which 20 are looked for: fewer than these, about as many, and more than MAX_K."""
    least = 0.5
    density = within / (math.pi * least**2)
    side = 12.0 if within < 100 else 3.0
    assert_unbiased(np.array([read_on_a_plane(density, 20, side, seed, least=least) for seed in range(24)]), density)


def assert_unbiased(runs: NDArray[np.float64], density: float) -> None:
    """Sums of what places read, and how many they are, of each run."""
    means = runs[:, 0] / runs[:, 1]
    mean = runs[:, 0].sum() / runs[:, 1].sum()
    error = means.std(ddof=1) / math.sqrt(len(means))
    assert error < 0.02 * density
    assert abs(mean - density) < ERRORS * error


def test_gathers_tell_how_much_light_grazes() -> None:
    """Photons that come from one cosine each; as many, of other directions, lie too far away."""
    rng, count = np.random.default_rng(9), 40
    cosine = rng.uniform(0.05, 1.0, 2 * count)
    flux = rng.uniform(0.1, 2.0, (2 * count, 3))
    position = np.column_stack([rng.uniform(-0.2, 0.2, (2 * count, 2)), np.zeros(2 * count)])
    position[count:, 0] += 3.0
    sine, turn = np.sqrt(1.0 - cosine**2), rng.uniform(0.0, 2.0 * np.pi, 2 * count)
    direction = np.column_stack([sine * np.cos(turn), sine * np.sin(turn), cosine])
    up = np.broadcast_to([0.0, 0.0, 1.0], (2 * count, 3)).astype(np.float32)
    power, weight = flux[:count].sum(axis=1), (1.0 - cosine[:count]) ** 5
    expected = (power @ weight) / power.sum() - 1.0 / 21.0
    at = [wp.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0]], dtype=wp.vec3), wp.array(up[:2], dtype=wp.vec3)]
    none = wp.full(2, -1, dtype=wp.int32)
    told = []
    for order in (np.arange(2 * count), rng.permutation(2 * count)):
        photons = (a[order] for a in (position, flux, up, direction))
        tree = photon_map.build(*photons, np.arange(2 * count)[order])
        out = [wp.empty(2, dtype=t) for t in (wp.vec3, wp.float32, wp.float32)]
        search = [100, RADIUS, 0.0, SHARE, REACH, 0, 1]
        wp.launch(gather_at_photons, 2, inputs=[tree, none, *at, *search], outputs=out)
        told.append(out[2].numpy())
    assert told[0].tobytes() == told[1].tobytes()
    assert told[0][0] == pytest.approx(expected, rel=1e-5)
    assert told[0][1] == 0.0
