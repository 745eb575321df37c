"""Points on meshes as they are made: evenly over the surface, however it is cut into triangles."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.surface_points import COUNT_VARIANCE, points_of, spread
from wdpm.kernels.rays import cells
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.surface_order import along_curve

Array = NDArray[np.float64]

RADIUS = 0.1
POINTS = 16
POINT_AREA = np.pi * RADIUS**2 / POINTS

WALLS = [(1, 1), (16, 16), (200, 200), (100, 400), (300, 1), (1, 412), (300, 4), (248, 1)]
"""Squares across and up. When a sequence of triangles' numbers told how many points each has, it kept pace with rows of
200: the mean was up to 6.5 times too large. When the same told where they lie, strips had them at the same heights:
areas were off by 100 to 300 % of what they are."""


@pytest.mark.parametrize("in_pairs", [True, False], ids=["pairs", "halves"])
@pytest.mark.parametrize(("across", "up"), WALLS)
def test_a_wall_is_measured_alike_however_it_is_cut(across: int, up: int, in_pairs: bool) -> None:
    corners = _wall(across, up, in_pairs)
    points = _points(corners)
    assert abs(len(points) * POINT_AREA - 1.0) < 0.1
    at = np.random.default_rng(3).uniform(RADIUS, 1.0 - RADIUS, (400, 2))
    found = (((points[None, :, :2] - at[:, None]) ** 2).sum(axis=2) < RADIUS**2).sum(axis=1)
    share = POINTS / np.maximum(found, 1)  # as gathers are corrected, but for the variance of the count
    # Of points that fall anywhere at random the mean is 1.07, and the deviation 0.3.
    assert abs(share.mean() - 1.0) < 0.05
    assert share.std() < 0.25


def test_unequal_triangles_are_measured_alike() -> None:
    """Of which some are a hundred times as large as their neighbours, and no row is like another."""
    rng = np.random.default_rng(8)
    places = np.concatenate([rng.uniform(size=(30_000, 2)) ** [3, 1], [[0, 0], [0, 1], [1, 0], [1, 1]]])
    flat = places[Delaunay(places).simplices]
    corners = np.concatenate([flat, np.zeros((*flat.shape[:2], 1))], axis=2).astype(np.float32)
    at = rng.uniform(RADIUS, 1.0 - RADIUS, (2000, 2))
    found = (((_points(corners)[None, :, :2] - at[:, None]) ** 2).sum(axis=2) < RADIUS**2).sum(axis=1)
    # The variance of a count is what share_of_disc expects: of points at random it would be POINTS.
    assert ((found - POINTS) ** 2).mean() < COUNT_VARIANCE * np.sqrt(POINTS)


def test_passes_have_points_at_other_places() -> None:
    corners = _wall(16, 16, in_pairs=True)
    sets = [_points(corners, number) for number in range(3)]
    assert all(abs(len(points) * POINT_AREA - 1.0) < 0.01 for points in sets)
    one, two, three = (frozenset(map(tuple, points.tolist())) for points in sets)
    assert not one & two
    assert not two & three


def _wall(across: int, up: int, in_pairs: bool) -> NDArray[np.float32]:
    """A unit square of triangles, column by column: both of a square, or the first of all and then the second."""
    x, y = np.meshgrid(np.linspace(0, 1, across + 1), np.linspace(0, 1, up + 1), indexing="ij")
    grid = np.stack([x, y, np.zeros_like(x)], axis=2)
    a, b, c, d = (part.reshape(-1, 3) for part in (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]))
    halves = np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)
    joined = np.stack(halves, axis=1).reshape(-1, 3, 3) if in_pairs else np.concatenate(halves)
    return joined.astype(np.float32)


def _points(corners: NDArray[np.float32], point_set: int = 0) -> Array:
    count = len(corners)
    surfaces = Surfaces()
    surfaces.count = count
    surfaces.ids = wp.array(np.arange(count), dtype=wp.int32, device="cpu")
    surfaces.corners = wp.array(corners, dtype=wp.vec3, device="cpu")
    surfaces.front = wp.array(np.broadcast_to([0.0, 0.0, 1.0], (count, 3)), dtype=wp.vec3, device="cpu")
    whole = cells.upload(np.zeros(0, np.int32), np.zeros(0, np.float32), 0.0, "cpu")
    rows = np.stack([np.arange(count), np.full(count, -1)], axis=1).astype(np.int32)
    before, _ = along_curve(corners)
    numbers = points_of(triangle_areas(corners), before, POINT_AREA, point_set)
    position, _ = spread(surfaces, whole, 0, rows, *numbers, Launcher("cpu", 1), point_set)
    return position.astype(np.float64)
