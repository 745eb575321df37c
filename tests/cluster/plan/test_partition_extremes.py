"""Triangles that end a float before a plane between two cells, and hits that round across it."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.cluster.plan.partition import rows_of_cells
from wdpm.cluster.world import TopTree
from wdpm.kernels.launch import Launcher

COUNT = 20_000


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_cell_of_a_rounded_hit_holds_its_triangle(axis: int) -> None:
    """Weights of a hit on an edge add up to a float more than 1, so the hit lies a rounding beyond the edge."""
    rng = np.random.default_rng(axis)
    plane = np.float32(0.01)
    corners = rng.uniform(-1, 1, (COUNT, 3, 3)).astype(np.float32)
    corners[:, 0, axis] = rng.uniform(-1, -0.5, COUNT)
    corners[:, 1:, axis] = np.nextafter(plane, np.float32(-1))  # an edge beside the plane, in the left cell
    tree = TopTree(np.array([axis], np.int32), np.array([plane], np.float32))
    held = rows_of_cells(corners, tree, 1.0, Launcher("cpu", 1))
    holds = np.zeros((COUNT, 2), bool)
    for cell, rows in enumerate(held):
        holds[rows, cell] = True
    # As kernels.materials.surface.position_at does: in double, rounded once.
    u = rng.random(COUNT).astype(np.float32)
    v = np.nextafter((1.0 - u.astype(np.float64)).astype(np.float32), np.float32(2))
    b, c = u.astype(np.float64)[:, None], v.astype(np.float64)[:, None]
    wide = corners.astype(np.float64)
    points = (wide[:, 0] * (1.0 - b - c) + wide[:, 1] * b + wide[:, 2] * c).astype(np.float32)
    owner = (points[:, axis] >= plane).astype(int)
    assert owner.sum() > COUNT / 4  # many do lie beyond
    assert holds[np.arange(COUNT), owner].all()
