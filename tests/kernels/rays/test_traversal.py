"""Nearest hits against two oracles, and their independence of the tree, the partition and the order of triangles."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from traversal_rig import F32, MISS, PAD, Array, assert_same_bits, misses, numbers, occluded, trace, trace_all, tree_of

from wdpm.bench import traversal
from wdpm.kernels.rays import bvh, bvh_build
from wdpm.scenes.errors import WdpmError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

examples = settings(max_examples=60, deadline=None, derandomize=True)
seeds = st.integers(0, 2**32 - 1)


def make_triangles(seed: int, kind: str) -> Array:
    """Up to a few hundred triangles about 4 across, corners float32 [T, 3, 3]."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 300))
    if kind == "grid":  # corners on a coarse grid: shared edges, coplanar duplicates, no area, axis-aligned
        triangles = rng.integers(-4, 5, (count, 3, 3)) / 2
        flat = rng.random(count) < 0.5
        triangles[flat, :, rng.integers(0, 3)] = triangles[flat, :1, 0]
    elif kind == "sheet":  # a closed-in height field: every edge is shared
        side = int(rng.integers(1, 12))
        x, y = np.meshgrid(np.arange(side + 1), np.arange(side + 1))
        z = rng.integers(0, 3, x.shape) * rng.choice([0.0, 0.25])
        points = np.stack([x * 4 / side - 2, y * 4 / side - 2, z], axis=-1)[..., rng.permutation(3)]
        triangles = traversal._grid_triangles(points)
    elif kind == "needles":
        tip = rng.uniform(-2, 2, (count, 3))
        thick = 10.0 ** rng.uniform(-9, -2, (count, 1))
        triangles = np.stack(
            [tip, tip + thick * rng.normal(size=(count, 3)), -tip + rng.normal(size=(count, 3))], axis=1
        )
    elif kind == "scales":  # one or two huge ones among tiny ones
        size = 10.0 ** rng.uniform(-7, 0.3, (count, 1, 1))
        triangles = rng.uniform(-1, 1, (count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    else:
        triangles = rng.uniform(-2, 2, (count, 1, 3)) + 0.5 * rng.normal(size=(count, 3, 3))
    return triangles.astype(F32)


def make_rays(seed: int, triangles: Array, count: int = 256) -> tuple[Array, Array]:
    """Rays at corners, edges and inner points, along axes (with -0.0), within planes, from corners, of odd lengths."""
    rng = np.random.default_rng(seed)
    chosen = triangles[rng.integers(0, len(triangles), count)].astype(float)
    weights = rng.dirichlet([1, 1, 1], count)
    on_edge = rng.random(count) < 0.4
    weights[on_edge] = np.array([[0.5, 0.5, 0.0], [1, 0, 0], [0.25, 0, 0.75], [0, 0, 1]])[
        rng.integers(0, 4, on_edge.sum())
    ]
    target = np.einsum("rc,rca->ra", weights, chosen).astype(F32)
    origin = rng.uniform(-3, 3, (count, 3)).astype(F32)
    coarse = rng.random(count) < 0.5
    origin[coarse] = np.round(origin[coarse] * 2) / 2
    start = rng.random(count) < 0.1  # from a corner: t = 0 must not count
    origin[start] = triangles[rng.integers(0, len(triangles), start.sum()), 0]
    direction = target - origin
    along = rng.random(count) < 0.3
    axis = rng.integers(0, 3, along.sum())
    unit = np.full((along.sum(), 3), 0.0, dtype=F32)
    unit[rng.random(unit.shape) < 0.5] = -0.0
    unit[np.arange(len(unit)), axis] = rng.choice([-1, 1], len(unit))
    direction[along] = unit
    through = target[along].copy()
    through[np.arange(len(unit)), axis] = origin[along][np.arange(len(unit)), axis]
    origin[along] = through
    direction[~direction.any(axis=1)] = (0, 0, 1)
    return origin, (direction * rng.choice([1e-3, 1.0, 7.0], (count, 1))).astype(F32)


kinds = st.sampled_from(["grid", "sheet", "needles", "scales", "random"])


@examples
@given(seeds, kinds, st.sampled_from([0.0, PAD]))
def test_equals_testing_every_triangle(seed: int, kind: str, pad: float) -> None:
    """The tree and the float32 test lose nothing, and ties go to the smaller id, whatever the ids are."""
    triangles = make_triangles(seed, kind)
    ids = np.random.default_rng(seed).permutation(1000)[: len(triangles)].astype(np.int32)
    origin, direction = make_rays(seed, triangles)
    hits = trace(tree_of(triangles, ids, pad), origin, direction)
    assert_same_bits(hits, trace_all(triangles, origin, direction, ids, pad))


def oracle_interval(triangles: Array, origin: Array, direction: Array) -> tuple[Array, Array]:
    """In float64 by Cramer's rule: nearest t of what may be a hit, and of what surely is one; inf where there is none.

    A triangle seen from its side, as far as float32 coordinates tell, may be hit anywhere in its depth.
    """
    a, b, c = triangles.astype(float).swapaxes(0, 1)
    e1, e2 = b - a, c - a
    o, d = origin.astype(float)[:, None], direction.astype(float)[:, None]
    normal = np.cross(e1, e2)
    det = -(d * normal).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = o - a
        t = (s * normal).sum(-1) / det
        q = np.cross(s, d)
        u, v = (e2 * q).sum(-1) / det, -(e1 * q).sum(-1) / det
        # Roundings of the oracle, as a share of the triangle.
        length = np.linalg.norm(d, axis=-1)
        reach = np.abs(s).max(-1) + np.abs(e1).max(-1) + np.abs(e2).max(-1)
        edge = np.maximum(np.linalg.norm(e1, axis=-1), np.linalg.norm(e2, axis=-1))
        doubt = 1e-14 * reach * edge * length / np.abs(det) + 1e-12
        least = np.minimum(np.minimum(u, v), 1 - u - v)
        sharp = np.abs(det) > 2.0**-21 * reach * edge * length
        spread = 1e-6 * np.abs(t) + doubt * edge / length
        surely = sharp & (least > doubt) & (t > spread)
        nearest = ((triangles[None] - o[..., None, :]) * d[..., None, :]).sum(-1).min(-1) / length**2 - 1e-5 / length
        maybe = ~sharp | ((least > -doubt) & (t > -spread))
        low = np.where(maybe, np.where(sharp, t - spread, nearest), np.inf).min(axis=1)
        return low, np.where(surely, t + spread, np.inf).min(axis=1)


@examples
@given(seeds, kinds)
def test_agrees_with_float64_oracle(seed: int, kind: str) -> None:
    triangles = make_triangles(seed, kind)
    origin, direction = make_rays(seed, triangles)
    hits = trace(tree_of(triangles), origin, direction)
    low, high = oracle_interval(triangles, origin, direction)
    t = np.where(hits["prim"] >= 0, hits["t"], np.inf)
    assert (t >= low).all()
    assert (t <= high).all()


@examples
@given(seeds, kinds)
def test_barycentrics_give_the_hit_point(seed: int, kind: str) -> None:
    triangles = make_triangles(seed, kind)
    origin, direction = make_rays(seed, triangles)
    hits = trace(tree_of(triangles), origin, direction)
    found = hits["prim"] >= 0
    hits, origin, direction = hits[found], origin[found].astype(float), direction[found]
    assert ((hits["u"] >= 0) & (hits["v"] >= 0) & (hits["u"] + hits["v"] <= 1 + 1e-6)).all()
    a, b, c = triangles[hits["prim"]].astype(float).swapaxes(0, 1)
    point = a + hits["u"][:, None] * (b - a) + hits["v"][:, None] * (c - a)
    error = np.abs(point - (origin + hits["t"][:, None] * direction)).max(axis=1, initial=0)
    # The clamp moves t by at most the error of the slab arithmetic; a needle may be long.
    assert (error < 1e-5 * (1 + np.abs(triangles).max())).all()


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
def test_order_of_triangles_does_not_matter(seed: int, kind: str) -> None:
    triangles = make_triangles(seed, kind)
    origin, direction = make_rays(seed, triangles)
    order = np.random.default_rng(seed).permutation(len(triangles)).astype(np.int32)
    hits = trace(tree_of(triangles), origin, direction)
    assert_same_bits(trace(tree_of(triangles[order], order), origin, direction), hits)


@examples
@given(seeds, kinds)
def test_any_hit_is_closest_hit_before_t_max(seed: int, kind: str) -> None:
    triangles = make_triangles(seed, kind)
    origin, direction = make_rays(seed, triangles)
    tree = tree_of(triangles)
    t = trace(tree, origin, direction)["t"]
    for t_max in (t, np.nextafter(t, F32(np.inf)), t * F32(0.5), np.full_like(t, 1e30), np.full_like(t, np.inf)):
        np.testing.assert_array_equal(occluded(tree, origin, direction, t_max), (t < t_max) & (t < MISS))


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


def box_mesh(side: int) -> Array:
    """A closed box of uneven squares, corners float32 [T, 3, 3]; its squares share all edges."""
    cuts = np.sin(np.linspace(-np.pi / 2, np.pi / 2, side + 1))
    x, y = np.meshgrid(cuts, cuts)
    square = np.stack([x, y], axis=-1)
    faces = [np.insert(square, axis, z, axis=-1) for axis in range(3) for z in (-1.0, 1.0)]
    return np.concatenate([traversal._grid_triangles(face) for face in faces]).astype(F32)


def ball_mesh(side: int) -> Array:
    """The box blown up to a ball and stretched: no plane is axis-aligned. Shared corners are the same floats."""
    corners = box_mesh(side).astype(float)
    corners /= np.linalg.norm(corners, axis=-1, keepdims=True)
    return (corners * [1.0, 0.7, 1.3]).astype(F32)


def cut_up_box() -> Array:
    """A closed box whose walls are cut into squares of different sizes: its edges are full of T-junctions."""
    soup = []
    for axis in range(3):
        for side, count in ((-1.0, 5), (1.0, 8)):
            cuts = np.linspace(-1.0, 1.0, count + axis)
            x, y = np.meshgrid(cuts, cuts)
            soup.append(traversal._grid_triangles(np.insert(np.stack([x, y], axis=-1), axis, side, axis=-1)))
    return np.concatenate(soup).astype(F32)


def test_t_junctions_leak_nothing() -> None:
    """Neighbours with other corners along one line overlap by the error of their edge functions (ON_EDGE)."""
    rng = np.random.default_rng(3)
    count, mesh = 1_000_000, cut_up_box()
    along = rng.integers(0, 3, count)
    target = rng.choice([-1.0, 1.0], (count, 3))
    target[np.arange(count), along] = rng.uniform(-1.0, 1.0, count)
    origin = (np.round(rng.uniform(-0.9, 0.9, (count, 3)) * 64) / 64).astype(F32)
    direction = (target.astype(F32) - origin).astype(F32)
    assert occluded(tree_of(mesh), origin, direction, np.full(count, 1.5)).all()


def test_a_line_is_not_hit_from_beside() -> None:
    """Of corners in line with a ray, but off it, all edge functions are in doubt: found by fuzzing (7000001017)."""
    x = np.array([1.0918271e-11, -4.9942880e-12, 1.3889326e-11])
    line = np.stack([x, np.full(3, -4.9207686e-04), np.full(3, -1.6402562e-04)], axis=1).astype(F32)[None]
    origin = np.repeat(line[:, 0], 2, axis=0)
    origin[:, 0] = -4.6601319e-13
    origin[:, 2] = np.nextafter(origin[:, 2], F32([-1.0, 1.0]))
    direction = np.tile(F32([[-2.5596028e-14, 9.9492191e-44, 0.0]]), (2, 1))
    assert (trace(tree_of(line), origin, direction)["prim"] == -1).all()


@pytest.mark.parametrize("mesh", [box_mesh(8), ball_mesh(16)], ids=["box", "ball"])
@pytest.mark.parametrize("pad", [0.0, PAD])
def test_closed_mesh_leaks_nothing(mesh: Array, pad: float) -> None:
    """A million rays from inside, aimed at corners, along edges and at random."""
    rng = np.random.default_rng(1)
    count = 250_000
    corners = mesh[rng.integers(0, len(mesh), count)]
    share = rng.choice([0.0, 0.5, 0.25, 0.1, 1 / 3], (count, 1)).astype(F32)
    target = corners[:, 0] + share * (corners[:, 1] - corners[:, 0])
    origin = rng.uniform(-0.5, 0.5, (count, 3)).astype(F32)
    origin[::3] = np.round(origin[::3] * 4) / 4
    origin[::7] = 0
    hits = trace(tree_of(mesh, pad=pad), origin, target - origin)
    assert (hits["prim"] >= 0).all()
    np.testing.assert_allclose(hits["t"], 1, atol=2e-5)


def test_axis_rays_through_grid_corners_leak_nothing() -> None:
    mesh = box_mesh(8)
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
    triangles = make_triangles(0, "random")
    assert trace(tree_of(triangles), np.zeros((1, 3)), np.array([direction]))["prim"][0] == -1


def test_far_from_the_origin_of_the_ray() -> None:
    """10,000 extents away, where the pad no longer covers the slab arithmetic."""
    mesh = ball_mesh(8)
    rng = np.random.default_rng(3)
    origin = rng.normal(size=(1000, 3))
    origin = (20_000 * origin / np.linalg.norm(origin, axis=1, keepdims=True)).astype(F32)
    target = mesh[rng.integers(0, len(mesh), len(origin))].mean(axis=1)
    hits = trace(tree_of(mesh), origin, target - origin)
    assert_same_bits(hits, trace_all(mesh, origin, target - origin))
    low, high = oracle_interval(mesh, origin, target - origin)
    t = np.where(hits["prim"] >= 0, hits["t"], np.inf)
    assert (t >= low).all()
    assert (t <= high).all()


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
