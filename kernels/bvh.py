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
from wdpm.kernels.triangle import NO_HIT, Hit, intersect_triangle, make_ray, no_hit

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


_ENTER_CHILDREN = """
    const float* rows = bounds.data->c + 48 * node;
    const float* x = rows + (inverse[0] > 0.0f ? 0 : 8);
    const float* y = rows + (inverse[1] > 0.0f ? 16 : 24);
    const float* z = rows + (inverse[2] > 0.0f ? 32 : 40);
    wp::vec_t<8, wp::float32> result;
#if defined(__CUDA_ARCH__)
    for (int k = 0; k < 8; ++k) {
        float enter_x = (x[k] - origin[0]) * inverse[0];
        float enter_y = (y[k] - origin[1]) * inverse[1];
        float enter_z = (z[k] - origin[2]) * inverse[2];
        result.c[k] = fmaxf(fmaxf(enter_x, enter_y), fmaxf(enter_z, 0.0f));
    }
#else
    typedef float lanes __attribute__((ext_vector_type(8), aligned(4)));
    const lanes enter_x = (*(const lanes*)x - origin[0]) * inverse[0];
    const lanes enter_y = (*(const lanes*)y - origin[1]) * inverse[1];
    const lanes enter_z = (*(const lanes*)z - origin[2]) * inverse[2];
    const lanes enter_xy = enter_x > enter_y ? enter_x : enter_y;
    const lanes enter_z0 = enter_z > 0.0f ? enter_z : (lanes)0.0f;
    *(lanes*)result.c = enter_xy > enter_z0 ? enter_xy : enter_z0;
#endif
    return result;
"""

_LEAVE_CHILDREN = """
    const float* rows = bounds.data->c + 48 * node;
    const float* x = rows + (inverse[0] > 0.0f ? 8 : 0);
    const float* y = rows + (inverse[1] > 0.0f ? 24 : 16);
    const float* z = rows + (inverse[2] > 0.0f ? 40 : 32);
    wp::vec_t<8, wp::float32> result;
#if defined(__CUDA_ARCH__)
    for (int k = 0; k < 8; ++k) {
        float leave_x = (x[k] - origin[0]) * inverse[0];
        float leave_y = (y[k] - origin[1]) * inverse[1];
        float leave_z = (z[k] - origin[2]) * inverse[2];
        result.c[k] = fminf(fminf(leave_x, leave_y), fminf(leave_z, t_max));
    }
#else
    typedef float lanes __attribute__((ext_vector_type(8), aligned(4)));
    const lanes leave_x = (*(const lanes*)x - origin[0]) * inverse[0];
    const lanes leave_y = (*(const lanes*)y - origin[1]) * inverse[1];
    const lanes leave_z = (*(const lanes*)z - origin[2]) * inverse[2];
    const lanes leave_xy = leave_x < leave_y ? leave_x : leave_y;
    const lanes leave_zt = leave_z < t_max ? leave_z : (lanes)t_max;
    *(lanes*)result.c = leave_xy < leave_zt ? leave_xy : leave_zt;
#endif
    return result;
"""

_LANES_NOT_ABOVE = """
#if defined(__CUDA_ARCH__)
    int mask = 0;
    for (int k = 0; k < 8; ++k)
        mask |= int(a.c[k] <= b.c[k]) << k;
    return mask;
#else
    typedef float lanes __attribute__((ext_vector_type(8), aligned(4)));
    typedef bool bits __attribute__((ext_vector_type(8)));
    const bits below = __builtin_convertvector(*(const lanes*)a.c <= *(const lanes*)b.c, bits);
    return __builtin_bit_cast(unsigned char, below);
#endif
"""


@wp.func_native(_ENTER_CHILDREN)
def enter_children(bounds: wp.array(dtype=vec8), node: int, origin: wp.vec3, inverse: wp.vec3) -> vec8:
    """Where the ray enters the boxes of a node's children, not before its origin."""
    ...


@wp.func_native(_LEAVE_CHILDREN)
def leave_children(bounds: wp.array(dtype=vec8), node: int, origin: wp.vec3, inverse: wp.vec3, t_max: float) -> vec8:
    """Where the ray leaves the boxes of a node's children, not after t_max."""
    ...


@wp.func_native(_LANES_NOT_ABOVE)
def lanes_not_above(a: vec8, b: vec8) -> int:
    """Bit k is set where a[k] <= b[k]; a NaN sets none."""
    ...


@wp.func_native("return children.data->c[8 * node + lane];")
def child_code(children: wp.array(dtype=vec8i), node: int, lane: int) -> int:
    """children[node][lane]; plain indexing would copy all eight first."""
    ...


@wp.func_native("return wp::vec_t<3, wp::float32>(corners.data[at], corners.data[at + size], corners.data[at + 2 * size]);")
def leaf_corner(corners: wp.array(dtype=wp.float32), at: int, size: int) -> wp.vec3:
    """One corner of a triangle whose x lies at `at` in a leaf of `size` triangles."""
    ...


_NEAR_LEAF = """
    const float* rows = corners.data + 9 * first;
    wp::vec_t<8, wp::float32> result;
    typedef float lanes __attribute__((ext_vector_type(8), aligned(4)));
#define ROW(k) (*(const lanes*)(rows + (k) * size))
#define MAX(a, b) ((a) > (b) ? (a) : (b))
#define ABS(a) __builtin_elementwise_abs(a)
    lanes ax = ROW(0), ay = ROW(1), az = ROW(2);
    lanes e1x = ROW(3) - ax, e1y = ROW(4) - ay, e1z = ROW(5) - az;
    lanes e2x = ROW(6) - ax, e2y = ROW(7) - ay, e2z = ROW(8) - az;
    lanes cx = ax - origin[0], cy = ay - origin[1], cz = az - origin[2];
    lanes rx = cy * direction[2] - cz * direction[1];
    lanes ry = cz * direction[0] - cx * direction[2];
    lanes rz = cx * direction[1] - cy * direction[0];
    lanes u = rx * e2x + ry * e2y + rz * e2z;
    lanes v = -(rx * e1x + ry * e1y + rz * e1z);
    lanes nx = e1y * e2z - e1z * e2y;
    lanes ny = e1z * e2x - e1x * e2z;
    lanes nz = e1x * e2y - e1y * e2x;
    lanes w = nx * direction[0] + ny * direction[1] + nz * direction[2] - u - v;
    lanes e = ABS(e1x); e = MAX(e, ABS(e1y)); e = MAX(e, ABS(e1z)); e = MAX(e, ABS(e2x)); e = MAX(e, ABS(e2y)); e = MAX(e, ABS(e2z));
    lanes c = ABS(cx); c = MAX(c, ABS(cy)); c = MAX(c, ABS(cz)); c += e;
    lanes slack = c * (e + c * rounding) * margin;
    lanes low = u < v ? u : v; low = low < w ? low : w;
    lanes high = u > v ? u : v; high = high > w ? high : w;
    high = -high;
    *(lanes*)result.c = (low > high ? low : high) + slack;
    return result;
"""


@wp.func_native(_NEAR_LEAF)
def near_leaf_lanes(
    corners: wp.array(dtype=wp.float32),
    first: int,
    size: int,
    origin: wp.vec3,
    direction: wp.vec3,
    margin: float,
    rounding: float,
) -> vec8:
    ...


@wp.func
def lowest_bit(mask: int) -> int:
    return wp.bit_count((mask & -mask) - 1)


@wp.func
def near_leaf(bvh: Bvh, first: int, size: int, origin: wp.vec3, direction: wp.vec3) -> int:
    return lanes_not_above(vec8(0.0), near_leaf_lanes(bvh.corners, first, size, origin, direction, MARGIN * wp.max(wp.abs(direction)), ROUNDING)) & ((1 << size) - 1)


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
    ray = make_ray(origin, direction)
    result = best
    code = int(0)
    height = int(0)
    while True:
        if code >= 0:
            node = code
            enter = enter_children(bvh.bounds, node, origin, ray.inverse)
            leave = leave_children(bvh.bounds, node, origin, ray.inverse_leave, result.t)
            mask = lanes_not_above(enter, leave)
            if mask != 0:
                lane = lowest_bit(mask)
                mask = mask & (mask - 1)
                code = child_code(bvh.children, node, lane)
                if mask == 0:
                    continue
                nearest = enter[lane]
                base = height
                while mask != 0:
                    lane = lowest_bit(mask)
                    mask = mask & (mask - 1)
                    other = child_code(bvh.children, node, lane)
                    distance = enter[lane]
                    if distance < nearest:
                        swap = other
                        other = code
                        code = swap
                        swap_distance = distance
                        distance = nearest
                        nearest = swap_distance
                    slot = height
                    while slot > base and stack_enter[slot - 1] < distance:
                        stack[slot] = stack[slot - 1]
                        stack_enter[slot] = stack_enter[slot - 1]
                        slot = slot - 1
                    stack[slot] = other
                    stack_enter[slot] = distance
                    height = height + 1
                continue
        else:
            first = (-code - 1) / 8
            size = -code - 8 * first
            mask = near_leaf(bvh, first, size, origin, direction)
            while mask != 0:
                lane = lowest_bit(mask)
                mask = mask & (mask - 1)
                at = 9 * first + lane
                hit = intersect_triangle(
                    leaf_corner(bvh.corners, at, size),
                    leaf_corner(bvh.corners, at + 3 * size, size),
                    leaf_corner(bvh.corners, at + 6 * size, size),
                    ray,
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
    ray = make_ray(origin, direction)
    code = int(0)
    height = int(0)
    while True:
        if code >= 0:
            node = code
            enter = enter_children(bvh.bounds, node, origin, ray.inverse)
            leave = leave_children(bvh.bounds, node, origin, ray.inverse_leave, t_max)
            mask = lanes_not_above(enter, leave)
            if mask != 0:
                code = child_code(bvh.children, node, lowest_bit(mask))
                mask = mask & (mask - 1)
                while mask != 0:
                    stack[height] = child_code(bvh.children, node, lowest_bit(mask))
                    mask = mask & (mask - 1)
                    height = height + 1
                continue
        else:
            first = (-code - 1) / 8
            size = -code - 8 * first
            mask = near_leaf(bvh, first, size, origin, direction)
            while mask != 0:
                lane = lowest_bit(mask)
                mask = mask & (mask - 1)
                at = 9 * first + lane
                hit = intersect_triangle(
                    leaf_corner(bvh.corners, at, size),
                    leaf_corner(bvh.corners, at + 3 * size, size),
                    leaf_corner(bvh.corners, at + 6 * size, size),
                    ray,
                    bvh.pad,
                )
                if hit[0] < t_max:
                    return True
        if height == 0:
            break
        height = height - 1
        code = stack[height]
    return False
