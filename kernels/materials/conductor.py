"""Metals, smooth and rough: reflection by a mirror or by microfacets that are mirrors. They have no diffuse part.

Same parameters as Mitsuba 3's `conductor` and `roughconductor`. The back is black.

Source: Walter et al. 2007, "Microfacet models for refraction through rough surfaces", equation 20; Fresnel's equations
for metals in fresnel.py.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.fresnel import fresnel_metal_channels, reflect
from wdpm.kernels.materials.microfacet import (
    held_alpha,
    is_smooth,
    masking,
    masking_over_cos,
    normal_density,
    sample_visible_normal,
)
from wdpm.kernels.materials.types import Bsdf, BsdfSample

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@cache
def make_conductor(features: Features) -> SimpleNamespace:
    """`eval_glossy`, `pdf_glossy` and `sample_glossy` of CONDUCTOR; see bsdf.py for what they take and give."""

    @wp.func
    def eval_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, _mode: wp.int32) -> wp.vec3:
        if wp.static(features.rough):
            if w_from[2] > 0.0 and w_to[2] > 0.0 and not is_smooth(b.alpha):
                alpha = held_alpha(b.alpha)
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
                alpha = held_alpha(b.alpha)
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
                alpha = held_alpha(b.alpha)
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

    return SimpleNamespace(eval_glossy=eval_glossy, pdf_glossy=pdf_glossy, sample_glossy=sample_glossy)
