"""Glass and the like: interfaces of dielectrics, smooth and rough. They have no diffuse part.

Same parameters as Mitsuba 3's `dielectric` and `roughdielectric`. Both sides scatter. Whether a
direction is reflected or transmitted is chosen by Fresnel's reflectance.

Source: Walter et al. 2007, "Microfacet models for refraction through rough surfaces", equations 20 and 21; for the two
modes of transport Veach 1997, section 5.2.
"""

from __future__ import annotations

from functools import cache

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.fresnel import fresnel_dielectric, reflect, refract
from wdpm.kernels.materials.leaf import GlossyPart, LeafCode
from wdpm.kernels.materials.microfacet import (
    clamped_alpha,
    is_smooth,
    masking,
    masking_over_cos,
    normal_density,
    sample_visible_normal,
)
from wdpm.kernels.materials.nodes import Materials, make_parameters
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import RADIANCE, Bsdf, BsdfSample
from wdpm.scenes.model.bsdfs import Dielectric

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DIELECTRIC = wp.constant(Dielectric.KIND.number)

_SPECULAR = wp.constant(Dielectric.KIND.slots["specular_reflectance"])
_TRANSMITTANCE = wp.constant(Dielectric.KIND.slots["specular_transmittance"])
_ETA = wp.constant(Dielectric.KIND.slots["eta"])
_ALPHA_U = wp.constant(Dielectric.KIND.slots["alpha_u"])
_ALPHA_V = wp.constant(Dielectric.KIND.slots["alpha_v"])

SPREAD_LEAST = wp.constant(wp.float32(1e-6))
"""Least |eta - 1| alpha of a rough dielectric; one below it counts as smooth.

Light that is transmitted spreads by about this angle. float32 holds directions to 1e-7: half vectors would be noise
where they are differences of directions that are so alike, and the spread itself could not be seen.
"""


@wp.struct
class Lobe:
    """What is common to the scattering function and the pdf of a rough dielectric, for a pair of directions.

    Attributes:
        pdf: pdf_solid_angle with which the pair's direction is sampled; 0 if no microfacet takes one to the other.
        reflects: 1 if both directions are on one side.
    """

    pdf: wp.float32
    reflects: wp.int32


@wp.func
def is_smooth_dielectric(b: Bsdf) -> bool:
    """Reflection and transmission each have one direction."""
    return is_smooth(b.alpha) or wp.abs(b.eta[0] - 1.0) * wp.max(b.alpha[0], b.alpha[1]) < SPREAD_LEAST


@wp.func
def index_ahead(eta: wp.float32, cos_from: wp.float32) -> wp.float32:
    """Index on the other side of the interface over that on the side of w_from."""
    if cos_from > 0.0:
        return eta
    return 1.0 / eta


@wp.func
def rough_lobe(b: Bsdf, alpha: wp.vec2, w_from: wp.vec3, w_to: wp.vec3) -> Lobe:
    """The microfacets that take one direction to another (Walter et al. 2007, equations 14 to 17)."""
    s = Lobe()
    sides = w_from[2] * w_to[2]
    index = wp.float32(1.0)
    if sides > 0.0:
        s.reflects = 1
    else:
        index = index_ahead(b.eta[0], w_from[2])
    h = w_from + w_to * index
    if h[2] < 0.0:
        h = -h
    h2 = wp.dot(h, h)
    m = wp.normalize(h)
    c_from = wp.dot(w_from, m)
    c_to = wp.dot(w_to, m)
    if sides == 0.0 or h2 == 0.0 or c_from * w_from[2] <= 0.0 or c_to * w_to[2] <= 0.0:
        return s
    value = normal_density(b.distribution, alpha, m)
    if value > 0.0:
        reflectance = fresnel_dielectric(c_from, b.eta[0]).reflectance
        value = value * masking_over_cos(b.distribution, alpha, w_from)
        if s.reflects == 1:
            s.pdf = 0.25 * reflectance * value
        else:
            s.pdf = (1.0 - reflectance) * value * wp.abs(c_from * c_to) * (index * index / h2)
    return s


@wp.func
def lobe_weight(b: Bsdf, reflects: bool, ratio: wp.float32, mode: wp.int32) -> wp.vec3:
    """Weight of a reflected or transmitted direction that was chosen by Fresnel's reflectance."""
    if reflects:
        return b.specular
    if mode == RADIANCE:
        return b.transmittance * (ratio * ratio)
    return b.transmittance


@wp.func
def sample_smooth(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, mode: wp.int32) -> BsdfSample:
    """The mirror direction or the refracted one."""
    at = fresnel_dielectric(w_from[2], b.eta[0])
    reflects = u_lobe < at.reflectance or at.cos_to == 0.0  # no rounding of u refracts where nothing is
    s = BsdfSample()
    s.delta = 1
    s.weight = lobe_weight(b, reflects, at.ratio, mode)
    if reflects:
        s.to = wp.vec3(-w_from[0], -w_from[1], w_from[2])
    else:
        s.to = wp.vec3(-at.ratio * w_from[0], -at.ratio * w_from[1], at.cos_to)
        s.crosses = 1
    return s


@wp.func
def sample_rough(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
    """Reflection or refraction at a visible microfacet. Light that it sends to the wrong side is lost."""
    alpha = clamped_alpha(b.alpha)
    side = wp.float32(1.0)
    if w_from[2] < 0.0:
        side = -1.0
    m = sample_visible_normal(b.distribution, alpha, w_from * side, u)
    c_from = wp.dot(w_from, m)
    at = fresnel_dielectric(c_from, b.eta[0])
    reflects = u_lobe < at.reflectance or at.cos_to == 0.0  # no rounding of u refracts where nothing is
    to = wp.vec3(0.0)
    pdf = normal_density(b.distribution, alpha, m) * masking_over_cos(b.distribution, alpha, w_from)
    side_to = wp.float32(side)
    if reflects:
        to = reflect(w_from, m)
        pdf = 0.25 * at.reflectance * pdf
    else:
        to = refract(w_from, m, at)
        side_to = -side
        # (c_from ratio + cos_to)² of Walter's equation 17, without cancellation where ratio is close to 1.
        h = (at.ratio - 1.0) * (at.ratio + 1.0) / (wp.abs(c_from) * at.ratio + wp.abs(at.cos_to))
        pdf = (1.0 - at.reflectance) * pdf * wp.abs(c_from * at.cos_to) / (h * h)
    s = BsdfSample()
    if c_from * side > 0.0 and to[2] * side_to > 0.0:
        s.to = to
        s.pdf = pdf
        s.weight = lobe_weight(b, reflects, at.ratio, mode) * masking(b.distribution, alpha, to)
        if not reflects:
            s.crosses = 1
    return s


@cache
def make_dielectric(features: Features) -> LeafCode:
    """The code of DIELECTRIC."""
    value, roughness = make_parameters(features).value, make_parameters(features).roughness

    @wp.func
    def read(
        materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> Bsdf:
        b = Bsdf()
        b.kind = DIELECTRIC
        b.distribution = materials.distribution[node]
        b.specular = value(materials, textures, node, _SPECULAR, uv, color)
        b.transmittance = value(materials, textures, node, _TRANSMITTANCE, uv, color)
        b.eta = materials.value[node, _ETA]
        if wp.static(features.rough):
            b.alpha = wp.vec2(
                roughness(materials, textures, node, _ALPHA_U, uv, color),
                roughness(materials, textures, node, _ALPHA_V, uv, color),
            )
        return b

    @wp.func
    def eval_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, mode: wp.int32) -> wp.vec3:
        if wp.static(features.rough):
            if not is_smooth_dielectric(b):
                alpha = clamped_alpha(b.alpha)
                lobe = rough_lobe(b, alpha, w_from, w_to)
                if lobe.pdf > 0.0:
                    value = lobe.pdf * masking(b.distribution, alpha, w_to)
                    if lobe.reflects == 1:
                        return b.specular * value
                    if mode == RADIANCE:
                        index = index_ahead(b.eta[0], w_from[2])
                        value = value / (index * index)
                    return b.transmittance * value
        return wp.vec3(0.0)

    @wp.func
    def pdf_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.float32:
        if wp.static(features.rough):
            if not is_smooth_dielectric(b):
                return rough_lobe(b, clamped_alpha(b.alpha), w_from, w_to).pdf
        return 0.0

    @wp.func
    def sample_glossy(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
        if w_from[2] == 0.0:
            return BsdfSample()
        if wp.static(features.rough):
            if not is_smooth_dielectric(b):
                return sample_rough(b, w_from, u_lobe, u, mode)
        return sample_smooth(b, w_from, u_lobe, mode)

    return LeafCode(int(DIELECTRIC), read, glossy=GlossyPart(sample_glossy, eval_glossy, pdf_glossy))
