"""Rays against instances: a tree of boxes in which instances stand, and below it one tree for each shape.

A ray enters a shape's tree in the shape's space, where all that is done with it is to skip boxes. They are grown by so
much (`grow`) that none is skipped which holds a triangle that the ray hits where it stands. What is left is tested
there, by the test and with the clamp of all triangles (triangle.py), so hits have the bits that copies would give, and
which tree found them does not matter.

By how much boxes are grown, with r = 2^-24, D the largest component of what leads from the ray's origin to the far side
of the instance's box, and C the box's largest coordinate: a hit that the test accepts lies within 4 r of the ray's
length of the triangle (t is rounded, and clamped by slab arithmetic), so within 7 r D, and within 2^-22 of the
triangle's size (weights), 8 r D; corners are rounded by r C where they stand. The ray in the shape's space is known to
r of its size and slab arithmetic is off by 3 r of the distance, together less than 10 r D. So 64 r D and 8 r C cover
all with room to spare, turned into the shape's space by the absolute values of the inverse matrix; roundings of the
shape's own coordinates are added. Near rays are thus tested against little more than what they hit, however large the
scene.

Leaves are tested by lanes_inside in the shape's space, whose edge functions change by at most 12 times grow, direction
and longest edge when the ray is moved by `grow` (u and v each by 6, their difference from the determinant by 12).
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.rays import ball_bounds, bvh
from wdpm.kernels.rays.ball_bounds import NO_BALLS, Balls
from wdpm.kernels.rays.build_tree import Run, build_tree
from wdpm.kernels.rays.bvh import Bvh, leaf_first
from wdpm.kernels.rays.bvh_build import CHILD_STACK, WIDTH
from wdpm.kernels.rays.instances import DeviceInstances, instance_corner
from wdpm.kernels.rays.lanes import (
    child_code,
    children_enter,
    children_leave,
    lanes_inside,
    lanes_not_above,
    leaf_corner,
    lowest_bit,
    vec8,
    vec8i,
)
from wdpm.kernels.rays.triangle import NO_HIT, Hit, Ray, intersect_triangle, make_ray
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.instances import Instances
from wdpm.scenes.flat.reach import instance_boxes

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PADS = 4.0
"""By how many pads of the scene boxes of instances are grown."""

OF_DISTANCE = wp.constant(2.0**-18)
OF_PLACE = 2.0**-21
"""Shares of D and of C, see above."""

OWN_ROUNDINGS = 2.0**-21
"""By what share of the shape's largest coordinate its boxes are grown besides."""

SLACK = 12.0
"""Of grow, direction and longest edge: see above."""

child_stack_of_ints = wp.types.vector(length=CHILD_STACK, dtype=wp.int32)
child_stack_of_floats = wp.types.vector(length=CHILD_STACK, dtype=wp.float32)


@wp.struct
class Trees:
    """What a ray can hit in a cell.

    Attributes:
        plain: of the triangles with arrays of their own.
        places: of boxes of instances, each a triangle from corner to corner; its ids are instances.
        shapes: of all shapes, one after another, in their own spaces about `middle`; its ids are rows of shapes.
        instances: of the shapes.
        root: node of the root of each instance's shape, shape [I].
        inverse: rows of the matrix from the renderer's space to the shape's about its middle, shape [I, 3].
        spread: how far what is moved by one in any way is moved in the shape's space, shape [I].
        grow: by what boxes there are grown besides OF_DISTANCE of the spread distance, shape [I].
        edge: what an edge function may be off by, over the direction's largest component and what boxes are grown by,
            shape [I].
    """

    plain: Bvh
    places: Bvh
    shapes: Bvh
    instances: DeviceInstances
    root: wp.array[wp.int32]
    inverse: wp.array2d[wp.vec4d]
    spread: wp.array[wp.vec3]
    grow: wp.array[wp.vec3]
    edge: wp.array[wp.float32]


def build(
    triangles: Triangles, uploaded: Any, pad: float, device: str, balls: Balls = NO_BALLS, run: Run | None = None
) -> Any:
    """Trees over a cell's triangles and instances: Trees.

    Args:
        uploaded: its instances on the device (rays.instances.DeviceInstances).
        pad: as for bvh.build.
        balls: which of its glowing meshes are balls.
        run: runs kernels on the CPU, on several threads perhaps; None for this one.
    """
    instances = triangles.instances
    trees = Trees()
    trees.plain = bvh.build(triangles.positions, triangles.ids, pad, device, run)
    if len(balls.emitter):
        rows = np.searchsorted(triangles.ids, trees.plain.ids.numpy())
        children = trees.plain.children.numpy()
        found = ball_bounds.bound(children, rows, triangles.positions, triangles.emitter, balls, device)
        trees.plain.balls = found
    low, high = instance_boxes(instances)
    boxes = np.stack([low - PADS * pad, high + PADS * pad, low - PADS * pad], axis=1).astype(np.float32)
    trees.places = bvh.build(boxes, np.arange(len(instances), dtype=np.int32), pad, device)
    trees.instances = uploaded
    middle = _middles(instances)
    trees.shapes, roots = _shapes(instances, middle, pad, device, run)
    inverse = np.linalg.inv(instances.matrix[:, :, :3]).astype(np.float64)
    offset = -np.einsum("iab,ib->ia", inverse, instances.matrix[:, :, 3]) - middle[instances.shape]
    spread = np.abs(inverse).sum(axis=2)
    grow = _grow(instances, middle, spread, np.maximum(np.abs(low), np.abs(high)).max(axis=1, initial=0.0))
    edge = np.array([_longest_edge(instances, shape) for shape in range(len(instances.shapes))])
    rows = np.concatenate([inverse, offset[:, :, None]], axis=2)
    trees.root = wp.array(roots[instances.shape], dtype=wp.int32, device=device)
    trees.inverse = wp.array(rows, dtype=wp.vec4d, device=device)
    trees.spread = wp.array(spread.astype(np.float32), dtype=wp.vec3, device=device)
    trees.grow = wp.array(grow.astype(np.float32), dtype=wp.vec3, device=device)
    trees.edge = wp.array((SLACK * edge[instances.shape]).astype(np.float32), dtype=wp.float32, device=device)
    return trees


def _rows(instances: Instances, shape: int) -> slice:
    return slice(int(instances.shapes.first[shape]), int(instances.shapes.first[shape + 1]))


def _middles(instances: Instances) -> NDArray[np.float64]:
    """The middle of each shape's box, so that its coordinates are no larger than its size, shape [S, 3]."""
    corners = [instances.shapes.corners[_rows(instances, shape)] for shape in range(len(instances.shapes))]
    return np.array([(c.min(axis=(0, 1)) + c.max(axis=(0, 1))) / 2.0 for c in corners]).reshape(-1, 3)


def _longest_edge(instances: Instances, shape: int) -> float:
    """The largest component of any edge of a shape."""
    corners = instances.shapes.corners[_rows(instances, shape)]
    return float(np.abs(corners - np.roll(corners, 1, axis=1)).max(initial=0.0))


def _grow(
    instances: Instances, middle: NDArray[np.float64], spread: NDArray[np.float64], farthest: NDArray[np.float64]
) -> NDArray[np.float64]:
    reach = [
        np.abs(instances.shapes.corners[_rows(instances, shape)] - middle[shape]).max(axis=(0, 1))
        for shape in range(len(instances.shapes))
    ]
    own = np.array(reach).reshape(-1, 3)[instances.shape]
    grow: NDArray[np.float64] = OF_PLACE * farthest[:, None] * spread + OWN_ROUNDINGS * own
    return grow


def _shapes(
    instances: Instances, middle: NDArray[np.float64], pad: float, device: str, run: Run | None
) -> tuple[Any, NDArray[np.int32]]:
    """One set of arrays for the trees of all shapes, and the number of the root of each."""
    trees = []
    for shape in range(len(instances.shapes)):
        rows = _rows(instances, shape)
        corners = (instances.shapes.corners[rows] - middle[shape]).astype(np.float32)
        trees.append(build_tree(corners, np.arange(rows.start, rows.stop, dtype=np.int32), 0.0, run))
    nodes = np.cumsum([0, *(len(tree.children) for tree in trees)]).astype(np.int32)
    joined = Bvh()
    bounds = [tree.bounds.numpy() for tree in trees]
    codes = [_moved(t.children.numpy(), nodes[s], instances.shapes.first[s]) for s, t in enumerate(trees)]
    corners = [tree.corners.numpy()[: 9 * len(tree.ids)] for tree in trees]
    ids = [tree.ids.numpy() for tree in trees]
    joined.bounds = wp.array(np.concatenate([np.zeros((0, 8), np.float32), *bounds]), dtype=vec8, device=device)
    joined.children = wp.array(np.concatenate([np.zeros((0, 8), np.int32), *codes]), dtype=vec8i, device=device)
    every = np.concatenate([*corners, np.zeros(int(WIDTH), np.float32)])
    joined.corners = wp.array(every, dtype=wp.float32, device=device)
    joined.ids = wp.array(np.concatenate([np.zeros(0, np.int32), *ids]), dtype=wp.int32, device=device)
    joined.pad = pad
    joined.balls = ball_bounds.no_bounds(device)
    return joined, nodes[:-1]


def _moved(codes: NDArray[np.int32], nodes: np.int32, triangles: np.int32) -> NDArray[np.int32]:
    """Child codes of a tree that follows others of so many nodes and triangles; 0 is no child."""
    moved = np.where(codes < 0, codes - 8 * triangles, codes + nodes)
    return np.where(codes == 0, 0, moved).astype(np.int32)


@wp.func
def own_component(row: wp.vec4d, v: wp.vec3, w: wp.float64) -> wp.float32:
    """One coordinate of a point (w = 1) or direction (w = 0) in a shape's space."""
    return wp.float32(row[0] * wp.float64(v[0]) + row[1] * wp.float64(v[1]) + row[2] * wp.float64(v[2]) + row[3] * w)


@wp.func
def own_vector(trees: wp.ref[Trees], instance: wp.int32, v: wp.vec3, w: wp.float64) -> wp.vec3:
    """A point (w = 1) or direction (w = 0) in the space of an instance's shape."""
    return wp.vec3(
        own_component(trees.inverse[instance, 0], v, w),
        own_component(trees.inverse[instance, 1], v, w),
        own_component(trees.inverse[instance, 2], v, w),
    )


@wp.func
def towards(inverse: wp.vec3, grow: wp.vec3) -> wp.vec3:
    """`grow` with the signs of a ray's direction: what moving its origin by grows the faces where it enters a box."""
    return wp.vec3(
        wp.where(inverse[0] > 0.0, grow[0], -grow[0]),
        wp.where(inverse[1] > 0.0, grow[1], -grow[1]),
        wp.where(inverse[2] > 0.0, grow[2], -grow[2]),
    )


@wp.func
def nearer(trees: wp.ref[Trees], instance: wp.int32, row: wp.int32, ray: Ray, best: Hit) -> Hit:
    """The smaller of `best` and the hit with an instance's triangle where it stands."""
    hit = intersect_triangle(
        instance_corner(trees.instances, instance, row, 0),
        instance_corner(trees.instances, instance, row, 1),
        instance_corner(trees.instances, instance, row, 2),
        ray,
        trees.plain.pad,
    )
    nearest = best
    if hit[0] <= best.t and hit[0] < NO_HIT:
        prim = trees.instances.base[instance] + row - trees.instances.first[instance]
        if hit[0] < best.t or prim < best.prim:
            nearest.t = hit[0]
            nearest.prim = prim
            nearest.u = hit[1]
            nearest.v = hit[2]
    return nearest


@wp.func
def far_side(trees: wp.ref[Trees], at: wp.int32, size: wp.int32, ray: Ray, t_max: wp.float32) -> wp.float32:
    """How far the far side of an instance's box is off along some axis, at most; negative where a ray misses the box.

    Args:
        at, size: of its box in a leaf of `places`, as bvh.intersect_lane has them.
        t_max: what lies beyond does not count.
    """
    axes = wp.vec3i(0, 1, 2)
    low = leaf_corner(trees.places.corners, at, size, axes)
    high = leaf_corner(trees.places.corners, at + 3 * size, size, axes)
    enter = wp.float32(0.0)
    leave = t_max
    off = wp.float32(0.0)
    for axis in range(3):
        near = low[axis]
        far = high[axis]
        if ray.inverse[axis] < 0.0:
            near = high[axis]
            far = low[axis]
        enter = wp.max(enter, (near - ray.origin[axis]) * ray.inverse[axis])
        leave = wp.min(leave, (far - ray.origin[axis]) * ray.inverse_leave[axis])
        off = wp.max(off, wp.max(wp.abs(near - ray.origin[axis]), wp.abs(far - ray.origin[axis])))
    if not (enter <= leave):
        off = -1.0
    return off


@functools.cache
def _make_walk(first_suffices: bool) -> wp.Function:
    """`in_instance(trees, instance, off, ray, best) -> Hit`: the smaller of `best` and the hits with one instance.

    Its argument `off` is as far_side has it.

    Args:
        first_suffices: whether any hit before `best` will do.
    """

    @wp.func
    def in_instance(trees: wp.ref[Trees], instance: wp.int32, off: wp.float32, ray: Ray, best: Hit) -> Hit:
        """A walk through the tree of the instance's shape."""
        stack = child_stack_of_ints()
        stack_enter = child_stack_of_floats()
        height = wp.int32(0)
        own = make_ray(
            own_vector(trees, instance, ray.origin, wp.float64(1.0)),
            own_vector(trees, instance, ray.direction, wp.float64(0.0)),
        )
        grow = trees.grow[instance] + OF_DISTANCE * off * trees.spread[instance]
        shift = towards(own.inverse, grow)
        longest = wp.float32(own.longest)
        slack = trees.edge[instance] * wp.max(grow) * longest
        nearest = best
        code = wp.int32(0) + trees.root[instance]
        while True:
            if code >= 0:
                enter = children_enter(trees.shapes.bounds, code, own.origin + shift, own.inverse)
                leave = children_leave(trees.shapes.bounds, code, own.origin - shift, own.inverse_leave, nearest.t)
                mask = lanes_not_above(enter, leave)
                if mask != 0:
                    node = code
                    lane = lowest_bit(mask)
                    code = child_code(trees.shapes.children, node, lane)
                    first_enter = enter[lane]
                    mask = mask & (mask - 1)
                    while mask != 0:
                        lane = lowest_bit(mask)
                        mask = mask & (mask - 1)
                        later = child_code(trees.shapes.children, node, lane)
                        later_enter = enter[lane]
                        if later_enter < first_enter:
                            swap = later
                            later = code
                            code = swap
                            swap_enter = later_enter
                            later_enter = first_enter
                            first_enter = swap_enter
                        stack[height] = later
                        stack_enter[height] = later_enter
                        height = height + 1
                    continue
            else:
                first = leaf_first(code)
                size = -code - 8 * first
                inside = lanes_inside(trees.shapes.corners, first, size, own.origin, own.direction, longest)
                mask = lanes_not_above(vec8(-slack), inside) & ((1 << size) - 1)
                while mask != 0:
                    lane = lowest_bit(mask)
                    mask = mask & (mask - 1)
                    nearest = nearer(trees, instance, trees.shapes.ids[first + lane], ray, nearest)
                if wp.static(first_suffices):
                    if nearest.prim != best.prim:
                        break
            found = wp.bool(False)
            while height > 0 and not found:
                height = height - 1
                found = stack_enter[height] <= nearest.t
            if not found:
                break
            code = stack[height]
        return nearest

    return in_instance


@functools.cache
def _make_descent(first_suffices: bool) -> wp.Function:
    """`descend(trees, ray, best) -> Hit`: the smaller of `best` and the hits with instances; as _make_walk."""
    in_instance = _make_walk(first_suffices)

    @wp.func
    def descend(trees: wp.ref[Trees], ray: Ray, best: Hit) -> Hit:
        stack = child_stack_of_ints()
        stack_enter = child_stack_of_floats()
        height = wp.int32(0)
        nearest = best
        code = wp.int32(0)
        while True:
            if code >= 0:
                enter = children_enter(trees.places.bounds, code, ray.origin, ray.inverse)
                leave = children_leave(trees.places.bounds, code, ray.origin, ray.inverse_leave, nearest.t)
                mask = lanes_not_above(enter, leave)
                if mask != 0:
                    node = code
                    lane = lowest_bit(mask)
                    code = child_code(trees.places.children, node, lane)
                    first_enter = enter[lane]
                    mask = mask & (mask - 1)
                    while mask != 0:
                        lane = lowest_bit(mask)
                        mask = mask & (mask - 1)
                        later = child_code(trees.places.children, node, lane)
                        later_enter = enter[lane]
                        if later_enter < first_enter:
                            swap = later
                            later = code
                            code = swap
                            swap_enter = later_enter
                            later_enter = first_enter
                            first_enter = swap_enter
                        stack[height] = later
                        stack_enter[height] = later_enter
                        height = height + 1
                    continue
            else:
                first = leaf_first(code)
                size = -code - 8 * first
                for lane in range(size):
                    off = far_side(trees, 9 * first + lane, size, ray, nearest.t)
                    if off >= 0.0:
                        nearest = in_instance(trees, trees.places.ids[first + lane], off, ray, nearest)
                if wp.static(first_suffices):
                    if nearest.prim != best.prim:
                        break
            found = wp.bool(False)
            while height > 0 and not found:
                height = height - 1
                found = stack_enter[height] <= nearest.t
            if not found:
                break
            code = stack[height]
        return nearest

    return descend


_descend_to_nearest = _make_descent(False)
_descend_to_any = _make_descent(True)


@wp.func
def closest_of_all(trees: wp.ref[Trees], origin: wp.vec3, direction: wp.vec3, best: Hit) -> Hit:
    """As bvh.closest_hit, instances included."""
    nearest = bvh.closest_hit(trees.plain, origin, direction, best)
    if trees.instances.count > 0:
        nearest = _descend_to_nearest(trees, make_ray(origin, direction), nearest)
    return nearest


@wp.func
def any_of_all(trees: wp.ref[Trees], origin: wp.vec3, direction: wp.vec3, t_max: float) -> bool:
    """As bvh.any_hit, instances included."""
    if bvh.any_hit(trees.plain, origin, direction, t_max):
        return True
    if trees.instances.count == 0:
        return False
    end = Hit()
    end.t = t_max
    end.prim = -1  # below all numbers: a hit at t_max itself does not count
    return _descend_to_any(trees, make_ray(origin, direction), end).prim >= 0


@wp.func
def closest_of_plain(trees: wp.ref[Trees], origin: wp.vec3, direction: wp.vec3, best: Hit) -> Hit:
    """As bvh.closest_hit, in a scene without instances."""
    return bvh.closest_hit(trees.plain, origin, direction, best)


@wp.func
def any_of_plain(trees: wp.ref[Trees], origin: wp.vec3, direction: wp.vec3, t_max: float) -> bool:
    """As bvh.any_hit, in a scene without instances."""
    return bvh.any_hit(trees.plain, origin, direction, t_max)


def closest_function(instances: bool) -> wp.Function:
    """`closest_hit(trees, origin, direction, best) -> Hit`, for scenes with or without instances."""
    return closest_of_all if instances else closest_of_plain


def any_function(instances: bool) -> wp.Function:
    """`any_hit(trees, origin, direction, t_max) -> bool`, for scenes with or without instances."""
    return any_of_all if instances else any_of_plain
