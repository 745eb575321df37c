"""Microfacets: distributions of normals (GGX and Beckmann, anisotropic), Smith's masking, sampling by visible normals.

Directions are in the local frame of a surface point, z is the macroscopic normal. alpha is the roughness along x and y.

Source: Walter et al. 2007, "Microfacet models for refraction through rough surfaces"; Heitz 2014, "Understanding the
masking-shadowing function" (anisotropy). Masking and shadowing are taken as independent: G = G1(w_from) G1(w_to).
"""

from __future__ import annotations

import math

import warp as wp

from wdpm.kernels.materials.types import GGX
from wdpm.kernels.maths.directions import concentric_disk
from wdpm.kernels.maths.elementary import erf_of, erfinv_of, exp_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ALPHA_LEAST = wp.constant(wp.float32(1e-4))
"""Least roughness of a rough surface; one that is exactly 0 along both tangents is smooth, and no microfacet surface.

A half vector in float32 is off by some 1e-7, so at this roughness the density is known to 2 alpha⁻¹ 1e-7 = 0.2 % at
slopes of alpha. A light that is seen in such a surface is blurred by 0.02 degrees; rougher surfaces are not changed.
"""

_INV_PI = wp.constant(wp.float32(1 / math.pi))
_INV_SQRT_PI = wp.constant(wp.float32(1 / math.sqrt(math.pi)))
_QUARTER_SQRT_PI = wp.constant(wp.float32(0.25 * math.sqrt(math.pi)))
_ERF_MOST = wp.constant(wp.float32(1 - 2.0**-23))  # erf of the steepest slope that is sampled: 3.8 alpha


@wp.func
def is_smooth(alpha: wp.vec2) -> bool:
    """Nothing of this roughness is a microfacet surface."""
    return alpha[0] == 0.0 and alpha[1] == 0.0


@wp.func
def clamped_alpha(alpha: wp.vec2) -> wp.vec2:
    """Roughness that float32 can hold. All other functions here want one such."""
    return wp.vec2(wp.max(alpha[0], ALPHA_LEAST), wp.max(alpha[1], ALPHA_LEAST))


@wp.func
def normal_density(distribution: wp.int32, alpha: wp.vec2, m: wp.vec3) -> wp.float32:
    """D(m): area of microfacets by solid angle of their normals and by area of the surface [1/sr]; 0 for m.z <= 0."""
    if not (m[2] > 0.0):
        return 0.0
    x = m[0] / alpha[0]
    y = m[1] / alpha[1]
    z2 = m[2] * m[2]
    slope2 = x * x + y * y
    scale = _INV_PI / (alpha[0] * alpha[1])
    if distribution == GGX:
        t = slope2 + z2
        return scale / (t * t)
    t = slope2 / z2
    if t > 80.0:  # e^-80: below what float32 holds of the product
        return 0.0
    return scale * exp_of(-t) / (z2 * z2)


@wp.func
def masking_over_cos(distribution: wp.int32, alpha: wp.vec2, w: wp.vec3) -> wp.float32:
    """G1(w) / |w.z|, finite up to grazing. What has the microfacet on the wrong side is for the caller to sort out.

    For Beckmann it is the rational fit of Walter et al. 2007, equation 27, which is within 0.35 % of Smith's function.
    """
    c = wp.abs(w[2])
    x = alpha[0] * w[0]
    y = alpha[1] * w[1]
    s2 = x * x + y * y
    if distribution == GGX:
        return 2.0 / (c + wp.sqrt(c * c + s2))
    s = wp.sqrt(s2)
    if c >= 1.6 * s:
        return 1.0 / c
    return (3.535 * s + 2.181 * c) / (s2 + 2.276 * c * s + 2.577 * c * c)


@wp.func
def masking(distribution: wp.int32, alpha: wp.vec2, w: wp.vec3) -> wp.float32:
    """G1(w): share of the microfacets that face w which are seen from w, Smith's."""
    return masking_over_cos(distribution, alpha, w) * wp.abs(w[2])


@wp.func
def _visible_slope(s: wp.float32, c: wp.float32, u: wp.float32) -> wp.float32:
    """Slope along x of Beckmann facets (alpha = 1) as seen from (s, 0, c).

    With b = erf(slope), the visible area of the facets up to a slope is, but for a factor,

        A(b) = c (1 + b) + s / sqrt(pi) exp(-erfinv(b)²),    A'(b) = c - s erfinv(b)

    (Jakob 2014, "An improved visible normal sampling routine for the Beckmann distribution"; there divided by c).
    It grows to the slope c / s, beyond which facets face away. A(b) = u A(last) is solved by Halley's method; from this
    first guess two steps are off by less than 4e-7 of u, for all u and angles.
    """
    most = c / wp.max(s, 1.0e-20)
    last = erf_of(most)
    wanted = u * (c * (1.0 + last) + s * _INV_SQRT_PI * exp_of(-wp.min(most * most, 80.0)))
    end = wp.min(last, _ERF_MOST)
    rest = 1.0 - u
    b = wp.clamp(last - (1.0 + last) * (rest + s * (wp.sqrt(rest) - rest)), -_ERF_MOST, end)
    slope = erfinv_of(b)
    for _ in range(2):
        g = exp_of(-slope * slope)
        value = c * (1.0 + b) + s * _INV_SQRT_PI * g - wanted
        rate = c - s * slope
        divisor = rate * rate + value * s * _QUARTER_SQRT_PI / g
        if divisor > 1.0e-12:
            b = wp.clamp(b - value * rate / divisor, -_ERF_MOST, end)
            slope = erfinv_of(b)
    return slope


@wp.func
def _sample_beckmann(alpha: wp.vec2, w: wp.vec3, u: wp.vec2) -> wp.vec3:
    """Slopes along the plane of w and across it, for alpha = 1, then turned and stretched."""
    v = wp.normalize(wp.vec3(alpha[0] * w[0], alpha[1] * w[1], w[2]))
    s = wp.sqrt(v[0] * v[0] + v[1] * v[1])
    cos_turn = wp.float32(1.0)
    sin_turn = wp.float32(0.0)
    if s > 0.0:
        cos_turn = v[0] / s
        sin_turn = v[1] / s
    along = _visible_slope(s, v[2], u[0])
    across = erfinv_of(wp.clamp(2.0 * u[1] - 1.0, -_ERF_MOST, _ERF_MOST))
    x = cos_turn * along - sin_turn * across
    y = sin_turn * along + cos_turn * across
    return wp.normalize(wp.vec3(-alpha[0] * x, -alpha[1] * y, 1.0))


@wp.func
def _sample_ggx(alpha: wp.vec2, w: wp.vec3, u: wp.vec2) -> wp.vec3:
    """Half vectors of w and a uniform point of the cap z > -w.z of the sphere, for alpha = 1, then stretched.

    Source: Dupuy & Benyoub 2023, "Sampling visible GGX normals with spherical caps". The cap is a disk wrapped around
    the sphere: no sines, and the z of the sum does not cancel.
    """
    v = wp.normalize(wp.vec3(alpha[0] * w[0], alpha[1] * w[1], w[2]))
    d = concentric_disk(u)
    height = 1.0 + v[2]
    down = (d[0] * d[0] + d[1] * d[1]) * height  # 1 - z of the point
    spread = wp.sqrt(height * wp.max(0.0, 2.0 - down))
    z = wp.max(height - down, 1.0e-7)  # never all zero
    return wp.normalize(wp.vec3(alpha[0] * (d[0] * spread + v[0]), alpha[1] * (d[1] * spread + v[1]), z))


@wp.func(inline=False)  # each rough material samples by it
def sample_visible_normal(distribution: wp.int32, alpha: wp.vec2, w: wp.vec3, u: wp.vec2) -> wp.vec3:
    """A microfacet's normal, in proportion to the area that is seen from w.

    Args:
        w: where the path came from, w.z > 0.
        u: random numbers in [0, 1].

    Returns:
        Unit vector; its z is above 0.
    """
    if distribution == GGX:
        return _sample_ggx(alpha, w, u)
    return _sample_beckmann(alpha, w, u)
