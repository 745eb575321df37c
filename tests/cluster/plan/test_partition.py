"""What each cell holds: every triangle that overlaps it, and workers that share the cells evenly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from wdpm.cluster.master.cell_holders import balanced_holders
from wdpm.cluster.plan import partition
from wdpm.cluster.plan.partition import places_to_cut, rows_of_cells
from wdpm.cluster.world import TopTree
from wdpm.kernels.launch import Launcher
from wdpm.kernels.rays.cells import cell_boxes
from wdpm.kernels.rays.overlap import triangles_in_boxes
from wdpm.scenes.flat.arrays import NO_TRIANGLES

Array = NDArray[np.float64]
LATTICE = np.linspace(-1, 1, 9)
LAUNCHER = Launcher("cpu", 1)


def clipped(polygon: Array, low: Array, high: Array) -> Array:
    """What a box leaves of a polygon (Sutherland & Hodgman 1974), in double precision, shape [corners, 3]."""
    for axis in range(3):
        for sign, bound in ((1.0, low[axis]), (-1.0, -high[axis])):
            height = sign * polygon[:, axis] - bound
            kept: list[Array] = []
            for i in range(len(polygon)):
                j = (i + 1) % len(polygon)
                if height[i] >= 0:
                    kept.append(polygon[i])
                if height[i] * height[j] < 0:
                    share = height[i] / (height[i] - height[j])
                    crossing = polygon[i] + share * (polygon[j] - polygon[i])
                    crossing[axis] = sign * bound
                    kept.append(crossing)
            if not kept:
                return np.zeros((0, 3))
            polygon = np.array(kept)
    return polygon


def triangles_of(rng: np.random.Generator, count: int) -> NDArray[np.float32]:
    """Anywhere, on the lattice, needles, large ones, and such in a plane of the lattice."""
    corners = rng.uniform(-1.5, 1.5, (count, 3, 3))
    kind = rng.integers(0, 5, count)
    corners[kind == 1] = rng.choice(LATTICE, (count, 3, 3))[kind == 1]
    corners[kind == 2, 2] = corners[kind == 2, 1] + 1e-5
    corners[kind == 3] *= 20
    corners[kind == 4, :, rng.integers(3)] = rng.choice(LATTICE)
    return corners.astype(np.float32)


def boxes_of(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    one, two = (
        np.where(rng.random((count, 3)) < 0.5, rng.choice(LATTICE, (count, 3)), rng.uniform(-1, 1, (count, 3)))
        for _ in range(2)
    )
    return np.minimum(one, two), np.maximum(one, two)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_overlap_is_what_clipping_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = triangles_of(rng, 30)
    low, high = boxes_of(rng, 12)
    found = triangles_in_boxes(corners, low, high, LAUNCHER)
    # Clipping and the separating axes are rounded: at coordinates up to 30 by about 30 * 30 * 2^-50 along an axis
    # that is a product of edges. Where the answer hangs on less than `slack`, either is right.
    slack = 1e-9
    for i, triangle in enumerate(corners.astype(np.float64)):
        for box in range(12):
            if found[i, box]:
                assert len(clipped(triangle, low[box] - slack, high[box] + slack)), (i, box)
            elif np.all(high[box] - low[box] > 2 * slack):
                assert not len(clipped(triangle, low[box] + slack, high[box] - slack)), (i, box)


def test_touching_counts_as_overlap() -> None:
    low, high = np.zeros((1, 3)), np.ones((1, 3))
    touching = np.array(
        [
            [[1, 0.2, 0.2], [1, 0.8, 0.2], [1, 0.2, 0.8]],  # in a face
            [[1, 1, 1], [2, 1, 1], [1, 2, 1]],  # a vertex at a corner
            [[1, 1, -5], [1, 1, 5], [3, 3, 0]],  # an edge along an edge
            [[-5, -5, 0.5], [5, -5, 0.5], [0, 9, 0.5]],  # larger than the box, right through it
            [[0.5, 0.5, 0.5], [0.6, 0.5, 0.5], [0.5, 0.6, 0.5]],  # within
        ],
        np.float32,
    )
    assert triangles_in_boxes(touching, low, high, LAUNCHER).all()
    apart = np.array([[[1.5, 1, 0], [1, 1.5, 0], [1.5, 1.5, 0]], [[3, 0, -1], [0, 3, -1], [0, 3, 3]]], np.float32)
    # The first one's box overlaps the unit cube's corner region, the second passes it on a slanted plane: both miss it.
    assert not triangles_in_boxes(apart, low, high, LAUNCHER).any()


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), levels=st.integers(0, 4))
def test_the_cell_of_every_point_of_a_triangle_holds_it(seed: int, levels: int) -> None:
    rng = np.random.default_rng(seed)
    inner = 2**levels - 1
    tree = TopTree(rng.integers(0, 3, inner).astype(np.int32), rng.choice(LATTICE, inner).astype(np.float32))
    corners = triangles_of(rng, 60)
    extent = float(np.abs(corners).max())
    rows = rows_of_cells(corners, tree, extent, LAUNCHER)
    assert len(rows) == tree.cells
    holds = held_by(rows)
    assert holds.any(axis=1).all()
    weights = rng.dirichlet([0.4, 0.4, 0.4], (60, 50))  # many of them on edges and at corners
    points = np.einsum("tpc,tca->tpa", weights, corners.astype(np.float64)).astype(np.float32)
    low, high = cell_boxes(tree.axis, tree.split)
    inside = np.all((points[:, :, None] >= low) & (points[:, :, None] < high), axis=3)
    assert np.all(holds[:, None] | ~inside)


def held_by(rows: list[NDArray[np.intp]]) -> NDArray[np.bool_]:
    """Whether each of 60 triangles is held by each cell, shape [60, cells]."""
    holds = np.zeros((60, len(rows)), bool)
    for cell, held in enumerate(rows):
        assert np.all(np.diff(held) > 0)
        holds[held, cell] = True
    return holds


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), levels=st.integers(1, 4), band=st.floats(0.0, 2.0))
def test_a_cell_holds_what_lies_in_the_band_about_it(seed: int, levels: int, band: float) -> None:
    rng = np.random.default_rng(seed)
    inner = 2**levels - 1
    tree = TopTree(rng.integers(0, 3, inner).astype(np.int32), rng.choice(LATTICE, inner).astype(np.float32))
    corners = triangles_of(rng, 60)
    extent = float(np.abs(corners).max())
    holds = held_by(rows_of_cells(corners, tree, extent, LAUNCHER, band))
    weights = rng.dirichlet([0.4, 0.4, 0.4], (60, 50))
    points = np.einsum("tpc,tca->tpa", weights, corners.astype(np.float64))[:, :, None]
    low, high = (box.astype(np.float64) for box in cell_boxes(tree.axis, tree.split))
    off = np.maximum(np.maximum(low - points, points - high), 0.0)
    assert np.all(holds[:, None] | (np.sqrt((off**2).sum(axis=3)) >= band))
    narrow = held_by(rows_of_cells(corners, tree, extent, LAUNCHER))
    assert np.all(holds | ~narrow)


def test_a_small_triangle_is_held_by_few_cells() -> None:
    # Boxes alone would not do: of a long diagonal triangle most cells are held only by its bounding box.
    axis = np.array([0, 1, 1, 0, 0, 0, 0], np.int32)
    split = np.array([0, 0, 0, -0.5, -0.5, 0.5, 0.5], np.float32)
    corners = np.array([[[-1, -1, 0], [1, 1, 0], [1, 1, 0.01]]], np.float32)
    held = [len(rows) for rows in rows_of_cells(corners, TopTree(axis, split), 1.0, LAUNCHER)]
    assert sum(held) == 6  # four pieces of the diagonal, and two cells that it touches at the origin
    low, high = cell_boxes(axis, split)
    assert np.all((corners.min(axis=1) < high) & (corners.max(axis=1) > low), axis=1).sum() == 8


@settings(max_examples=200, deadline=None, derandomize=True)
@given(
    burdens=st.lists(st.floats(0, 1e6), min_size=1, max_size=64),
    workers=st.integers(1, 64),
)
def test_every_worker_gets_a_cell_and_none_too_much(burdens: list[float], workers: int) -> None:
    workers = min(workers, len(burdens))
    holders = balanced_holders(np.array(burdens), workers)
    assert sorted(set(holders)) == list(range(workers))
    assert len(holders) == len(burdens)
    load = np.bincount(holders, burdens, minlength=workers)
    # Graham 1969, list scheduling: the fullest got its last cell when it had no more than the mean of the others.
    bound = np.sum(burdens) / workers + (1 - 1 / workers) * max(burdens)
    assert (
        load.max() <= bound * (1 + 1e-12) + np.finfo(float).tiny
    )  # a mean of numbers that are nearly 0 may round to 0


@pytest.mark.parametrize(("workers", "heaviest"), [(1, 10.0), (2, 5.0), (3, 4.0), (4, 4.0)])
def test_heavy_cells_are_dealt_first(workers: int, heaviest: float) -> None:
    holders = balanced_holders(np.array([1.0, 4.0, 1.0, 1.0, 3.0]), workers)
    assert np.bincount(holders, [1.0, 4.0, 1.0, 1.0, 3.0]).max() == heaviest


def test_cells_without_any_burden_are_dealt_too() -> None:
    holders = balanced_holders(np.zeros(8), 8)
    assert sorted(holders) == list(range(8))


def test_very_many_triangles_are_looked_at_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    corners = triangles_of(np.random.default_rng(4), 300)
    tree = TopTree(np.array([0, 1, 2], np.int32), np.array([0.1, -0.2, 0.3], np.float32))
    whole = rows_of_cells(corners, tree, 30.0, LAUNCHER)
    monkeypatch.setattr(partition, "AT_ONCE", 7)
    for rows, expected in zip(rows_of_cells(corners, tree, 30.0, LAUNCHER), whole, strict=True):
        assert rows.tolist() == expected.tolist()
    monkeypatch.setattr(partition, "MOST_WEIGHED", 100)
    triangles = NO_TRIANGLES.with_arrays({"positions": corners})
    assert np.array_equal(places_to_cut(triangles), corners[::3])
