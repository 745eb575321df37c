"""Fresnel's equations for unpolarised light at interfaces of dielectrics and of metals, and Snell's refraction.

Cosines are those of the angle between a direction that points away from the surface and the normal; below 0 the
direction is inside. eta is the index of refraction inside over that outside.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Interface:
    """What a dielectric interface does to light that comes from a direction.

    Attributes:
        reflectance: share of it that is reflected, in [0, 1]; exactly 1 in total reflection.
        cos_to: cosine of the refracted direction, of the other sign than that of the direction itself; 0 in total
            reflection.
        ratio: index on the side where light comes from over that on the side where it goes to.
    """

    reflectance: wp.float32
    cos_to: wp.float32
    ratio: wp.float32


@wp.func
def fresnel_dielectric(cos_from: wp.float32, eta: wp.float32) -> Interface:
    """Reflectance and refraction at a dielectric interface (Born & Wolf, Principles of Optics, 1.5.2).

    Matched indices (eta = 1) reflect nothing; grazing light (a cosine of 0) is all reflected otherwise.

    Args:
        cos_from: in [-1, 1].
        eta: above 0.
    """
    s = Interface()
    s.ratio = 1.0 / eta
    index = eta
    if cos_from < 0.0:
        s.ratio = eta
        index = 1.0 / eta
    c = wp.min(wp.abs(cos_from), 1.0)
    c2 = 1.0 - s.ratio * s.ratio * (1.0 - c * c)
    if eta == 1.0:
        s.reflectance = 0.0
        s.cos_to = -cos_from
    elif c2 <= 0.0 or c == 0.0:
        s.reflectance = 1.0
        s.cos_to = 0.0
    else:
        t = wp.sqrt(c2)
        s.cos_to = t
        if cos_from >= 0.0:
            s.cos_to = -t
        perpendicular = (c - index * t) / (c + index * t)
        parallel = (index * c - t) / (index * c + t)
        s.reflectance = wp.min(0.5 * (perpendicular * perpendicular + parallel * parallel), 1.0)
    return s


@wp.func
def fresnel_metal(cos_from: wp.float32, eta: wp.float32, k: wp.float32) -> wp.float32:
    """Reflectance of an interface to a medium of complex index eta + i k, relative to the outside.

    Source: Born & Wolf, Principles of Optics, 14.2. With a² - b² = eta² - k² - sin² and a b = eta k,

        perpendicular = ((a - cos)² + b²) / ((a + cos)² + b²)
        parallel = perpendicular ((a - sin tan)² + b²) / ((a + sin tan)² + b²)

    eta = 0 and k > 0 reflect everything, exactly.

    Args:
        cos_from: in [0, 1].
        eta, k: at least 0.
    """
    c = wp.min(cos_from, 1.0)
    c2 = c * c
    s2 = 1.0 - c2
    difference = eta * eta - k * k - s2
    product = 2.0 * eta * k
    size = wp.sqrt(difference * difference + product * product)  # a² + b²
    a2 = 0.5 * (size + difference)
    if difference < 0.0:
        a2 = 0.5 * product * product / (size - difference)  # the same without cancellation
    a = wp.sqrt(wp.max(0.0, a2))
    sum_1 = size + c2
    cross_1 = 2.0 * a * c
    sum_2 = size * c2 + s2 * s2
    cross_2 = cross_1 * s2
    perpendicular = wp.float32(1.0)
    if sum_1 + cross_1 > 0.0:
        perpendicular = (sum_1 - cross_1) / (sum_1 + cross_1)
    parallel = wp.float32(perpendicular)
    if sum_2 + cross_2 > 0.0:
        parallel = perpendicular * ((sum_2 - cross_2) / (sum_2 + cross_2))
    return wp.clamp(0.5 * (perpendicular + parallel), 0.0, 1.0)


@wp.func
def fresnel_metal_channels(cos_from: wp.float32, eta: wp.vec3, k: wp.vec3) -> wp.vec3:
    """`fresnel_metal` of each channel; a channel that equals the one before it is not computed again."""
    red = fresnel_metal(cos_from, eta[0], k[0])
    green = red
    if eta[1] != eta[0] or k[1] != k[0]:
        green = fresnel_metal(cos_from, eta[1], k[1])
    blue = green
    if eta[2] != eta[1] or k[2] != k[1]:
        blue = fresnel_metal(cos_from, eta[2], k[2])
    return wp.vec3(red, green, blue)


@wp.func
def reflect(w: wp.vec3, normal: wp.vec3) -> wp.vec3:
    """The mirror direction of w about a unit normal; all point away from the surface."""
    return normal * (2.0 * wp.dot(w, normal)) - w


@wp.func
def refract(w: wp.vec3, normal: wp.vec3, interface: Interface) -> wp.vec3:
    """The direction to which light from w is refracted at a facet with a unit normal (Snell).

    Args:
        interface: fresnel_dielectric(dot(w, normal), eta), and no total reflection.
    """
    return normal * (wp.dot(w, normal) * interface.ratio + interface.cos_to) - w * interface.ratio


@wp.func
def pane_reflectance(cos_from: wp.float32, eta: wp.float32) -> wp.float32:
    """Share that a thin pane reflects; the rest passes straight through.

    With all reflections between its two sides: r + (1 - r)² r / (1 - r²) = 2 r / (1 + r).
    """
    r = fresnel_dielectric(wp.abs(cos_from), eta).reflectance
    return 2.0 * r / (1.0 + r)
