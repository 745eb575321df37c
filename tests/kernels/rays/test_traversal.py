"""Nearest hits do not depend on the partition, and trees are well formed.

That they are those of testing every triangle, and any hits theirs, tests/fuzz/test_fuzz_traversal.py holds.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
import warp as wp
from fuzz_rays import rays_at
from fuzz_shapes import KINDS, box, triangle_set
from hypothesis import given, settings
from hypothesis import strategies as st
from traversal_rig import F32, Array, assert_same_bits, misses, numbers, occluded, trace, trace_all, tree_of

from wdpm.bench import traversal
from wdpm.kernels.launch import Launcher
from wdpm.kernels.rays import bvh, bvh_build
from wdpm.kernels.rays.build_tree import LEAST_PART
from wdpm.scenes.errors import WdpmError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

examples = settings(max_examples=60, deadline=None, derandomize=True)
seeds = st.integers(0, 2**32 - 1)
kinds = st.sampled_from(sorted(KINDS))


def make_triangles(seed: int, kind: str) -> Array:
    """Up to some 256 triangles about 2 across, corners float32 [T, 3, 3]."""
    rng = np.random.default_rng(seed)
    return triangle_set(rng, (kind,), int(2 ** rng.uniform(0, 8)))


def make_rays(seed: int, triangles: Array) -> tuple[Array, Array]:
    """Origins and directions of rays that traversal finds hard, aimed at triangles."""
    return rays_at(np.random.default_rng(seed), triangles, 256)


@examples
@given(seeds, kinds)
def test_partition_does_not_matter(seed: int, kind: str) -> None:
    """Two trees that share some triangles, visited in either order with the best hit carried along, equal one tree."""
    triangles = make_triangles(seed, kind)
    origin, direction = make_rays(seed, triangles)
    side = np.random.default_rng(seed).integers(0, 3, len(triangles))
    parts = [numbers(triangles)[side != skipped] for skipped in (0, 1)]
    trees = [tree_of(triangles[rows], rows) for rows in parts]
    whole = trace(tree_of(triangles), origin, direction)
    for first, second in (trees, trees[::-1]):
        assert_same_bits(trace(second, origin, direction, trace(first, origin, direction)), whole)


@examples
@given(seeds, kinds)
def test_sign_of_zero_and_length_of_direction(seed: int, kind: str) -> None:
    triangles = make_triangles(seed, kind)
    origin, direction = make_rays(seed, triangles)
    tree = tree_of(triangles)
    hits = trace(tree, origin, direction)
    assert_same_bits(trace(tree, origin, direction + F32(0.0)), hits)  # -0.0 becomes 0.0
    twice = trace(tree, origin, direction * F32(2))
    np.testing.assert_array_equal(twice["prim"], hits["prim"])
    found = hits["prim"] >= 0
    np.testing.assert_array_equal(twice["t"][found] * F32(2), hits["t"][found])


def test_a_line_is_not_hit_from_beside() -> None:
    """Of corners in line with a ray, but off it, all edge functions are in doubt: found by fuzzing (7000001017)."""
    x = np.array([1.0918271e-11, -4.9942880e-12, 1.3889326e-11])
    line = np.stack([x, np.full(3, -4.9207686e-04), np.full(3, -1.6402562e-04)], axis=1).astype(F32)[None]
    origin = np.repeat(line[:, 0], 2, axis=0)
    origin[:, 0] = -4.6601319e-13
    origin[:, 2] = np.nextafter(origin[:, 2], F32([-1.0, 1.0]))
    direction = np.tile(F32([[-2.5596028e-14, 9.9492191e-44, 0.0]]), (2, 1))
    assert (trace(tree_of(line), origin, direction)["prim"] == -1).all()


def test_axis_rays_through_grid_corners_leak_nothing() -> None:
    mesh = box(8).astype(F32)
    corners = np.unique(mesh.reshape(-1, 3), axis=0)
    for axis in range(3):
        for sign in (-1, 1):
            inner = corners[np.abs(corners[:, axis]) < 1].copy()
            direction = np.full_like(inner, -0.0)
            direction[:, axis] = sign
            assert (trace(tree_of(mesh), inner, direction)["prim"] >= 0).all()


def test_coplanar_duplicates_give_the_smaller_id() -> None:
    triangle = np.array([[[0, 0, 1], [1, 0, 1], [0, 1, 1]]], dtype=F32)
    ids = np.array([7, 3, 9], dtype=np.int32)
    hits = trace(tree_of(np.repeat(triangle, 3, axis=0), ids), np.array([[0.2, 0.2, 0]]), np.array([[0.0, 0, 1]]))
    assert (hits["prim"][0], hits["t"][0]) == (3, 1)


def test_a_hundred_thousand_triangles_in_one_place() -> None:
    triangles = np.repeat(np.array([[[0, 0, 1], [1, 0, 1], [0, 1, 1]]], dtype=F32), 100_000, axis=0)
    ids = np.random.default_rng(0).permutation(len(triangles)).astype(np.int32)
    tree = tree_of(triangles, ids)
    hits = trace(
        tree, np.array([[0.2, 0.2, 0], [0.2, 0.2, 2], [2, 2, 0]]), np.array([[0.0, 0, 1], [0, 0, -1], [0, 0, 1]])
    )
    np.testing.assert_array_equal(hits["prim"], [0, 0, -1])
    check_tree(tree, triangles, ids)


def many_triangles(kind: str) -> Array:
    """Some of which the tree is built in parts: evenly spread, nearly all in a corner, or ever smaller."""
    rng = np.random.default_rng(5)
    count = 12 * LEAST_PART
    middle = rng.random((count, 1, 3))
    if kind == "crowded":
        middle[count // 100 :] *= 1e-3
    elif kind == "ever smaller":
        middle *= 2.0 ** -np.linspace(0.0, 30.0, count)[:, None, None]
    return (middle + 1e-4 * middle.max(axis=2, keepdims=True) * rng.normal(size=(count, 3, 3))).astype(F32)


@pytest.mark.parametrize("kind", ["even", "crowded", "ever smaller"])
def test_a_tree_in_parts_is_the_same_on_any_number_of_threads_and_for_any_traversal(kind: str) -> None:
    triangles = many_triangles(kind)
    ids = np.random.default_rng(6).permutation(len(triangles)).astype(np.int32)
    trees = [bvh.build(triangles, ids, 1e-6, run=Launcher("cpu", threads).run_on_host) for threads in (1, 3)]
    for name in ("bounds", "children", "corners", "ids"):
        one, other = (getattr(tree, name).numpy() for tree in trees)
        np.testing.assert_array_equal(one, other, err_msg=name)
    check_tree(trees[0], triangles, ids)
    origin, direction = rays_at(np.random.default_rng(7), triangles, 4096)
    small = [bvh.build(triangles[rows], ids[rows], 1e-6) for rows in np.array_split(numbers(triangles), 16)]
    best = misses(len(origin))
    for tree in small:  # none is built in parts
        best = trace(tree, origin, direction, best)
    assert (best["prim"] >= 0).sum() > 500
    assert_same_bits(trace(trees[0], origin, direction), best)


def check_tree(tree: Any, triangles: Array, ids: Array) -> None:
    """Every triangle is in one leaf, every box in its parent's, and no level is deeper than the stack allows."""
    bounds = tree.bounds.numpy().reshape(-1, 3, 2, 8)
    children, leaf_corners, leaf_ids = tree.children.numpy(), tree.corners.numpy(), tree.ids.numpy()
    inverse = np.empty(ids.max(initial=-1) + 1, dtype=int)
    inverse[ids] = np.arange(len(ids))
    covered = np.zeros(len(ids), dtype=int)
    waiting = [(0, 1, np.full(3, -np.inf), np.full(3, np.inf))]
    visited = 0
    while waiting:
        node, level, low, high = waiting.pop()
        visited += 1
        assert level <= bvh_build.MAX_DEPTH
        for k, code in enumerate(children[node]):
            child_low, child_high = bounds[node, :, 0, k], bounds[node, :, 1, k]
            if child_low[0] > child_high[0]:
                continue
            assert (child_low >= low).all()
            assert (child_high <= high).all()
            if code > 0:
                waiting.append((int(code), level + 1, child_low, child_high))
                continue
            first, size = (-code - 1) // 8, -code - 8 * ((-code - 1) // 8)
            covered[first : first + size] += 1
            corners = leaf_corners[9 * first : 9 * (first + size)].reshape(3, 3, size).transpose(2, 0, 1)
            np.testing.assert_array_equal(corners, triangles[inverse[leaf_ids[first : first + size]]])
            assert (corners - F32(tree.pad) >= child_low).all()
            assert (corners + F32(tree.pad) <= child_high).all()
    assert visited == len(children)
    assert (covered == 1).all()


@examples
@given(seeds, kinds)
def test_tree_is_well_formed(seed: int, kind: str) -> None:
    triangles = make_triangles(seed, kind)
    ids = np.random.default_rng(seed).permutation(1000)[: len(triangles)].astype(np.int32)
    check_tree(tree_of(triangles, ids), triangles, ids)


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 64, 65, 513])
def test_small_trees(count: int) -> None:
    triangles = np.random.default_rng(count).uniform(-1, 1, (count, 3, 3)).astype(F32)
    check_tree(tree_of(triangles), triangles, numbers(triangles))


def test_geometric_series_of_sizes_stays_within_the_stack() -> None:
    """The heuristic would peel off a triangle or two a level, 30 levels deep."""
    rng = np.random.default_rng(0)
    scale = 2.0 ** -rng.uniform(0, 100, (20_000, 1, 1))
    triangles = (scale * (1 + 0.01 * rng.normal(size=(20_000, 3, 3)))).astype(F32)
    tree = tree_of(triangles, pad=0.0)
    check_tree(tree, triangles, numbers(triangles))
    origin = np.zeros((500, 3), dtype=F32)
    direction = triangles[:500].mean(axis=1) / scale[:500, 0].astype(F32)
    assert_same_bits(trace(tree, origin, direction), trace_all(triangles, origin, direction, pad=0.0))


def test_no_triangles() -> None:
    tree = tree_of(np.zeros((0, 3, 3), dtype=F32))
    origin, direction = np.zeros((3, 3)), np.array([[1.0, 0, 0], [0, -1, 0], [1, 1, -0.0]])
    best = misses(3)
    best["t"][1], best["prim"][1], best["u"][1] = 2.5, 11, 0.25
    assert_same_bits(trace(tree, origin, direction, best), best)
    assert not occluded(tree, origin, direction, np.full(3, 1e30)).any()


def test_origin_on_a_triangle_does_not_hit_it() -> None:
    triangle = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], dtype=F32)
    origin = np.array([[0.2, 0.2, 0], [0, 0, 0], [0.5, 0.5, 0]])
    assert (trace(tree_of(triangle, pad=0.0), origin, np.array([[0.3, 0.1, 1.0]] * 3))["prim"] == -1).all()


@pytest.mark.parametrize("direction", [(0, 0, 0), (np.nan, 0, 1), (0, 0, np.nan)])
def test_a_ray_that_goes_nowhere_hits_nothing(direction: tuple[float, float, float]) -> None:
    triangles = make_triangles(0, "anywhere")
    assert trace(tree_of(triangles), np.zeros((1, 3)), np.array([direction]))["prim"][0] == -1


@pytest.mark.parametrize(
    ("positions", "ids", "pad", "message"),
    [
        (np.zeros((2, 3)), np.zeros(2), 0.0, "expected"),
        (np.zeros((2, 3, 3)), np.zeros(3), 0.0, "expected"),
        (np.zeros((1, 3, 3)), np.zeros(1), -1.0, "pad -1.0"),
        (np.full((1, 3, 3), np.nan), np.zeros(1), 0.0, "not finite"),
    ],
)
def test_bad_arguments(positions: Array, ids: Array, pad: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        bvh.build(positions.astype(F32), ids.astype(np.int32), pad)


def test_benchmark_measures_both_kinds_of_rays() -> None:
    pytest.importorskip("embreex")
    rows = traversal.measure(rays=400, seconds=0.0)
    assert [(row.work.split(" in ")[0], row.work.split(", ")[-1]) for row in rows] == [
        ("closest hit", "coherent"),
        ("any hit", "coherent"),
        ("closest hit", "incoherent"),
        ("any hit", "incoherent"),
    ]
    assert all(row.seconds > 0 and row.peer_seconds > 0 for row in rows)


def test_benchmark_without_embreex_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "embreex", None)
    with pytest.raises(WdpmError, match="pip install"):
        traversal.measure(rays=4)
