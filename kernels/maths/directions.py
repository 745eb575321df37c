"""Directions and points with known densities from points of the unit square. All keep neighbours together."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.constants import PI

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def triangle_weights(u: wp.vec2) -> wp.vec2:
    """Uniform barycentric weights of corners 1 and 2 from a point of the unit square (Heitz 2019, low distortion)."""
    b0 = u[0]
    b1 = u[1]
    if u[1] > u[0]:
        b0 = 0.5 * u[0]
        b1 = u[1] - b0
    else:
        b1 = 0.5 * u[1]
        b0 = u[0] - b1
    return wp.vec2(b0, b1)


@wp.func
def sincos_octant(x: wp.float32) -> wp.vec2:
    """Sine and cosine of pi/4 x for x in [-1, 1], to 1e-7.

    Polynomials, not the C library's functions: those differ between its versions, and the image must not. In float32,
    at a third of what elementary.sincos_of takes.
    """
    a = (0.25 * PI) * x
    a2 = a * a
    sine = a * (1.0 + a2 * (-1.6666667e-1 + a2 * (8.3333310e-3 + a2 * (-1.9840874e-4 + a2 * 2.7525562e-6))))
    cosine = 1.0 + a2 * (-0.5 + a2 * (4.1666667e-2 + a2 * (-1.3888889e-3 + a2 * (2.4801587e-5 - a2 * 2.7557319e-7))))
    return wp.vec2(sine, cosine)


@wp.func
def concentric_disk(u: wp.vec2) -> wp.vec2:
    """The unit square mapped to the unit disk, keeping areas and neighbours (Shirley & Chiu 1997)."""
    x = 2.0 * u[0] - 1.0
    y = 2.0 * u[1] - 1.0
    if wp.abs(x) > wp.abs(y):
        sc = sincos_octant(y / x)
        return wp.vec2(x * sc[1], x * sc[0])
    if y == 0.0:
        return wp.vec2(0.0, 0.0)
    sc = sincos_octant(x / y)
    return wp.vec2(y * sc[0], y * sc[1])


@wp.func
def around(normal: wp.vec3, local: wp.vec3) -> wp.vec3:
    """A direction given in a frame whose z axis is `normal` (Duff et al. 2017).

    The frame is orthonormal to float32's rounding, so a direction of length 1 keeps it to 2e-7 without being
    normalized again, whose square root and division would take a twentieth of a photon's time.
    """
    sign = wp.float32(1.0)
    if normal[2] < 0.0:
        sign = -1.0
    a = -1.0 / (sign + normal[2])
    b = normal[0] * normal[1] * a
    x = wp.vec3(1.0 + sign * normal[0] * normal[0] * a, sign * b, -sign * normal[0])
    y = wp.vec3(b, sign + normal[1] * normal[1] * a, -normal[1])
    return x * local[0] + y * local[1] + normal * local[2]


@wp.func
def cosine_hemisphere(normal: wp.vec3, u: wp.vec2) -> wp.vec3:
    """A direction with pdf_solid_angle = cos / pi about `normal`."""
    d = concentric_disk(u)
    z = wp.sqrt(wp.max(0.0, 1.0 - d[0] * d[0] - d[1] * d[1]))
    return around(normal, wp.vec3(d[0], d[1], z))


@wp.func
def uniform_sphere(u: wp.vec2) -> wp.vec3:
    """A direction with pdf_solid_angle = 1 / (4 pi): the disk wrapped around the sphere, areas kept (Lambert)."""
    d = concentric_disk(u)
    r2 = d[0] * d[0] + d[1] * d[1]
    shrink = 2.0 * wp.sqrt(wp.max(0.0, 1.0 - r2))
    return wp.vec3(d[0] * shrink, d[1] * shrink, 1.0 - 2.0 * r2)


@wp.func
def uniform_cone(u: wp.vec2, height: wp.float32) -> wp.vec3:
    """A direction within a cone about +z with pdf_solid_angle = 1 / (2 pi height); as uniform_sphere at height 2.

    Args:
        height: 1 - cos of the cone's half angle, which keeps its digits in narrow cones.
    """
    d = concentric_disk(u)
    h = (d[0] * d[0] + d[1] * d[1]) * height
    shrink = wp.sqrt(wp.max(0.0, height * (2.0 - h)))
    return wp.vec3(d[0] * shrink, d[1] * shrink, 1.0 - h)
