"""What cells hold in outline: all of it lies in the boxes, and these leave most of a room empty."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.cluster.plan.partition import outlines_of, rows_of_cells
from wdpm.cluster.world import Outlines, TopTree
from wdpm.kernels.launch import Launcher
from wdpm.kernels.rays import outline_build
from wdpm.kernels.rays.cells import cell_boxes
from wdpm.kernels.rays.outline_build import NO_ITEMS, STRIPS, build_outlines, plane_of
from wdpm.scenes.builtin.cornell_box import cornell_box
from wdpm.scenes.builtin.forest import forest
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.flat.reach import instance_boxes

TREE = TopTree(np.array([0, 1, 2], np.int32), np.array([0.1, -0.2, 0.3], np.float32))


def outlines(flat: FlatScene, tree: TopTree = TREE) -> Outlines:
    rows = rows_of_cells(flat.triangles.positions, tree, flat.extent, Launcher("cpu", 1))
    instances = [np.arange(len(flat.triangles.instances))] * tree.cells
    return outlines_of(flat.triangles, tree, rows, instances, flat.extent)


def lie_in_boxes(known: Outlines, points: NDArray[np.float64], tree: TopTree = TREE) -> NDArray[np.bool_]:
    """Whether each point lies in a box of the cell that it is in, shape [N]."""
    low, high = cell_boxes(tree.axis, tree.split)
    found = np.zeros(len(points), bool)
    for cell in range(tree.cells):
        own = np.all((points >= low[cell]) & (points < high[cell]), axis=1)
        boxes = slice(known.first[cell], known.first[cell + 1])
        inside = (points[own, None] >= known.low[boxes]) & (points[own, None] <= known.high[boxes])
        found[own] = inside.all(axis=2).any(axis=1)
    return found


@pytest.mark.parametrize(
    "sizes", [{}, {"MOST_BOXES": 3}, {"MANY": 2, "LATTICE": 2, "MOST_LARGE": 3, "AT_ONCE": 5}, {"STRIPS": 3}]
)
def test_all_points_of_triangles_lie_in_boxes(sizes: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    for name, size in sizes.items():
        monkeypatch.setattr(outline_build, name, size)
    flat, rng = flatten(cornell_box((8, 8))), np.random.default_rng(1)
    corners = flat.triangles.positions[rng.integers(0, len(flat.triangles), 4000)].astype(np.float64)
    points = np.einsum("rc,rca->ra", rng.dirichlet([1, 1, 1], len(corners)), corners)
    near = outlines(flat)
    grown = Outlines(**(vars(near) | {"low": near.low - np.float32(1e-6), "high": near.high + np.float32(1e-6)}))
    assert lie_in_boxes(grown, points).all()


def test_boxes_of_instances_are_in_the_outline() -> None:
    flat = flatten(forest(50))
    low, high = instance_boxes(flat.triangles.instances)
    assert len(low) > 0
    rng = np.random.default_rng(2)
    points = low + rng.random(low.shape) * (high - low)
    assert lie_in_boxes(outlines(flat), points).all()


def test_most_of_a_room_is_empty() -> None:
    flat = flatten(cornell_box((8, 8)))
    points = np.random.default_rng(3).uniform(-0.9, 0.9, (4000, 3)) * np.abs(flat.triangles.positions).max(axis=(0, 1))
    assert lie_in_boxes(outlines(flat), points).mean() < 0.3


def test_one_cell_needs_no_outline() -> None:
    assert not len(outlines(flatten(cornell_box((8, 8))), TopTree(np.zeros(0, np.int32), np.zeros(0, np.float32))))


def test_walls_and_lamps_have_planes() -> None:
    known = outlines(flatten(cornell_box((8, 8))))
    assert (known.plane >= 0).mean() > 0.5
    np.testing.assert_allclose(np.linalg.norm(known.normal, axis=1), 1.0)


SQUARE = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], np.float32)


def boxes_of(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    """Sides of the boxes of a cell that holds all, shape [boxes, 3]."""
    whole = np.full((1, 3), -3.0, np.float32), np.full((1, 3), 3.0, np.float32)
    none = np.full(len(corners), -1, np.int32)
    found = build_outlines(corners, none, whole, [np.arange(len(corners))], [NO_ITEMS], 3.0)
    assert (found["plane"] >= 0).all()
    sides: NDArray[np.float64] = found["high"].astype(np.float64) - found["low"]
    return sides


def test_a_wall_is_one_box_and_a_face_that_stands_askew_is_covered_by_strips() -> None:
    np.testing.assert_array_equal(boxes_of(SQUARE), [[1, 1, 0]])
    turned = np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]])
    sides = boxes_of((SQUARE @ turned).astype(np.float32))
    assert len(sides) == STRIPS
    assert 1.0 < sides[:, :2].prod(axis=1).sum() < 1.15, "its box has 1.96"
    other = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    far = np.stack([other, other + np.float32([1.5, 1.5, 0])])
    sides = boxes_of(far)
    assert len(sides) == 2 * STRIPS, "two triangles of a plane, far from each other"
    assert 1.0 < sides[:, :2].prod(axis=1).sum() < 1.2


def test_upright_faces_need_no_strips() -> None:
    """In the box of such a face its plane holds nothing else."""
    upright = np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]])
    assert len(boxes_of((SQUARE @ upright).astype(np.float32))) <= 2


def test_a_plane_is_that_of_its_triangles() -> None:
    found = plane_of(SQUARE, np.array([0, 1]), 1.0)
    assert found is not None
    normal, slab = found
    np.testing.assert_array_equal(np.abs(normal), [0, 0, 1])
    assert slab[0] < 0 < slab[1] < 1e-8


@pytest.mark.parametrize(
    ("corners", "rows"),
    [
        (SQUARE + np.array([[[0, 0, 0]] * 3, [[0, 0, 1]] * 3], np.float32), [0, 1]),  # two planes
        (SQUARE, [0, -1]),  # an instance is with it
        (np.array([[[0, 0, 0], [1, 0, 0], [0.5, 0.01, 0]]], np.float32), [0]),  # a needle
        (np.zeros((1, 3, 3), np.float32), [0]),  # nothing
    ],
)
def test_what_lies_in_no_plane_or_is_badly_shaped_has_none(corners: NDArray[np.float32], rows: list[int]) -> None:
    assert plane_of(corners, np.array(rows), 1.0) is None
