"""Plastic: a diffuse base under a dielectric coat, smooth (alpha exactly 0) or rough.

Same parameters as Mitsuba 3's `plastic` and `roughplastic`. Only the front scatters. The glossy part is the coat's
reflection; the diffuse part is light that crosses the coat, is scattered by the base (and again, by what the coat
reflects back inside) and crosses it once more:

    f = T(w_from) T(w_to) / (pi eta²) * color / (1 - R),    R = internal reflectance (times color where nonlinear)

What depends on the material only is computed when a scene is loaded (plastic_coat.py) and takes the place of
what plastic has no use for: eta[1] is the internal reflectance, eta[2] the mean of T over diffuse light,
(transmittance, k) are the coefficients c0 to c5 of a rough coat's T. Roughness is isotropic: alpha[0]. Of light that
grazes the coat it lets less through, nearly in proportion to Schlick's weight: `grazing_gain`.
"""

from __future__ import annotations

from functools import cache

import warp as wp

from wdpm.kernels.constants import INV_PI
from wdpm.kernels.features import Features
from wdpm.kernels.materials.fresnel import fresnel_dielectric, reflect
from wdpm.kernels.materials.leaf import DiffusePart, GlossyPart, LeafCode
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
from wdpm.scenes.flat import material_coats
from wdpm.scenes.model.bsdfs import Plastic

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Static conditions prune only where they stand alone;.

PLASTIC = wp.constant(Plastic.KIND.number)

_SPECULAR = wp.constant(Plastic.KIND.slots["specular_reflectance"])
_DIFFUSE = wp.constant(Plastic.KIND.slots["diffuse_reflectance"])
_ETA = wp.constant(Plastic.KIND.slots["eta"])
_ALPHA = wp.constant(Plastic.KIND.slots["alpha"])
_NONLINEAR = wp.constant(Plastic.KIND.slots["nonlinear"])
_OUTER = wp.constant(material_coats.OUTER)
_INNER = wp.constant(material_coats.INNER)
_INTERNAL = wp.constant(material_coats.INTERNAL)
_GRAZING = wp.constant(material_coats.GRAZING)


@wp.func
def _step(x: wp.float32, width: wp.float32) -> wp.float32:
    """From 0 to 1 around x = 0."""
    return 0.5 + 0.5 * x / wp.sqrt(x * x + width * width)


@wp.func
def rough_transmittance(b: Bsdf, mu: wp.float32) -> wp.float32:
    """Share of light from outside at a cosine mu > 0 that a rough coat lets through: plastic_coat.py's fit."""
    eta = b.eta[0]
    alpha = clamped_alpha(b.alpha)[0]
    c = b.transmittance
    d = b.k
    value = wp.float32(0.0)
    if eta >= 1.0:
        p = mu / (mu + alpha)
        q = mu / (mu + 2.0 * alpha)
        a2 = alpha * alpha
        nu = wp.sqrt((mu * mu + a2) / (1.0 + a2))
        through = 1.0 - fresnel_dielectric(nu, eta).reflectance
        value = c[0] + q * (c[1] + q * c[2]) + through * (d[0] + p * (d[1] + p * d[2]))
    else:
        width = alpha * eta
        x = mu - wp.sqrt(1.0 - eta * eta)
        middle = _step(x, width)
        value = c[0] * (1.0 - fresnel_dielectric(mu, eta).reflectance) + middle * (c[1] + c[2] * mu)
        value = value + d[0] * _step(x, 3.0 * width) + d[1] * _step(x - width, width) + d[2] * _step(x + width, width)
    return wp.clamp(value, 0.0, 1.0)


@wp.func
def has_diffuse(b: Bsdf) -> bool:
    """Always: its base."""
    return True


@wp.func
def is_even(b: Bsdf) -> bool:
    """Where its coat is denser than what is around it: it lets through less of light that grazes it, at any angle."""
    return b.eta[0] > 1.0


@wp.func
def grazing_gain(b: Bsdf, w_from: wp.vec3) -> wp.float32:
    """Below zero: what scene loading has found of the coat."""
    return b.grazing_gain


@cache
def make_plastic(features: Features) -> LeafCode:
    """The code of PLASTIC."""
    value = make_parameters(features).value

    @wp.func
    def read(
        materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> Bsdf:
        b = Bsdf()
        b.kind = PLASTIC
        b.distribution = materials.distribution[node]
        b.specular = value(materials, textures, node, _SPECULAR, uv, color)
        b.color = value(materials, textures, node, _DIFFUSE, uv, color)
        inside = materials.value[node, _INTERNAL]
        b.eta = wp.vec3(materials.value[node, _ETA][0], inside[0], inside[2])
        alpha = materials.value[node, _ALPHA][0]
        b.alpha = wp.vec2(alpha, alpha)
        b.nonlinear = wp.int32(materials.value[node, _NONLINEAR][0])
        b.transmittance = materials.value[node, _OUTER]
        b.k = materials.value[node, _INNER]
        b.grazing_gain = materials.value[node, _GRAZING][0]
        return b

    @wp.func
    def transmittance(b: Bsdf, mu: wp.float32) -> wp.float32:
        """T of the page's head."""
        if wp.static(features.rough):
            if not is_smooth(b.alpha):
                return rough_transmittance(b, mu)
        return 1.0 - fresnel_dielectric(mu, b.eta[0]).reflectance

    @wp.func
    def of_base(b: Bsdf, scale: wp.float32) -> wp.vec3:
        """What the base makes of light that is scaled by how it crosses the coat."""
        inside = b.eta[1]
        scaled = scale / (b.eta[0] * b.eta[0])
        if b.nonlinear == 0:
            return b.color * (scaled / (1.0 - inside))
        return wp.cw_div(b.color * scaled, wp.vec3(1.0) - b.color * inside)

    @wp.func
    def eval_diffuse(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.vec3:
        if w_from[2] <= 0.0 or w_to[2] <= 0.0:
            return wp.vec3(0.0)
        return of_base(b, transmittance(b, w_from[2]) * transmittance(b, w_to[2]) * INV_PI)

    @wp.func
    def reflectance(b: Bsdf, w_from: wp.vec3) -> wp.vec3:
        return of_base(b, transmittance(b, w_from[2]) * b.eta[2])

    @wp.func
    def probability_diffuse(b: Bsdf, w_from: wp.vec3) -> wp.float32:
        """By the parts' reflectances: T times the mean of color against 1 - T times that of specular."""
        if w_from[2] <= 0.0:
            return 0.0
        through = transmittance(b, w_from[2])
        diffuse = through * (b.color[0] + b.color[1] + b.color[2])
        glossy = (1.0 - through) * (b.specular[0] + b.specular[1] + b.specular[2])
        if diffuse + glossy > 0.0:
            return diffuse / (diffuse + glossy)
        return 0.0

    @wp.func
    def eval_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, mode: wp.int32) -> wp.vec3:
        if wp.static(features.rough):
            if w_from[2] > 0.0 and w_to[2] > 0.0 and not is_smooth(b.alpha):
                alpha = clamped_alpha(b.alpha)
                m = wp.normalize(w_from + w_to)
                density = normal_density(b.distribution, alpha, m) * masking_over_cos(b.distribution, alpha, w_from)
                reflectance = fresnel_dielectric(wp.dot(w_from, m), b.eta[0]).reflectance
                return b.specular * (0.25 * density * reflectance * masking(b.distribution, alpha, w_to))
        return wp.vec3(0.0)

    @wp.func
    def pdf_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.float32:
        if wp.static(features.rough):
            if w_from[2] > 0.0 and w_to[2] > 0.0 and not is_smooth(b.alpha):
                alpha = clamped_alpha(b.alpha)
                density = normal_density(b.distribution, alpha, wp.normalize(w_from + w_to))
                return 0.25 * density * masking_over_cos(b.distribution, alpha, w_from)
        return 0.0

    @wp.func
    def sample_glossy(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
        s = BsdfSample()
        if w_from[2] <= 0.0:
            return s
        if wp.static(features.rough):
            if not is_smooth(b.alpha):
                alpha = clamped_alpha(b.alpha)
                m = sample_visible_normal(b.distribution, alpha, w_from, u)
                to = reflect(w_from, m)
                if to[2] > 0.0:
                    density = normal_density(b.distribution, alpha, m)
                    reflectance = fresnel_dielectric(wp.dot(w_from, m), b.eta[0]).reflectance
                    s.to = to
                    s.weight = b.specular * (reflectance * masking(b.distribution, alpha, to))
                    s.pdf = 0.25 * density * masking_over_cos(b.distribution, alpha, w_from)
                return s
        s.to = wp.vec3(-w_from[0], -w_from[1], w_from[2])
        s.weight = b.specular * fresnel_dielectric(w_from[2], b.eta[0]).reflectance
        s.delta = 1
        return s

    return LeafCode(
        int(PLASTIC),
        read,
        DiffusePart(has_diffuse, eval_diffuse, probability_diffuse, is_even, reflectance, grazing_gain),
        GlossyPart(sample_glossy, eval_glossy, pdf_glossy),
    )
