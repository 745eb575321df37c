"""Kernels that trace rays through a tree, or test them against every triangle."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from wdpm.kernels.rays import bvh
from wdpm.kernels.rays.bvh import Bvh, Hit, any_hit, closest_hit, no_hit
from wdpm.kernels.rays.triangle import NO_HIT, intersect_triangle, make_ray

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


F32 = np.float32
Array = npt.NDArray[Any]
MISS = F32(NO_HIT)
PAD = 2.0**-17
"""For scenes about 4 across."""


@wp.kernel
def closest_kernel(
    tree: Bvh,
    origin: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
    best: wp.array(dtype=Hit),
    best_out: wp.array(dtype=Hit),
):
    i = wp.tid()
    best_out[i] = closest_hit(tree, origin[i], direction[i], best[i])


@wp.kernel
def any_kernel(
    tree: Bvh,
    origin: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
    t_max: wp.array(dtype=float),
    hit_out: wp.array(dtype=wp.bool),
):
    i = wp.tid()
    hit_out[i] = any_hit(tree, origin[i], direction[i], t_max[i])


@wp.kernel
def all_triangles_kernel(
    corners: wp.array2d(dtype=wp.vec3),
    ids: wp.array(dtype=int),
    origin: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
    pad: float,
    best_out: wp.array(dtype=Hit),
):
    """The plain twin of closest_kernel: no tree, no float32 test before the exact one."""
    i = wp.tid()
    best = no_hit()
    ray = make_ray(origin[i], direction[i])
    for k in range(corners.shape[0]):
        hit = intersect_triangle(corners[k, 0], corners[k, 1], corners[k, 2], ray, pad)
        if hit[0] < best.t or (hit[0] == best.t and ids[k] < best.prim):
            best.t = hit[0]
            best.prim = ids[k]
            best.u = hit[1]
            best.v = hit[2]
    best_out[i] = best


def numbers(triangles: Array) -> Array:
    return np.arange(len(triangles), dtype=np.int32)


def tree_of(triangles: Array, ids: Array | None = None, pad: float = PAD) -> Any:
    return bvh.build(triangles, numbers(triangles) if ids is None else ids, pad)


def misses(count: int) -> Array:
    best = np.zeros(count, dtype=Hit.numpy_dtype())
    best["t"], best["prim"] = MISS, -1
    return best


def trace(tree: Any, origin: Array, direction: Array, best: Array | None = None) -> Array:
    """Structured array (t, prim, u, v) of the nearest hits."""
    count = len(origin)
    out = wp.empty(count, dtype=Hit, device="cpu")
    best_in = wp.array(misses(count) if best is None else best, dtype=Hit, device="cpu")
    wp.launch(closest_kernel, count, inputs=[tree, vectors(origin), vectors(direction), best_in, out], device="cpu")
    return out.numpy()


def trace_all(triangles: Array, origin: Array, direction: Array, ids: Array | None = None, pad: float = PAD) -> Array:
    count = len(origin)
    out = wp.empty(count, dtype=Hit, device="cpu")
    corners = wp.array(np.ascontiguousarray(triangles), dtype=wp.vec3, device="cpu").reshape((-1, 3))
    id_array = wp.array(numbers(triangles) if ids is None else ids, dtype=int, device="cpu")
    inputs = [corners, id_array, vectors(origin), vectors(direction), pad, out]
    wp.launch(all_triangles_kernel, count, inputs=inputs, device="cpu")
    return out.numpy()


def occluded(tree: Any, origin: Array, direction: Array, t_max: Array) -> Array:
    out = wp.empty(len(origin), dtype=wp.bool, device="cpu")
    limit = wp.array(t_max.astype(F32), dtype=float, device="cpu")
    wp.launch(any_kernel, len(origin), inputs=[tree, vectors(origin), vectors(direction), limit, out], device="cpu")
    return out.numpy()


def vectors(rows: Array) -> Any:
    return wp.array(np.ascontiguousarray(rows, dtype=F32), dtype=wp.vec3, device="cpu")


def assert_same_bits(a: Array, b: Array) -> None:
    for field in ("t", "prim", "u", "v"):
        np.testing.assert_array_equal(a[field].view(np.int32), b[field].view(np.int32), err_msg=field)
