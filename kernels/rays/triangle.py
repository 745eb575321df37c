"""Where a ray meets one triangle: watertight, and a function of the triangle, the ray and `pad` alone.

The exactness contract (docs) asks for the nearest hit as the minimum over (t, triangle id), whatever tree or partition
finds it. Three steps make that true for any tree of boxes:

1. **The test.** Woop, Benthin & Wald 2013, "Watertight ray/triangle intersection": the corners are moved to the ray's
   origin and sheared so that the ray becomes an axis; three edge functions then tell on which side of each edge the
   origin lies. A sheared corner depends on that corner and the ray only, and an edge function computed with the corners
   exchanged is the exact negative, so neighbours agree about a shared edge. Rounding is monotone: the computed sign of
   x*y - z*w is the true sign or zero. Zero counts as inside for both neighbours, so a ray through an edge or corner
   never slips between them. So does what is within the error of an edge function (ON_EDGE): neighbours along a line
   whose corners differ, as at a T-junction, do not agree, but overlap. Doubles make corner minus origin practically
   exact for float32 coordinates.

2. **The clamp.** The t found is clamped to the interval in which the ray is inside the triangle's own box, grown by
   `pad`; an empty interval is a miss. The interval is computed in float32 with the arithmetic that the tree's
   nodes use: (b - o) * inv_d for each face, maximum of the near ones, minimum of the far ones.

3. **Why no tree can lose it.** Subtraction, multiplication, minimum and maximum are monotone under rounding. A node's
   box contains the boxes of its triangles exactly (it is the minimum and maximum of the same floats), so its computed
   interval contains each triangle's computed interval, hence its t: enter(node) <= t <= exit(node). A traversal that
   skips a node only if its interval is empty or if enter > best.t therefore visits every triangle that is nearer than
   the best, or as near: ties are seen too, and the smaller id wins. Which tree it was does not matter.

The clamp moves t by rounding errors only: a hit lies on its triangle, so its t is inside the grown box's interval
up to the error of the slab arithmetic. `pad`, about 2^-19 of the scene's extent, is larger than that error
(3 * 2^-24 of the distance) for origins within several extents, and the far side is scaled after Ize 2013, "Robust BVH
ray traversal", which covers the error at any distance. So no true hit finds its own interval empty.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NO_HIT = wp.constant(3.4e38)
"""The t of a ray that has hit nothing; not infinity, so that arithmetic on it stays finite."""

EXIT_SCALE = wp.constant(1.0 + 2.0**-21)
"""Ize 2013: 1 + 2 gamma(3), gamma(3) = 3 * 2^-24 / (1 - 3 * 2^-24), rounded up to a power of two above 1."""

LARGEST_INVERSE = wp.constant(1.0e37)
"""Stands for 1 / 0. Finite, so that a face through the origin gives 0 * 1e37 = 0, not a NaN."""

SMALLEST_DIRECTION = wp.constant(1.0e-37)
"""Components of a direction below this count as 0 in slab arithmetic."""

EDGE_ON = wp.constant(2.0**-28)
"""A determinant below this share of size times distance means: seen from its side, as far as float32 coordinates tell.

The determinant's error is 2^-50 of the same product, so above, weights are good to 2^-22. Below, the ray passes every
edge it crosses within a few 2^-28 of the distance, less than a rounding of a coordinate."""

ON_EDGE = wp.constant(2.0**-52)
"""An edge function below this share of size times distance does not say on which side of the edge the ray passes.

A sheared corner is off by the rounding of one product and one difference, 2^-53 of its distance along the ray and of
its size; an edge function by the errors of its two corners times their sizes, and its own two products: in all less
than 2^-52 of size times distance. Such a ray counts as inside, so that triangles which meet along a line overlap there,
even if they do not share the corners of that line (T-junctions)."""

FAR = wp.constant(1.0e300)
"""Beyond every t, in doubles."""


@wp.struct
class Hit:
    """The nearest hit of a ray so far.

    Attributes:
        t: distance in units of the direction's length; NO_HIT where there is none.
        prim: global triangle id; -1 where there is none.
        u: barycentric coordinate of the triangle's corner 1.
        v: barycentric coordinate of the triangle's corner 2.
    """

    t: wp.float32
    prim: wp.int32
    u: wp.float32
    v: wp.float32


@wp.func
def no_hit() -> Hit:
    """What a ray starts with."""
    hit = Hit()
    hit.t = NO_HIT
    hit.prim = -1
    return hit


@wp.func
def inverse_component(d: float) -> float:
    if wp.abs(d) < SMALLEST_DIRECTION:
        return LARGEST_INVERSE
    return 1.0 / d


@wp.struct
class Ray:
    """A ray and what all boxes and triangles need of it, computed once.

    Attributes:
        origin, direction: as given.
        inverse: 1 / direction for slab arithmetic: no component is zero, infinite or NaN; -0.0 is like 0.0.
        inverse_leave: the same, scaled by EXIT_SCALE: for the faces where the ray leaves a box.
        axes: the axes in cyclic order, the one along which the direction is longest last.
        turned_origin, turned_inverse, turned_inverse_leave: in the order of `axes`.
        shear: slopes of the first two of `axes` against the third, at most 1, and 1 / direction along the third.
        longest: the direction's largest absolute component.
    """

    origin: wp.vec3
    direction: wp.vec3
    inverse: wp.vec3
    inverse_leave: wp.vec3
    axes: wp.vec3i
    turned_origin: wp.vec3
    turned_inverse: wp.vec3
    turned_inverse_leave: wp.vec3
    shear: wp.vec3d
    longest: wp.float64


@wp.func
def turn(v: wp.vec3, axes: wp.vec3i) -> wp.vec3:
    """The components of v in the order of `axes`, one of the three cyclic ones."""
    if axes[2] == 0:
        return wp.vec3(v[1], v[2], v[0])
    if axes[2] == 1:
        return wp.vec3(v[2], v[0], v[1])
    return v


@wp.func
def make_ray(origin: wp.vec3, direction: wp.vec3) -> Ray:
    """Prepare a ray; the direction need not have length 1."""
    x = wp.abs(direction[0])
    y = wp.abs(direction[1])
    z = wp.abs(direction[2])
    ray = Ray()
    ray.origin = origin
    ray.direction = direction
    ray.inverse = wp.vec3(
        inverse_component(direction[0]), inverse_component(direction[1]), inverse_component(direction[2])
    )
    ray.inverse_leave = ray.inverse * EXIT_SCALE
    if x >= y and x >= z:
        ray.axes = wp.vec3i(1, 2, 0)
    elif y >= z:
        ray.axes = wp.vec3i(2, 0, 1)
    else:
        ray.axes = wp.vec3i(0, 1, 2)
    ray.turned_origin = turn(origin, ray.axes)
    ray.turned_inverse = turn(ray.inverse, ray.axes)
    ray.turned_inverse_leave = turn(ray.inverse_leave, ray.axes)
    d = wp.vec3d(turn(direction, ray.axes))
    per = wp.float64(1.0) / d[2]
    ray.shear = wp.vec3d(d[0] * per, d[1] * per, per)
    ray.longest = wp.abs(d[2])
    return ray


@wp.func
def nearer_crossing(best: wp.vec3d, s0: wp.float64, s1: wp.float64, p0: wp.vec3d, p1: wp.vec3d) -> wp.vec3d:
    """The nearer of `best` and the point of an edge where s is 0; points are (t, v, w)."""
    zero = wp.float64(0.0)
    if (s0 > zero and s1 > zero) or (s0 < zero and s1 < zero):
        return best
    p = p0
    if s0 != s1:
        p = p0 + (p1 - p0) * (s0 / (s0 - s1))
    if p[0] > zero and p[0] < best[0]:
        return p
    return best


@wp.func
def sum_of_absolutes(p: wp.vec3d) -> wp.float64:
    return wp.abs(p[0]) + wp.abs(p[1]) + wp.abs(p[2])


@wp.func
def on_edge(x: wp.vec3d, y: wp.vec3d, z: wp.vec3d, weights: wp.vec3d) -> wp.bool:
    """Whether a ray whose edge functions have both signs may still touch the triangle, as far as doubles tell.

    Args:
        x, y: sheared coordinates of the three corners.
        z: of the corners less the origin, along the ray's longest axis.
        weights: the edge functions.
    """
    size = sum_of_absolutes(x) + sum_of_absolutes(y)
    error = (size + sum_of_absolutes(z)) * wp.float64(ON_EDGE)
    doubt = size * error
    if wp.min(weights) < -doubt and wp.max(weights) > doubt:
        return False
    # Of a triangle without area, as far as it is seen, edge functions say little: beside it, all are in doubt.
    return wp.min(x) <= error and wp.max(x) >= -error and wp.min(y) <= error and wp.max(y) >= -error


@wp.func
def edge_on_hit(x: wp.vec3d, y: wp.vec3d, t: wp.vec3d) -> wp.vec3d:
    """Where a ray enters a triangle that it sees from its side: (t, v, w), t = FAR where it does not.

    The sheared corners lie on a line through the ray, up to rounding, so the area that they span says nothing: weights
    computed from it would be those of any point of the triangle, off the ray. The edges still cross the ray well.

    Args:
        x, y: sheared coordinates of the three corners.
        t: how far along the ray they are.
    """
    s = x
    if wp.max(y) - wp.min(y) > wp.max(x) - wp.min(x):
        s = y
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    a = wp.vec3d(t[0], zero, zero)
    b = wp.vec3d(t[1], one, zero)
    c = wp.vec3d(t[2], zero, one)
    best = wp.vec3d(wp.float64(FAR), zero, zero)
    best = nearer_crossing(best, s[0], s[1], a, b)
    best = nearer_crossing(best, s[1], s[2], b, c)
    return nearer_crossing(best, s[2], s[0], c, a)


@wp.func
def intersect_turned(a: wp.vec3, b: wp.vec3, c: wp.vec3, ray: Ray, pad: float) -> wp.vec3:
    """intersect_triangle, for corners whose components are in the order of the ray's axes."""
    miss = wp.vec3(NO_HIT, 0.0, 0.0)
    o = wp.vec3d(ray.turned_origin)
    pa = wp.vec3d(a) - o
    pb = wp.vec3d(b) - o
    pc = wp.vec3d(c) - o
    slope_x = ray.shear[0]
    slope_y = ray.shear[1]
    x = wp.vec3d(pa[0] - slope_x * pa[2], pb[0] - slope_x * pb[2], pc[0] - slope_x * pc[2])
    y = wp.vec3d(pa[1] - slope_y * pa[2], pb[1] - slope_y * pb[2], pc[1] - slope_y * pc[2])

    u = x[2] * y[1] - y[2] * x[1]  # weight of a
    v = x[0] * y[2] - y[0] * x[2]  # weight of b
    w = x[1] * y[0] - y[1] * x[0]  # weight of c
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    if (u < zero or v < zero or w < zero) and (u > zero or v > zero or w > zero):
        if not on_edge(x, y, wp.vec3d(pa[2], pb[2], pc[2]), wp.vec3d(u, v, w)):
            return miss
    det = u + v + w
    if not (wp.abs(det) > zero):
        return miss  # a needle seen from its side, or no area at all
    z = wp.vec3d(pa[2], pb[2], pc[2]) * ray.shear[2]
    per = one / det
    t_inside = (u * z[0] + v * z[1] + w * z[2]) * per
    hit = wp.vec3d(t_inside, wp.clamp(v * per, zero, one), wp.clamp(w * per, zero, one))
    # x and y of a hit are no larger than the triangle, and known to 2^-52 of its distance.
    size = sum_of_absolutes(x) + sum_of_absolutes(y)
    distance = size + sum_of_absolutes(z) * ray.longest
    if wp.abs(det) < size * distance * wp.float64(EDGE_ON):
        hit = edge_on_hit(x, y, z)
        if hit[0] >= wp.float64(FAR):
            return miss
    t = float(hit[0])

    low = wp.min(a, wp.min(b, c)) - wp.vec3(pad)
    high = wp.max(a, wp.max(b, c)) + wp.vec3(pad)
    enter = float(-NO_HIT)
    leave = float(NO_HIT)
    for axis in range(3):
        near = low[axis]
        far = high[axis]
        if ray.turned_inverse[axis] < 0.0:
            near = high[axis]
            far = low[axis]
        enter_axis = (near - ray.turned_origin[axis]) * ray.turned_inverse[axis]
        leave_axis = (far - ray.turned_origin[axis]) * ray.turned_inverse_leave[axis]
        enter = wp.where(enter_axis > enter, enter_axis, enter)
        leave = wp.where(leave_axis < leave, leave_axis, leave)
    if not (enter <= leave):
        return miss
    t = wp.min(wp.max(t, enter), leave)
    if not (t > 0.0 and t < NO_HIT):
        return miss
    return wp.vec3(t, float(hit[1]), float(hit[2]))


@wp.func
def intersect_triangle(a: wp.vec3, b: wp.vec3, c: wp.vec3, ray: Ray, pad: float) -> wp.vec3:
    """The hit of a ray with one triangle, both faces, edges included.

    Args:
        a, b, c: the corners.
        ray: the ray.
        pad: how far the triangle's box is grown on every side; one number for the whole scene.

    Returns:
        (t, u, v): t > 0 in units of the direction, NO_HIT on a miss; u and v weigh corners b and c.
    """
    return intersect_turned(turn(a, ray.axes), turn(b, ray.axes), turn(c, ray.axes), ray, pad)
