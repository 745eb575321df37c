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


@wp.func
def inverse_direction(direction: wp.vec3) -> wp.vec3:
    """1 / direction for slab arithmetic: no component is zero, infinite or NaN; -0.0 is like 0.0."""
    return wp.vec3(inverse_component(direction[0]), inverse_component(direction[1]), inverse_component(direction[2]))


@wp.func
def shear_row(axis: int, along: int, slope: wp.float64) -> wp.vec3d:
    """The row that maps a corner to its coordinate `axis`, less `slope` times the coordinate `along`."""
    row = wp.vec3d()
    row[axis] = wp.float64(1.0)
    row[along] = -slope
    return row


@wp.func
def intersect_triangle(
    a: wp.vec3, b: wp.vec3, c: wp.vec3, origin: wp.vec3, direction: wp.vec3, inverse: wp.vec3, pad: float
) -> wp.vec3:
    """The hit of a ray with one triangle, both faces, edges included.

    Args:
        a, b, c: the corners.
        origin, direction: the ray; the direction need not have length 1.
        inverse: inverse_direction(direction).
        pad: how far the triangle's box is grown on every side; one number for the whole scene.

    Returns:
        (t, u, v): t > 0 in units of the direction, NO_HIT on a miss; u and v weigh corners b and c.
    """
    miss = wp.vec3(NO_HIT, 0.0, 0.0)

    # The axis along which the ray is longest keeps |slope| <= 1.
    kz = int(0)
    if wp.abs(direction[1]) > wp.abs(direction[0]):
        kz = 1
    if wp.abs(direction[2]) > wp.abs(direction[kz]):
        kz = 2
    kx = (kz + 1) % 3
    ky = (kz + 2) % 3
    dz = wp.float64(direction[kz])
    row_x = shear_row(kx, kz, wp.float64(direction[kx]) / dz)
    row_y = shear_row(ky, kz, wp.float64(direction[ky]) / dz)

    o = wp.vec3d(origin)
    pa = wp.vec3d(a) - o
    pb = wp.vec3d(b) - o
    pc = wp.vec3d(c) - o
    ax = wp.dot(row_x, pa)
    ay = wp.dot(row_y, pa)
    bx = wp.dot(row_x, pb)
    by = wp.dot(row_y, pb)
    cx = wp.dot(row_x, pc)
    cy = wp.dot(row_y, pc)

    u = cx * by - cy * bx  # weight of a
    v = ax * cy - ay * cx  # weight of b
    w = bx * ay - by * ax  # weight of c
    zero = wp.float64(0.0)
    if wp.min(u, wp.min(v, w)) < zero and wp.max(u, wp.max(v, w)) > zero:
        return miss
    det = u + v + w
    if det == zero:
        return miss  # a needle seen from its side, or no area at all
    t = float((u * pa[kz] + v * pb[kz] + w * pc[kz]) / (det * dz))

    low = wp.min(a, wp.min(b, c)) - wp.vec3(pad)
    high = wp.max(a, wp.max(b, c)) + wp.vec3(pad)
    to_low = wp.cw_mul(low - origin, inverse)
    to_high = wp.cw_mul(high - origin, inverse)
    enter = wp.max(wp.min(to_low, to_high))
    leave = wp.min(wp.max(to_low, to_high)) * EXIT_SCALE
    if not (enter <= leave):
        return miss
    t = wp.min(wp.max(t, enter), leave)
    if not (t > 0.0 and t < NO_HIT):
        return miss
    return wp.vec3(t, float(v / det), float(w / det))
