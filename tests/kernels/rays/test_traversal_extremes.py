"""Trees where float32 runs out of digits or range, against testing every triangle: what the margins are there for."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from traversal_rig import F32, Array, assert_same_bits, occluded, trace, trace_all, tree_of, vectors

from wdpm.kernels.rays.triangle import make_ray

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

RAYS = 4096


def rays_at(triangles: Array, rng: np.random.Generator, distance: float, spread: float) -> tuple[Array, Array]:
    """Rays from places about `distance` away, past points of triangles by `spread` at most; not of length 1."""
    chosen = triangles[rng.integers(0, len(triangles), RAYS)].astype(np.float64)
    weights = rng.dirichlet((0.3, 0.3, 0.3), RAYS)  # many near corners and edges
    target = (chosen * weights[:, :, None]).sum(axis=1) + spread * rng.uniform(-1, 1, (RAYS, 3))
    away = rng.normal(size=(RAYS, 3))
    origin = (target + distance * away / np.linalg.norm(away, axis=1, keepdims=True)).astype(F32)
    return origin, (target - origin).astype(F32)


def assert_the_tree_loses_nothing(triangles: Array, origin: Array, direction: Array, pad: float) -> None:
    tree = tree_of(triangles, pad=pad)
    plain = trace_all(triangles, origin, direction, pad=pad)
    assert_same_bits(trace(tree, origin, direction), plain)
    far = np.full(len(origin), 3.0e38)
    np.testing.assert_array_equal(occluded(tree, origin, direction, far), plain["prim"] >= 0)
    assert (plain["prim"] >= 0).sum() > RAYS / 20  # it was about hits


@pytest.mark.parametrize("size", [1e-18, 1e-15, 1e-12, 1e-6, 1e6, 1e12, 1e15, 1e18])
def test_any_unit_of_length(size: float) -> None:
    """Products of three lengths leave float32's range on both sides."""
    rng = np.random.default_rng(1)
    triangles = (size * rng.uniform(-1, 1, (300, 3, 3))).astype(F32)
    for distance in (0.5, 2.0):
        origin, direction = rays_at(triangles, rng, size * distance, 0.0)
        assert_the_tree_loses_nothing(triangles, origin, direction, size * 2.0**-18)


@pytest.mark.parametrize("size", [1e-12, 1e-16, 1e-20, 1e-24])
@pytest.mark.parametrize("distance", [1e-4, 1e-2])
def test_specks(size: float, distance: float) -> None:
    """Triangles so small that doubles hardly tell whether a ray meets them; boxes are far larger than they are."""
    rng = np.random.default_rng(2)
    triangles = (size * rng.normal(size=(200, 3, 3))).astype(F32)
    for spread in (0.0, size, 1e-7, 1e-6):
        origin, direction = rays_at(triangles, rng, distance, spread)
        tree = tree_of(triangles, pad=1e-6)
        plain = trace_all(triangles, origin, direction, pad=1e-6)
        assert_same_bits(trace(tree, origin, direction), plain)


def test_copies_in_one_plane_without_any_pad() -> None:
    """Every box of the tree begins and ends where the hit lies: nodes as far as the best hit are visited, too."""
    rng = np.random.default_rng(3)
    triangle = np.array([[-1, -1, 0.3], [1, -1, 0.3], [0, 1, 0.3]], F32)
    triangles = np.repeat(triangle[None], 500, axis=0)
    ids = rng.permutation(len(triangles)).astype(np.int32)
    origin = np.column_stack([rng.uniform(-0.3, 0.3, (RAYS, 2)), np.full(RAYS, -1.0)]).astype(F32)
    direction = np.tile(np.array([0, 0, 1], F32), (RAYS, 1))
    hits = trace(tree_of(triangles, ids, pad=0.0), origin, direction)
    assert (hits["prim"] == 0).all()


def test_areas_beyond_float32_are_split_by_numbers() -> None:
    """An area of infinity tells nothing: every triangle is in a leaf all the same, and no level is too many."""
    rng = np.random.default_rng(4)
    triangles = (1.0e30 * rng.uniform(-1, 1, (2000, 3, 3))).astype(F32)
    triangles[:, :, 2] = 0.0
    tree = tree_of(triangles, pad=0.0)
    np.testing.assert_array_equal(np.sort(tree.ids.numpy()), np.arange(len(triangles)))
    assert len(tree.children) < len(triangles) / 4


@wp.kernel
def inverse_kernel(
    direction: wp.array[wp.vec3], inverse_out: wp.array[wp.vec3], inverse_leave_out: wp.array[wp.vec3]
) -> None:
    i = wp.tid()
    ray = make_ray(wp.vec3(0.0), direction[i])
    inverse_out[i] = ray.inverse
    inverse_leave_out[i] = ray.inverse_leave


def test_inverses_are_finite() -> None:
    """Of zeros with either sign and of denormals, so that slab arithmetic has no 0 * inf."""
    component = np.array([0.0, -0.0, 1e-45, -1e-45, 1e-39, -1e-39, 1e-37, 1.0, -1.0, 1e30], F32)
    direction = np.stack(np.meshgrid(component, component, component), axis=-1).reshape(-1, 3)
    out = [wp.empty(len(direction), dtype=wp.vec3, device="cpu") for _ in range(2)]
    wp.launch(inverse_kernel, len(direction), inputs=[vectors(direction)], outputs=out, device="cpu")
    for inverse in (array.numpy() for array in out):
        assert np.isfinite(inverse).all()
        assert (inverse != 0).all()
