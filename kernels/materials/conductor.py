"""Metals, smooth and rough: reflection by a mirror or by microfacets that are mirrors. They have no diffuse part.

Same parameters as Mitsuba 3's `conductor` and `roughconductor`. The back is black.

Source: Walter et al. 2007, "Microfacet models for refraction through rough surfaces", equation 20; Fresnel's equations
for metals in fresnel.py.
"""

from __future__ import annotations

from functools import cache

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.fresnel import fresnel_metal_channels, reflect
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
from wdpm.kernels.materials.types import Bsdf, BsdfSample
from wdpm.scenes.model.bsdfs import Conductor

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

CONDUCTOR = wp.constant(Conductor.KIND.number)

_SPECULAR = wp.constant(Conductor.KIND.slots["specular_reflectance"])
_ETA = wp.constant(Conductor.KIND.slots["eta"])
_K = wp.constant(Conductor.KIND.slots["k"])
_ALPHA_U = wp.constant(Conductor.KIND.slots["alpha_u"])
_ALPHA_V = wp.constant(Conductor.KIND.slots["alpha_v"])


@cache
def make_conductor(features: Features) -> LeafCode:
    """The code of CONDUCTOR."""
    value, roughness = make_parameters(features).value, make_parameters(features).roughness

    @wp.func
    def read(
        materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> Bsdf:
        b = Bsdf()
        b.kind = CONDUCTOR
        b.distribution = materials.distribution[node]
        b.specular = value(materials, textures, node, _SPECULAR, uv, color)
        b.eta = value(materials, textures, node, _ETA, uv, color)
        b.k = value(materials, textures, node, _K, uv, color)
        if wp.static(features.rough):
            b.alpha = wp.vec2(
                roughness(materials, textures, node, _ALPHA_U, uv, color),
                roughness(materials, textures, node, _ALPHA_V, uv, color),
            )
        return b

    @wp.func
    def eval_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, _mode: wp.int32) -> wp.vec3:
        if wp.static(features.rough):
            if w_from[2] > 0.0 and w_to[2] > 0.0 and not is_smooth(b.alpha):
                alpha = clamped_alpha(b.alpha)
                m = wp.normalize(w_from + w_to)
                value = normal_density(b.distribution, alpha, m)
                if value > 0.0:
                    value = value * masking_over_cos(b.distribution, alpha, w_from)
                    value = 0.25 * value * masking(b.distribution, alpha, w_to)
                    return wp.cw_mul(b.specular, fresnel_metal_channels(wp.dot(w_from, m), b.eta, b.k)) * value
        return wp.vec3(0.0)

    @wp.func
    def pdf_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.float32:
        if wp.static(features.rough):
            if w_from[2] > 0.0 and w_to[2] > 0.0 and not is_smooth(b.alpha):
                alpha = clamped_alpha(b.alpha)
                d = normal_density(b.distribution, alpha, wp.normalize(w_from + w_to))
                return 0.25 * d * masking_over_cos(b.distribution, alpha, w_from)
        return 0.0

    @wp.func
    def sample_glossy(b: Bsdf, w_from: wp.vec3, _u_lobe: wp.float32, u: wp.vec2, _mode: wp.int32) -> BsdfSample:
        s = BsdfSample()
        if not (w_from[2] > 0.0):
            return s
        if wp.static(features.rough):
            if not is_smooth(b.alpha):
                alpha = clamped_alpha(b.alpha)
                m = sample_visible_normal(b.distribution, alpha, w_from, u)
                to = reflect(w_from, m)
                if to[2] > 0.0:
                    fresnel = fresnel_metal_channels(wp.dot(w_from, m), b.eta, b.k)
                    d = normal_density(b.distribution, alpha, m)
                    s.to = to
                    s.weight = wp.cw_mul(b.specular, fresnel) * masking(b.distribution, alpha, to)
                    s.pdf = 0.25 * d * masking_over_cos(b.distribution, alpha, w_from)
                return s
        s.to = wp.vec3(-w_from[0], -w_from[1], w_from[2])
        s.weight = wp.cw_mul(b.specular, fresnel_metal_channels(w_from[2], b.eta, b.k))
        s.delta = 1
        return s

    return LeafCode(int(CONDUCTOR), read, glossy=GlossyPart(sample_glossy, eval_glossy, pdf_glossy))
