"""The nearest triangle along a ray, and whether there is any: an 8-wide bounding volume hierarchy.

Why the result does not depend on the tree is explained in triangle.py; here, a node is skipped only if its interval is
empty or begins beyond the best hit, and equal distances are decided by the smaller triangle id.

All child boxes of a node are tested at once, and so are all triangles of a leaf, by a float32 test that never rejects
what intersect_triangle accepts (lanes.py); one or two are left for that. Children are visited nearest first.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.rays import ball_bounds
from wdpm.kernels.rays.ball_bounds import BallBounds, without_balls
from wdpm.kernels.rays.build_tree import Run, build_tree
from wdpm.kernels.rays.bvh_build import CHILD_STACK, MAX_DEPTH
from wdpm.kernels.rays.lanes import (
    child_code,
    children_enter,
    children_leave,
    expect_codes,
    lanes_inside,
    lanes_not_above,
    leaf_corner,
    lowest_bit,
    vec8,
    vec8i,
)
from wdpm.kernels.rays.triangle import NO_HIT, Hit, Ray, intersect_turned, make_ray, no_hit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

__all__ = ["NO_HIT", "Bvh", "Hit", "any_hit", "build", "closest_hit", "no_hit"]

child_stack_of_ints = wp.types.vector(length=CHILD_STACK, dtype=wp.int32)
child_stack_of_floats = wp.types.vector(length=CHILD_STACK, dtype=wp.float32)
node_stack_of_ints = wp.types.vector(length=MAX_DEPTH, dtype=wp.int32)


@wp.struct
class Bvh:
    """A tree over some triangles.

    Attributes:
        bounds: child boxes, six rows a node, shape [6 * nodes]: low x, high x, low y, high y, low z, high z;
            (inf, -inf) where there is no child.
        children: child codes, shape [nodes]: a node's number, or -(8 * first + size) for a leaf, size from 1 to 8.
        corners: leaf after leaf nine rows (corner, axis) of `size` floats, shape [9 * T + 8]; rows are read eight
            floats at a time, so eight more follow the last.
        ids: global triangle ids in the order of the leaves, shape [T].
        pad: by how much the box of every triangle was grown.
        balls: further bounds of some children, which any_hit heeds.
    """

    bounds: wp.array[vec8]
    children: wp.array[vec8i]
    corners: wp.array[wp.float32]
    ids: wp.array[wp.int32]
    pad: wp.float32
    balls: BallBounds


def build(
    positions: NDArray[np.float32], ids: NDArray[np.int32], pad: float, device: str = "cpu", run: Run | None = None
) -> Bvh:
    """Build a tree on the host and upload it.

    Args:
        positions: corners, finite, shape [T, 3, 3]; T may be 0.
        ids: global triangle ids, shape [T], each once.
        pad: how far every triangle's box is grown, at least 0: about 2^-19 of the scene's extent, and the same number
            for all trees of a scene.
        device: where the tree is to be traversed.
        run: runs kernels on the CPU, on several threads perhaps; None for this one.
    """
    tree = build_tree(positions, ids, pad, run)
    bvh = Bvh()
    bvh.bounds = tree.bounds.to(device)
    bvh.children = tree.children.to(device)
    bvh.corners = tree.corners.to(device)
    bvh.ids = tree.ids.to(device)
    bvh.pad = pad
    bvh.balls = ball_bounds.no_bounds(device)
    return bvh


@wp.func
def leaf_candidates(bvh: wp.ref[Bvh], first: int, size: int, ray: Ray) -> int:
    """Mask of the triangles of a leaf that the ray may hit."""
    inside = lanes_inside(bvh.corners, first, size, ray.origin, ray.direction, float(ray.longest))
    return lanes_not_above(vec8(0.0), inside) & ((1 << size) - 1)


@wp.func
def intersect_lane(bvh: wp.ref[Bvh], first: int, size: int, lane: int, ray: Ray) -> wp.vec3:
    """(t, u, v) of one triangle of a leaf, as intersect_triangle gives it."""
    at = 9 * first + lane
    return intersect_turned(
        leaf_corner(bvh.corners, at, size, ray.axes),
        leaf_corner(bvh.corners, at + 3 * size, size, ray.axes),
        leaf_corner(bvh.corners, at + 6 * size, size, ray.axes),
        ray,
        bvh.pad,
    )


@wp.func
def leaf_first(code: int) -> int:
    """How many triangles come before the leaf of this (negative) child code; sizes are 1 to 8, hence the - 1."""
    return (-code - 1) >> 3


@wp.func
def closest_hit(bvh: wp.ref[Bvh], origin: wp.vec3, direction: wp.vec3, best: Hit) -> Hit:
    """The smaller of `best` and the nearest hit in this tree, by (t, triangle id).

    Args:
        bvh: the tree.
        origin, direction: the ray; the direction need not have length 1. Hits have t > 0, with no epsilon.
        best: no_hit(), or what the ray has found in other trees.
    """
    stack = child_stack_of_ints()
    stack_enter = child_stack_of_floats()
    height = wp.int32(0)
    ray = make_ray(origin, direction)
    nearest = best
    code = wp.int32(0)
    while True:
        if code >= 0:
            node = code
            expect_codes(bvh.children, node)
            enter = children_enter(bvh.bounds, node, origin, ray.inverse)
            leave = children_leave(bvh.bounds, node, origin, ray.inverse_leave, nearest.t)
            mask = lanes_not_above(enter, leave)
            if mask != 0:
                lane = lowest_bit(mask)
                mask = mask & (mask - 1)
                code = child_code(bvh.children, node, lane)
                if mask == 0:
                    continue  # one child: by far the most frequent case
                first_enter = enter[lane]
                base = height
                while mask != 0:
                    lane = lowest_bit(mask)
                    mask = mask & (mask - 1)
                    later = child_code(bvh.children, node, lane)
                    later_enter = enter[lane]
                    if later_enter < first_enter:
                        swap = later
                        later = code
                        code = swap
                        swap_enter = later_enter
                        later_enter = first_enter
                        first_enter = swap_enter
                    # Insertion by falling distance: the nearest is popped first.
                    slot = height
                    while slot > base and stack_enter[slot - 1] < later_enter:
                        stack[slot] = stack[slot - 1]
                        stack_enter[slot] = stack_enter[slot - 1]
                        slot = slot - 1
                    stack[slot] = later
                    stack_enter[slot] = later_enter
                    height = height + 1
                continue
        else:
            first = leaf_first(code)
            size = -code - 8 * first
            mask = leaf_candidates(bvh, first, size, ray)
            while mask != 0:
                lane = lowest_bit(mask)
                mask = mask & (mask - 1)
                prim = bvh.ids[first + lane]  # asked for early: it is in no cache
                hit = intersect_lane(bvh, first, size, lane, ray)
                t = hit[0]
                if t <= nearest.t and t < NO_HIT:
                    if t < nearest.t or prim < nearest.prim:
                        nearest.t = t
                        nearest.prim = prim
                        nearest.u = hit[1]
                        nearest.v = hit[2]
        found = wp.bool(False)
        while height > 0 and not found:
            height = height - 1
            found = stack_enter[height] <= nearest.t
        if not found:
            break
        code = stack[height]
    return nearest


@wp.func
def any_hit(bvh: wp.ref[Bvh], origin: wp.vec3, direction: wp.vec3, t_max: float) -> bool:
    """Whether closest_hit would find a hit with 0 < t < t_max in this tree."""
    stack_node = node_stack_of_ints()
    stack_mask = node_stack_of_ints()
    height = wp.int32(0)
    ray = make_ray(origin, direction)
    code = wp.int32(0)
    while True:
        if code >= 0:
            node = code
            expect_codes(bvh.children, node)
            enter = children_enter(bvh.bounds, node, origin, ray.inverse)
            leave = children_leave(bvh.bounds, node, origin, ray.inverse_leave, t_max)
            mask = lanes_not_above(enter, leave)
            if bvh.balls.mask.shape[0] > 0:
                mask = without_balls(bvh.balls, node, mask, origin, direction, t_max)
            if mask != 0:
                code = child_code(bvh.children, node, lowest_bit(mask))
                mask = mask & (mask - 1)
                if mask != 0:
                    stack_node[height] = node
                    stack_mask[height] = mask
                    height = height + 1
                continue
        else:
            first = leaf_first(code)
            size = -code - 8 * first
            mask = leaf_candidates(bvh, first, size, ray)
            while mask != 0:
                lane = lowest_bit(mask)
                mask = mask & (mask - 1)
                hit = intersect_lane(bvh, first, size, lane, ray)
                if hit[0] < t_max and hit[0] < NO_HIT:
                    return True
        if height == 0:
            break
        top = height - 1
        mask = stack_mask[top]
        code = child_code(bvh.children, stack_node[top], lowest_bit(mask))
        mask = mask & (mask - 1)
        stack_mask[top] = mask
        if mask == 0:
            height = top
    return False
