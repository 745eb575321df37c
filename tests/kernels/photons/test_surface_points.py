"""Points on meshes as they are made: evenly over the surface, however it is cut into triangles."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.surface_points import point_counts, spread
from wdpm.kernels.rays import cells
from wdpm.kernels.rays.cell_triangles import Surfaces

Array = NDArray[np.float64]

RADIUS = 0.1
POINTS = 16
POINT_AREA = np.pi * RADIUS**2 / POINTS

WALLS = [(1, 1), (16, 16), (300, 1), (1, 412), (300, 4), (248, 1)]
"""Squares across and up. Strips had points at the same heights only when one sequence told how many a triangle has and
where: measured areas were off by 100 to 300 % of what they are."""


@pytest.mark.parametrize("in_pairs", [True, False], ids=["pairs", "halves"])
@pytest.mark.parametrize(("across", "up"), WALLS)
def test_a_wall_is_measured_alike_however_it_is_cut(across: int, up: int, in_pairs: bool) -> None:
    corners = _wall(across, up, in_pairs)
    points = _points(corners, first=7001)
    assert abs(len(points) * POINT_AREA - 1.0) < 0.1
    at = np.random.default_rng(3).uniform(RADIUS, 1.0 - RADIUS, (400, 2))
    found = (((points[None, :, :2] - at[:, None]) ** 2).sum(axis=2) < RADIUS**2).sum(axis=1)
    share = POINTS / np.maximum(found, 1)  # as gathers are corrected
    # Of points that fall anywhere at random the mean is 1.07, and the deviation 0.3.
    assert abs(share.mean() - 1.0) < 0.2
    assert share.std() < 0.6


def _wall(across: int, up: int, in_pairs: bool) -> NDArray[np.float32]:
    """A unit square of triangles, column by column: both of a square, or the first of all and then the second."""
    x, y = np.meshgrid(np.linspace(0, 1, across + 1), np.linspace(0, 1, up + 1), indexing="ij")
    grid = np.stack([x, y, np.zeros_like(x)], axis=2)
    a, b, c, d = (part.reshape(-1, 3) for part in (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]))
    halves = np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)
    joined = np.stack(halves, axis=1).reshape(-1, 3, 3) if in_pairs else np.concatenate(halves)
    return joined.astype(np.float32)


def _points(corners: NDArray[np.float32], first: int) -> Array:
    """On triangles that are numbered from `first` on."""
    count = len(corners)
    ids = np.arange(first, first + count, dtype=np.int32)
    surfaces = Surfaces()
    surfaces.count = count
    surfaces.ids = wp.array(ids, dtype=wp.int32, device="cpu")
    surfaces.corners = wp.array(corners, dtype=wp.vec3, device="cpu")
    surfaces.front = wp.array(np.broadcast_to([0.0, 0.0, 1.0], (count, 3)), dtype=wp.vec3, device="cpu")
    whole = cells.upload(np.zeros(0, np.int32), np.zeros(0, np.float32), 0.0, "cpu")
    edges = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).astype(np.float64) / 2.0
    rows = np.stack([np.arange(count), np.full(count, -1)], axis=1).astype(np.int32)
    counts = point_counts(area, ids, POINT_AREA)
    position, _ = spread(surfaces, whole, 0, rows, ids, counts, Launcher("cpu", 1))
    return position.astype(np.float64)
