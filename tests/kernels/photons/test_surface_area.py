"""Measured surface area: how many points a surface gets, where they lie, and what the correction does to a gather."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.photons import photon_map
from wdpm.kernels.photons.surface_points import points_of, reflect_gathered

Array = NDArray[np.float64]


def corrected(points: Array, clearance: Array, radius: Array, at: Array, point_area: float, r_max: float) -> Array:
    """reflect_gathered on an irradiance of 1 and an albedo of 1, scaled by pi, at places of the plane z = 0."""
    up = np.array([0.0, 0.0, 1.0])
    normals, facing = (np.broadcast_to(up, places.shape) for places in (points, at))
    return corrected_on(points, normals, clearance, radius, at, facing, point_area, r_max)


def corrected_on(
    points: Array,
    normals: Array,
    clearance: Array,
    radius: Array,
    at: Array,
    facing: Array,
    point_area: float,
    r_max: float,
) -> Array:
    """The same on any surface, by the normals of its points and of the places."""
    count = len(at)
    parts = photon_map.WholeParts({"position": points.astype(np.float32), "normal": normals.astype(np.float32)})
    tree = photon_map.build_points(parts)
    one = wp.array(np.ones((count, 3), np.float32), dtype=wp.vec3, device="cpu")
    radiance = wp.empty(count, dtype=wp.vec3, device="cpu")
    inputs = [
        tree,
        wp.array(at.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.array(facing.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.array(clearance.astype(np.float32), dtype=wp.float32, device="cpu"),
        one,
        one,
        wp.array(radius.astype(np.float32), dtype=wp.float32, device="cpu"),
        point_area,
        r_max,
        np.pi,
        0,
        radiance,
    ]
    wp.launch(reflect_gathered, count, inputs=inputs, device="cpu")
    return radiance.numpy().astype(np.float64)[:, 0]


def lattice(step: float, low: tuple[float, float], high: tuple[float, float]) -> Array:
    """Centres of squares of side `step` that fill a rectangle of the plane z = 0."""
    x, y = (np.arange(a + step / 2, b, step) for a, b in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
    return np.column_stack([grid, np.zeros(len(grid))])


STEP = 0.02


def test_a_gather_within_its_triangle_is_left_alone() -> None:
    at = np.random.default_rng(0).uniform(-0.3, 0.3, (50, 3)) * [1, 1, 0]
    points = lattice(STEP, (-1, -1), (1, 1))
    out = corrected(points, np.full(50, 0.3), np.full(50, 0.29), at, 2 * STEP**2, 0.3)
    np.testing.assert_array_equal(out, 1.0)  # not a bit, even with points that tell of another area


def test_a_full_plane_is_counted_as_a_full_disc() -> None:
    at = np.random.default_rng(1).uniform(-0.3, 0.3, (200, 3)) * [1, 1, 0]
    points = lattice(STEP, (-1, -1), (1, 1))
    out = corrected(points, np.zeros(200), np.full(200, 0.2), at, STEP**2, 0.3)
    # A circle of radius R = 10 steps holds pi R² = 314 points but for about R^(2/3) of them (Gauss's circle problem):
    # 2 %.
    np.testing.assert_allclose(out, 1.0, rtol=0.04)
    assert abs(out.mean() - 1.0) < 0.005


def test_edges_corners_and_strips_are_measured() -> None:
    """What is off the surface is not divided by: twice the irradiance at an edge, four times at a corner."""
    half = lattice(STEP, (0, -1), (1, 1))
    edge = np.column_stack([np.zeros(80), np.random.default_rng(2).uniform(-0.5, 0.5, 80), np.zeros(80)])
    out = corrected(half, np.zeros(80), np.full(80, 0.2), edge, STEP**2, 0.3)
    assert abs(out.mean() / 2.0 - 1.0) < 0.02
    quarter = lattice(STEP, (0, 0), (1, 1))
    out = corrected(quarter, np.zeros(1), np.full(1, 0.2), np.zeros((1, 3)), STEP**2, 0.3)
    np.testing.assert_allclose(out, 4.0, rtol=0.05)
    strip = lattice(STEP, (-0.04, -1), (0.04, 1))
    place = np.column_stack([np.zeros(40), np.random.default_rng(3).uniform(-0.5, 0.5, 40), np.zeros(40)])
    out = corrected(strip, np.zeros(40), np.full(40, 0.2), place, STEP**2, 0.3)
    # A strip of width w through a disc of radius r: area 2 (x sqrt(r² - x²) + r² asin(x / r)), x = w / 2.
    x, r = 0.04, 0.2
    area = 2 * (x * np.sqrt(r * r - x * x) + r * r * np.arcsin(x / r))
    assert abs(out.mean() / (np.pi * r * r / area) - 1.0) < 0.03


def test_a_tiny_gather_is_measured_by_a_larger_disc() -> None:
    """Where points are sparse, the share of surface is that of a disc with some 16 points, or of r_max."""
    half = lattice(STEP, (0, -1), (1, 1))
    edge = np.column_stack([np.full(200, 1e-4), np.random.default_rng(4).uniform(-0.5, 0.5, 200), np.zeros(200)])
    out = corrected(half, np.zeros(200), np.full(200, 1e-3), edge, STEP**2, 0.3)
    # 8 points on average, within one or two of them; the mean of one over a count of 8 +- 1 is 1.6 % high.
    assert abs(out.mean() / 2.0 - 1.0) < 0.06
    lonely = corrected(np.array([[5.0, 5, 0]]), np.zeros(1), np.full(1, 1e-3), np.zeros((1, 3)), 1e-6, 2e-3)
    assert 0 < lonely[0] < 100  # no point at all counts as one


@pytest.mark.parametrize("points", [8, 16, 64])
def test_a_count_that_varies_is_not_too_bright(points: int) -> None:
    """One point anywhere in each square of a lattice: so many in a disc, by chance a few more or less.

    One over their count is 4 % too much on average with 8 of them, 1 % with 16, and 0.1 % with 64.
    """
    rng = np.random.default_rng(6)
    squares = lattice(STEP, (-2.5, -2.5), (2.5, 2.5))
    strewn = squares + rng.uniform(-STEP / 2, STEP / 2, squares.shape) * [1, 1, 0]
    at = rng.uniform(-2.3, 2.3, (20_000, 3)) * [1, 1, 0]
    radius = np.sqrt(points / np.pi) * STEP
    # The disc of LEAST_POINTS is larger than one of 8; it is r_max that holds it down.
    out = corrected(strewn, np.zeros(len(at)), np.full(len(at), radius), at, STEP**2, radius)
    assert abs(out.mean() - 1.0) < {8: 0.012, 16: 0.004, 64: 0.001}[points]


def test_triangles_get_points_by_their_area() -> None:
    """All up to any place of the curve have as many as their area says, and each one's is rounded up or down."""
    rng = np.random.default_rng(5)
    area = rng.exponential(0.3, 20_000)
    sums = np.cumsum(area)
    for point_set in range(4):
        first, counts = points_of(area, sums - area, 1.0, point_set)
        assert np.all((counts == np.floor(area)) | (counts == np.floor(area) + 1))
        assert np.abs(np.cumsum(counts) - sums).max() <= 1.0 + 1e-9
        assert np.array_equal(first[1:], (first + counts)[:-1])
        assert not counts[area < 1e-9].any()


@pytest.mark.parametrize("larger", [1.0, 1.5, 2.0])
def test_a_bent_surface_is_measured_alike_by_a_larger_disc(larger: float) -> None:
    """On the outside of a cylinder, in gathers that a larger disc is counted for: the share that passes them."""
    radius, r = 1.0, 0.1 / larger
    rng = np.random.default_rng(7)
    point_area = np.pi * (larger * r) ** 2 / 16.0  # LEAST_POINTS
    count = round(2 * np.pi * radius * 8.0 / point_area)
    turn, along = (np.arange(count) * 0.5698402909980532) % 1.0, (np.arange(count) + 0.5) / count
    bent = on_cylinder(radius, 2 * np.pi * turn, 8.0 * along - 4.0)
    at = on_cylinder(radius, rng.uniform(0, 2 * np.pi, 20_000), rng.uniform(-3.0, 3.0, 20_000))
    out = corrected_on(*bent, np.zeros(len(at[0])), np.full(len(at[0]), r), *at, point_area, 1.0)
    # Of a place at x across and z along, x² + z² + 63 (x² / 2)² <= r², to fourth order: height is x² / 2.
    x = np.linspace(-r, r, 20_001)
    wide = np.sqrt(np.maximum(r**2 - x**2 - 63.0 * (x**2 / 2.0) ** 2, 0.0))
    share = 2.0 * np.trapezoid(wide, x) / (np.pi * r**2)
    assert share < 0.99
    assert abs(out.mean() * share - 1.0) < 0.01


def on_cylinder(radius: float, turn: Array, along: Array) -> tuple[Array, Array]:
    """Places on the outside of a cylinder along z, and their normals."""
    normal = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))])
    return normal * radius + np.column_stack([np.zeros((len(turn), 2)), along]), normal
