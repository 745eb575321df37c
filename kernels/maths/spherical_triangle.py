"""Triangles as they are seen from a place: their solid angle, and points that are spread evenly over it.

Arvo 1995, "Stratified Sampling of Spherical Triangles", in the form of Pharr, Jakob & Humphreys 2023 (Physically Based
Rendering, 6.5.4), which needs no inverse function of the sampled part's angles. All is in float64: a lamp as seen from
the wall beside it is a thin triangle, and its solid angle a small difference of angles.
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.maths.elementary import atan2_wide, sincos_wide

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))


@wp.func
def solid_angle(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.float64:
    """Solid angle of a triangle, in [0, 2 pi] [sr].

    Van Oosterom & Strackee 1983, "The Solid Angle of a Plane Triangle": exact to 1e-10 of itself, however small.

    Args:
        a, b, c: corners as seen from the place.
    """
    la = wp.length(a)
    lb = wp.length(b)
    lc = wp.length(c)
    volume = wp.abs(wp.dot(a, wp.cross(b, c)))
    if volume == _ZERO:
        return _ZERO
    return _TWO * atan2_wide(volume, la * lb * lc + wp.dot(a, b) * lc + wp.dot(a, c) * lb + wp.dot(b, c) * la)


@wp.func
def _within_one(x: wp.float64) -> wp.float64:
    return wp.clamp(x, -_ONE, _ONE)


@wp.func
def direction_in_triangle(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, angle: wp.float64, u: wp.vec2d) -> wp.vec3d:
    """A direction in which a triangle is seen: even in solid angle, continuous in u.

    The first number cuts off a triangle a, b, c' of that share of the solid angle, with c' between a and c; the second
    picks a point of the arc from b to c'.

    Args:
        a, b, c: corners as seen from the place.
        angle: the triangle's solid angle, above 0 [sr].
        u: point of the unit square.

    Returns:
        Unit vector.
    """
    ua = wp.normalize(a)
    ub = wp.normalize(b)
    uc = wp.normalize(c)
    # Sine and cosine of the angle at a, between the planes of its two sides.
    to_b = wp.normalize(wp.cross(ua, ub))
    to_c = wp.normalize(wp.cross(ua, uc))
    cos_alpha = _within_one(wp.dot(to_b, to_c))
    sin_alpha = wp.length(wp.cross(to_b, to_c))
    part = sincos_wide(u[0] * angle)
    # phi = part + pi - alpha
    cos_phi = -(part[1] * cos_alpha + part[0] * sin_alpha)
    sin_phi = part[1] * sin_alpha - part[0] * cos_alpha
    k1 = cos_phi + cos_alpha
    k2 = sin_phi - sin_alpha * wp.dot(ua, ub)
    below = (k2 * sin_phi + k1 * cos_phi) * sin_alpha
    cosine = _ONE
    if below != _ZERO:
        cosine = _within_one((k2 + (k2 * cos_phi - k1 * sin_phi) * cos_alpha) / below)
    sine = wp.sqrt((_ONE - cosine) * (_ONE + cosine))
    cut = ua * cosine + wp.normalize(uc - ua * wp.dot(uc, ua)) * sine
    # 1 - cosine of the arc from b, without the cancellation.
    apart = cut - ub
    lack = u[1] * wp.dot(apart, apart) / _TWO
    along = wp.normalize(cut - ub * wp.dot(cut, ub))
    return ub * (_ONE - lack) + along * wp.sqrt(wp.max(lack * (_TWO - lack), _ZERO))


@wp.func
def weights_seen(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, direction: wp.vec3d) -> wp.vec2:
    """Weights of corners b and c of the point of a triangle that is seen in a direction; within it in any case.

    Möller & Trumbore 1997, from the origin.
    """
    one = b - a
    other = c - a
    across = wp.cross(direction, other)
    determinant = wp.dot(one, across)
    if determinant == _ZERO:
        return wp.vec2(0.0, 0.0)
    w1 = wp.clamp(-wp.dot(a, across) / determinant, _ZERO, _ONE)
    w2 = wp.clamp(-wp.dot(direction, wp.cross(a, one)) / determinant, _ZERO, _ONE - w1)
    return wp.vec2(wp.float32(w1), wp.float32(w2))
