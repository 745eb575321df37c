"""The nearest triangle along a ray, and whether there is any: an 8-wide bounding volume hierarchy.

What makes the result independent of the tree is explained in triangle.py; here, a node is skipped only if its interval is
empty or begins beyond the best hit, and equal distances are decided by the smaller triangle id.

A node's child boxes are six rows of eight floats, so that all eight are tested by a handful of SIMD operations; the
sign of the ray's direction picks the near and the far row. A leaf's triangles lie one after another as nine
rows, read as vec8 too: a float32 test of all of them at once, which never rejects what intersect_triangle accepts, leaves
one or two for that.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels import bvh_build
from wdpm.kernels.bvh_build import LEAF_MAX, MAX_DEPTH, STACK_SIZE, WIDTH, vec8, vec8i
from wdpm.kernels.triangle import EXIT_SCALE, NO_HIT, Hit, intersect_triangle, inverse_direction, no_hit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

__all__ = ["NO_HIT", "Bvh", "Hit", "any_hit", "build", "closest_hit", "no_hit"]

MARGIN = wp.constant(2.0**-17)
"""Error of the float32 pre-test, in units of |d| * (c + e) * e; derived at near_leaf."""

ROUNDING = wp.constant(2.0**-28)
"""Share of (c + e) that the error of the double test itself is worth, so that it is no smaller than the pre-test's."""


@wp.struct
class Bvh:
    """A tree over some triangles.

    Attributes:
        bounds: rows of child boxes, shape [6 * nodes]: low x, high x, low y, high y, low z, high z; (inf, -inf) where
            there is no child.
        children: child codes, shape [nodes]: a node's number, or -(8 * first + size) for a leaf.
        corners: leaf after leaf, nine rows (corner, axis) of `size` floats each, shape [9 * T + 8].
        lanes: the same memory, eight floats from each one on, shape [9 * T + 1].
        ids: global triangle ids in the order of the leaves, shape [T].
        pad: by how much the box of every triangle was grown.
    """

    bounds: wp.array(dtype=vec8)
    children: wp.array(dtype=vec8i)
    corners: wp.array(dtype=wp.float32)
    lanes: wp.array(dtype=vec8)
    ids: wp.array(dtype=wp.int32)
    pad: wp.float32


def build(positions: NDArray[np.float32], ids: NDArray[np.int32], pad: float, device: str = "cpu") -> Bvh:
    """Build a tree on the host and upload it.

    Args:
        positions: corners, finite, shape [T, 3, 3]; T may be 0.
        ids: global triangle ids, shape [T]; each once.
        pad: how far every triangle's box is grown, at least 0; the same number for all trees of a scene.
        device: where the tree is to be traversed.
    """
    count = len(positions)
    positions = np.ascontiguousarray(positions, dtype=np.float32)
    if positions.shape != (count, 3, 3) or np.shape(ids) != (count,):
        raise ValueError(f"positions {positions.shape} and ids {np.shape(ids)}: expected [T, 3, 3] and [T]")
    if count >= 2**31 // 18:
        raise ValueError(f"{count} triangles in one tree: at most {2**31 // 18 - 1}")
    corner_array = wp.array(positions, dtype=wp.vec3, device="cpu", copy=False)
    ids_array = wp.array(np.ascontiguousarray(ids, dtype=np.int32), device="cpu", copy=False)

    scratch = bvh_build.Scratch()
    scratch.boxes = wp.empty(count, dtype=vec8, device="cpu")
    scratch.order = wp.empty(count, dtype=wp.int32, device="cpu")
    scratch.bin_boxes = wp.empty(3 * bvh_build.BINS, dtype=vec8, device="cpu")
    scratch.bin_counts = wp.empty(3 * bvh_build.BINS, dtype=wp.int32, device="cpu")
    scratch.right_areas = wp.empty(bvh_build.BINS, dtype=wp.float32, device="cpu")
    scratch.slot_boxes = wp.empty(WIDTH, dtype=vec8, device="cpu")
    scratch.slot_begin = wp.empty(WIDTH, dtype=wp.int32, device="cpu")
    scratch.slot_end = wp.empty(WIDTH, dtype=wp.int32, device="cpu")
    scratch.todo = wp.empty(WIDTH * (MAX_DEPTH + 1), dtype=wp.vec4i, device="cpu")
    # A node is made for more than LEAF_MAX triangles and always gets all its children: (leaves - 1) / 7 nodes, or the root.
    capacity = count // (WIDTH - 1) + 1
    bounds = wp.empty(6 * capacity, dtype=vec8, device="cpu")
    children = wp.empty(capacity, dtype=vec8i, device="cpu")
    sizes = wp.zeros(2, dtype=wp.int32, device="cpu")
    wp.launch(bvh_build.box_triangles, count, inputs=[corner_array, pad, scratch], device="cpu")
    wp.launch(bvh_build.build_nodes, 1, inputs=[scratch, count, bounds, children, sizes], device="cpu")
    nodes, depth = (int(n) for n in sizes.numpy())
    if depth > MAX_DEPTH or nodes > capacity:
        raise RuntimeError(f"BVH of {count} triangles: {nodes} nodes, {depth} levels; at most {capacity} and {MAX_DEPTH}")

    bvh = Bvh()
    corners = wp.zeros(9 * count + WIDTH, dtype=wp.float32, device="cpu")
    leaf_ids = wp.empty(count, dtype=wp.int32, device="cpu")
    wp.launch(
        bvh_build.pack_leaves,
        nodes,
        inputs=[corner_array, ids_array, scratch.order, children, corners, leaf_ids],
        device="cpu",
    )
    bvh.bounds = wp.clone(bounds[: 6 * nodes], device=device)
    bvh.children = wp.clone(children[:nodes], device=device)
    bvh.corners = corners.to(device)
    bvh.ids = leaf_ids.to(device)
    bvh.lanes = _overlapping_lanes(bvh.corners)
    bvh.pad = pad
    return bvh


def _overlapping_lanes(corners: wp.array) -> wp.array:
    """The same floats as rows of eight that begin at every one of them; keeps the original alive."""
    lanes = wp.array(
        ptr=corners.ptr,
        dtype=vec8,
        shape=(corners.shape[0] - WIDTH + 1,),
        strides=(4,),
        device=corners.device,
    )
    lanes._ref = corners
    return lanes


@wp.func
def lanes_mask(values: vec8) -> int:
    """Bit k is set where values[k] >= 0; a NaN sets none."""
    mask = int(0)
    for k in range(8):
        mask = mask | wp.where(values[k] >= 0.0, 1 << k, 0)
    return mask


@wp.func
def lowest_bit(mask: int) -> int:
    return wp.bit_count((mask & -mask) - 1)


@wp.func
def near_leaf(bvh: Bvh, first: int, size: int, origin: wp.vec3, direction: wp.vec3) -> int:
    """Which triangles of a leaf the ray may hit, as a mask: all that intersect_triangle accepts, and few others.

    Möller & Trumbore 1997 in float32: with c the first corner less the origin and e1, e2 the edges, u = (c x d) . e2,
    v = -(c x d) . e1 and w = (e1 x e2) . d - u - v have one sign on a hit. With unit roundoff r = 2^-24, c and e standing for the
    largest absolute component, and to first order: c x d is off by 6 r c |d|, u and v by 42 r c e |d|,
    the determinant by 42 r e^2 |d|, and w by at most 108 r (c + e) e |d|. 128 r = 2^-17 is the margin given. The double test's
    own errors are below 2^-48 c^2 |d|, which ROUNDING adds.
    """
    n = size
    at = 9 * first
    ax = bvh.lanes[at]
    ay = bvh.lanes[at + n]
    az = bvh.lanes[at + 2 * n]
    e1x = bvh.lanes[at + 3 * n] - ax
    e1y = bvh.lanes[at + 4 * n] - ay
    e1z = bvh.lanes[at + 5 * n] - az
    e2x = bvh.lanes[at + 6 * n] - ax
    e2y = bvh.lanes[at + 7 * n] - ay
    e2z = bvh.lanes[at + 8 * n] - az
    cx = ax - vec8(origin[0])
    cy = ay - vec8(origin[1])
    cz = az - vec8(origin[2])
    rx = cy * direction[2] - cz * direction[1]
    ry = cz * direction[0] - cx * direction[2]
    rz = cx * direction[1] - cy * direction[0]
    u = wp.cw_mul(rx, e2x) + wp.cw_mul(ry, e2y) + wp.cw_mul(rz, e2z)
    v = -(wp.cw_mul(rx, e1x) + wp.cw_mul(ry, e1y) + wp.cw_mul(rz, e1z))
    nx = wp.cw_mul(e1y, e2z) - wp.cw_mul(e1z, e2y)
    ny = wp.cw_mul(e1z, e2x) - wp.cw_mul(e1x, e2z)
    nz = wp.cw_mul(e1x, e2y) - wp.cw_mul(e1y, e2x)
    w = nx * direction[0] + ny * direction[1] + nz * direction[2] - u - v
    e = wp.max(
        wp.max(wp.max(wp.abs(e1x), wp.abs(e1y)), wp.abs(e1z)), wp.max(wp.max(wp.abs(e2x), wp.abs(e2y)), wp.abs(e2z))
    )
    c = wp.max(wp.max(wp.abs(cx), wp.abs(cy)), wp.abs(cz)) + e
    margin = wp.cw_mul(c, e + c * ROUNDING) * (MARGIN * wp.max(wp.abs(direction)))
    inside = wp.max(wp.min(wp.min(u, v), w), -wp.max(wp.max(u, v), w))
    return lanes_mask(inside + margin) & ((1 << size) - 1)


@wp.func
def leaf_corner(bvh: Bvh, at: int, size: int, corner: int) -> wp.vec3:
    row = at + 3 * corner * size
    return wp.vec3(bvh.corners[row], bvh.corners[row + size], bvh.corners[row + 2 * size])


@wp.func
def closest_hit(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, best: Hit) -> Hit:
    """The smaller of `best` and the nearest hit in this tree, by (t, triangle id).

    Args:
        bvh: the tree.
        origin, direction: the ray; the direction need not have length 1, hits have t > 0.
        best: no_hit(), or what the ray has found in other trees.
    """
    stack = wp.zeros(shape=(STACK_SIZE,), dtype=wp.int32)
    stack_enter = wp.zeros(shape=(STACK_SIZE,), dtype=wp.float32)
    inverse = inverse_direction(direction)
    near_x = wp.where(inverse[0] > 0.0, 0, 1)
    near_y = wp.where(inverse[1] > 0.0, 2, 3)
    near_z = wp.where(inverse[2] > 0.0, 4, 5)
    result = best
    code = int(0)
    height = int(0)
    while True:
        if code >= 0:
            row = 6 * code
            enter = wp.max(
                wp.max(
                    (bvh.bounds[row + near_x] - vec8(origin[0])) * inverse[0],
                    (bvh.bounds[row + near_y] - vec8(origin[1])) * inverse[1],
                ),
                wp.max((bvh.bounds[row + near_z] - vec8(origin[2])) * inverse[2], vec8(0.0)),
            )
            leave = (
                wp.min(
                    wp.min(
                        (bvh.bounds[row + 1 - near_x] - vec8(origin[0])) * inverse[0],
                        (bvh.bounds[row + 5 - near_y] - vec8(origin[1])) * inverse[1],
                    ),
                    (bvh.bounds[row + 9 - near_z] - vec8(origin[2])) * inverse[2],
                )
                * EXIT_SCALE
            )
            mask = lanes_mask(wp.min(leave, vec8(result.t)) - enter)
            codes = bvh.children[code]
            base = height
            while mask != 0:
                lane = lowest_bit(mask)
                mask = mask & (mask - 1)
                distance = enter[lane]
                # Insertion by falling distance, so that the nearest child is popped first.
                slot = height
                while slot > base and stack_enter[slot - 1] < distance:
                    stack[slot] = stack[slot - 1]
                    stack_enter[slot] = stack_enter[slot - 1]
                    slot = slot - 1
                stack[slot] = codes[lane]
                stack_enter[slot] = distance
                height = height + 1
        else:
            first = (-code - 1) / 8
            size = -code - 8 * first
            mask = near_leaf(bvh, first, size, origin, direction)
            while mask != 0:
                lane = lowest_bit(mask)
                mask = mask & (mask - 1)
                at = 9 * first + lane
                hit = intersect_triangle(
                    leaf_corner(bvh, at, size, 0),
                    leaf_corner(bvh, at, size, 1),
                    leaf_corner(bvh, at, size, 2),
                    origin,
                    direction,
                    inverse,
                    bvh.pad,
                )
                prim = bvh.ids[first + lane]
                if hit[0] < result.t or (hit[0] == result.t and hit[0] < NO_HIT and prim < result.prim):
                    result.t = hit[0]
                    result.prim = prim
                    result.u = hit[1]
                    result.v = hit[2]
        found = bool(False)
        while height > 0 and not found:
            height = height - 1
            if stack_enter[height] <= result.t:
                found = True
        if not found:
            break
        code = stack[height]
    return result


@wp.func
def any_hit(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_max: float) -> bool:
    """Whether closest_hit would find anything with 0 < t < t_max."""
    stack = wp.zeros(shape=(STACK_SIZE,), dtype=wp.int32)
    inverse = inverse_direction(direction)
    near_x = wp.where(inverse[0] > 0.0, 0, 1)
    near_y = wp.where(inverse[1] > 0.0, 2, 3)
    near_z = wp.where(inverse[2] > 0.0, 4, 5)
    code = int(0)
    height = int(0)
    while True:
        if code >= 0:
            row = 6 * code
            enter = wp.max(
                wp.max(
                    (bvh.bounds[row + near_x] - vec8(origin[0])) * inverse[0],
                    (bvh.bounds[row + near_y] - vec8(origin[1])) * inverse[1],
                ),
                wp.max((bvh.bounds[row + near_z] - vec8(origin[2])) * inverse[2], vec8(0.0)),
            )
            leave = (
                wp.min(
                    wp.min(
                        (bvh.bounds[row + 1 - near_x] - vec8(origin[0])) * inverse[0],
                        (bvh.bounds[row + 5 - near_y] - vec8(origin[1])) * inverse[1],
                    ),
                    (bvh.bounds[row + 9 - near_z] - vec8(origin[2])) * inverse[2],
                )
                * EXIT_SCALE
            )
            mask = lanes_mask(wp.min(leave, vec8(t_max)) - enter)
            codes = bvh.children[code]
            while mask != 0:
                lane = lowest_bit(mask)
                mask = mask & (mask - 1)
                stack[height] = codes[lane]
                height = height + 1
        else:
            first = (-code - 1) / 8
            size = -code - 8 * first
            mask = near_leaf(bvh, first, size, origin, direction)
            while mask != 0:
                lane = lowest_bit(mask)
                mask = mask & (mask - 1)
                at = 9 * first + lane
                hit = intersect_triangle(
                    leaf_corner(bvh, at, size, 0),
                    leaf_corner(bvh, at, size, 1),
                    leaf_corner(bvh, at, size, 2),
                    origin,
                    direction,
                    inverse,
                    bvh.pad,
                )
                if hit[0] < t_max:
                    return True
        if height == 0:
            break
        height = height - 1
        code = stack[height]
    return False
