"""Where a ray meets one triangle: watertight, and a function of the triangle, the ray and `pad` alone.

The exactness contract (docs) asks for the nearest hit as the minimum over (t, triangle id), whatever tree or partition
finds it. Three steps make that true for any tree of boxes:

1. **The test.** Woop, Benthin & Wald 2013, "Watertight ray/triangle intersection": the corners are moved to the ray's
   origin and sheared so that the ray becomes an axis; three edge functions then tell on which side of each edge the
   origin lies. A sheared corner depends on that corner and the ray only, and an edge function computed with the corners
   exchanged is the exact negative, so neighbours agree about a shared edge. Subtraction and rounding are monotone: the
   computed sign of x*y - z*w is the true sign or zero. Zero counts as inside for both neighbours, so a ray through an edge or
   corner never slips between them. Doubles make corner minus origin practically exact for float32 coordinates.

2. **The clamp.** The t found is clamped to the interval in which the ray is inside the triangle's own box, grown by
   `pad`; an empty interval is a miss. The interval is computed in float32 with the arithmetic that the tree's
   nodes use: (b - o) * inv_d for each face, maximum of the near ones, minimum of the far ones.

3. **Why no tree can lose it.** Subtraction, multiplication, minimum and maximum are monotone under rounding. A node's box
   contains the boxes of its triangles exactly (it is the minimum and maximum of the same floats), so its computed
   interval contains each triangle's computed interval, hence its t: enter(node) <= t <= exit(node). A traversal that skips a
   node only if it is empty or if enter > best.t therefore visits every triangle that is nearer than
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
        shear_x, shear_y, shear_z: rows of the matrix that turns the direction into the unit z axis.
    """

    origin: wp.vec3
    direction: wp.vec3
    inverse: wp.vec3
    inverse_leave: wp.vec3
    shear_x: wp.vec3d
    shear_y: wp.vec3d
    shear_z: wp.vec3d


@wp.func
def make_ray(origin: wp.vec3, direction: wp.vec3) -> Ray:
    """Prepare a ray; the direction need not have length 1."""
    x = direction[0]
    y = direction[1]
    z = direction[2]
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    ray = Ray()
    ray.origin = origin
    ray.direction = direction
    ray.inverse = wp.vec3(inverse_component(x), inverse_component(y), inverse_component(z))
    ray.inverse_leave = ray.inverse * EXIT_SCALE
    # Shearing along the longest axis keeps the slopes at most 1.
    if wp.abs(x) >= wp.abs(y) and wp.abs(x) >= wp.abs(z):
        per = one / wp.float64(x)
        ray.shear_x = wp.vec3d(-wp.float64(y) * per, one, zero)
        ray.shear_y = wp.vec3d(-wp.float64(z) * per, zero, one)
        ray.shear_z = wp.vec3d(per, zero, zero)
    elif wp.abs(y) >= wp.abs(z):
        per = one / wp.float64(y)
        ray.shear_x = wp.vec3d(zero, -wp.float64(z) * per, one)
        ray.shear_y = wp.vec3d(one, -wp.float64(x) * per, zero)
        ray.shear_z = wp.vec3d(zero, per, zero)
    else:
        per = one / wp.float64(z)
        ray.shear_x = wp.vec3d(one, zero, -wp.float64(x) * per)
        ray.shear_y = wp.vec3d(zero, one, -wp.float64(y) * per)
        ray.shear_z = wp.vec3d(zero, zero, per)
    return ray


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
    miss = wp.vec3(NO_HIT, 0.0, 0.0)
    o = wp.vec3d(ray.origin)
    pa = wp.vec3d(a) - o
    pb = wp.vec3d(b) - o
    pc = wp.vec3d(c) - o
    ax = wp.dot(ray.shear_x, pa)
    ay = wp.dot(ray.shear_y, pa)
    bx = wp.dot(ray.shear_x, pb)
    by = wp.dot(ray.shear_y, pb)
    cx = wp.dot(ray.shear_x, pc)
    cy = wp.dot(ray.shear_y, pc)

    u = cx * by - cy * bx  # weight of a
    v = ax * cy - ay * cx  # weight of b
    w = bx * ay - by * ax  # weight of c
    zero = wp.float64(0.0)
    if (u < zero or v < zero or w < zero) and (u > zero or v > zero or w > zero):
        return miss
    det = u + v + w
    if not (wp.abs(det) > zero):
        return miss  # a needle seen from its side, or no area at all
    per = wp.float64(1.0) / det
    t = float((u * wp.dot(ray.shear_z, pa) + v * wp.dot(ray.shear_z, pb) + w * wp.dot(ray.shear_z, pc)) * per)

    low = wp.min(a, wp.min(b, c)) - wp.vec3(pad)
    high = wp.max(a, wp.max(b, c)) + wp.vec3(pad)
    enter = float(-NO_HIT)
    leave = float(NO_HIT)
    for axis in range(3):
        near = low[axis]
        far = high[axis]
        if ray.inverse[axis] < 0.0:
            near = high[axis]
            far = low[axis]
        enter = wp.max(enter, (near - ray.origin[axis]) * ray.inverse[axis])
        leave = wp.min(leave, (far - ray.origin[axis]) * ray.inverse_leave[axis])
    if not (enter <= leave):
        return miss
    t = wp.min(wp.max(t, enter), leave)
    if not (t > 0.0 and t < NO_HIT):
        return miss
    return wp.vec3(t, float(v * per), float(w * per))
