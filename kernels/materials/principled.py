"""Mitsuba 3's `principled`: Disney's material with all of its parameters.

Sources: Burley 2012, "Physically Based Shading at Disney", and Burley 2015, "Extending the Disney BRDF to a BSDF with
Integrated Subsurface Scattering", in the form that Mitsuba 3.9 gives them (its clearcoat has no 1 / (4 cos cos), its
metal reflects nothing where eta is exactly 1, and its sheen needs some diffuse reflection).

Diffuse part, front only, where metallic < 1 and spec_trans < 1: see principled_base. Glossy part: the main microfacet
lobe (GGX), which reflects as a dielectric, tinted dielectric or metal, and transmits where spec_trans > 0; and the
clearcoat (GTR1, a Smith masking of alpha 1/4). The back scatters only where spec_trans > 0.

`alpha` is what Mitsuba derives from roughness and anisotropic:

    aspect = sqrt(1 - 0.9 anisotropic),  alpha = (max(1e-3, roughness² / aspect), max(1e-3, roughness² aspect))

eta[0] is the index inside over that outside; for Mitsuba's `specular` it is 2 / (1 - sqrt(0.08 specular)) - 1.
"""

from __future__ import annotations

import math
from functools import cache

import warp as wp

from wdpm.kernels.constants import INV_PI
from wdpm.kernels.features import Features
from wdpm.kernels.materials.fresnel import Interface, fresnel_dielectric, reflect, refract
from wdpm.kernels.materials.leaf import DiffusePart, GlossyPart, LeafCode
from wdpm.kernels.materials.microfacet import (
    clamped_alpha,
    masking,
    masking_over_cos,
    normal_density,
    sample_visible_normal,
)
from wdpm.kernels.materials.nodes import Materials, make_parameters
from wdpm.kernels.materials.principled_base import (
    brdf_share,
    eval_diffuse,
    grazing_gain,
    has_diffuse,
    is_even,
    reflectance_of_base,
    tint,
)
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import GGX, RADIANCE, Bsdf, BsdfSample
from wdpm.kernels.maths.elementary import log_of, pow_of, sincos_of
from wdpm.kernels.maths.schlick import schlick_weight
from wdpm.scenes.model.bsdfs import Principled

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

INDEX_STEP_LEAST = wp.constant(wp.float32(1e-3))
"""Least |eta - 1| of a transmitting material, which Mitsuba has at eta = 1, too.

Directions of float32 are off by 1e-7, and half vectors of transmission by that over |eta - 1|: 1e-4, a tenth of the
least alpha.
"""

PRINCIPLED = wp.constant(Principled.KIND.number)

_BASE_COLOR = wp.constant(Principled.KIND.slots["base_color"])
_ROUGHNESS = wp.constant(Principled.KIND.slots["roughness"])
_ETA = wp.constant(Principled.KIND.slots["eta"])
_ANISOTROPIC = wp.constant(Principled.KIND.slots["anisotropic"])
_METALLIC = wp.constant(Principled.KIND.slots["metallic"])
_SPEC_TRANS = wp.constant(Principled.KIND.slots["spec_trans"])
_SPEC_TINT = wp.constant(Principled.KIND.slots["spec_tint"])
_SHEEN = wp.constant(Principled.KIND.slots["sheen"])
_SHEEN_TINT = wp.constant(Principled.KIND.slots["sheen_tint"])
_FLATNESS = wp.constant(Principled.KIND.slots["flatness"])
_CLEARCOAT = wp.constant(Principled.KIND.slots["clearcoat"])
_CLEARCOAT_GLOSS = wp.constant(Principled.KIND.slots["clearcoat_gloss"])
_LAYERED = wp.constant(Principled.KIND.slots["layered"])

_ALPHA_LEAST = wp.constant(wp.float32(1e-3))
_TWO_PI = wp.constant(wp.float32(2 * math.pi))
_COAT_ALPHA = wp.constant(wp.vec2(0.25, 0.25))  # of the clearcoat's masking
_COAT_F0 = wp.constant(wp.float32(0.04))
_COAT_MATT = wp.constant(wp.float32(0.1))  # its alpha at clearcoat_gloss 0
_COAT_GLOSSY = wp.constant(wp.float32(0.001))  # and at 1
_SHEEN_SHARE = wp.constant(wp.float32(0.1))  # of what full sheen reflects, roughly
# Least estimate of what the glossy part reflects: what is mirrored is often brighter than what lights the diffuse part.
_GLOSSY_LEAST = wp.constant(wp.float32(0.1))
_COAT_SHARE = wp.constant(wp.float32(0.25))  # strength, and weight in sampling, at clearcoat 1
_JACOBIAN_LEAST = wp.constant(wp.float32(1e-20))


@wp.struct
class Lobes:
    """Value (times |cos(w_to)|) and pdf_solid_angle of the glossy part."""

    value: wp.vec3
    pdf: wp.float32


@wp.func
def bsdf_share(b: Bsdf) -> wp.float32:
    """Strength of the transmission."""
    return (1.0 - b.metallic) * b.spec_trans


@wp.func
def clamped_eta(b: Bsdf) -> wp.float32:
    """eta, kept away from 1 where light is transmitted."""
    eta = b.eta[0]
    if bsdf_share(b) > 0.0 and wp.abs(eta - 1.0) < INDEX_STEP_LEAST:
        if eta < 1.0:
            return 1.0 - INDEX_STEP_LEAST
        return 1.0 + INDEX_STEP_LEAST
    return eta


@wp.func
def probability_diffuse(b: Bsdf, w_from: wp.vec3) -> wp.float32:
    """By estimates of what the parts reflect, in the channel that reflects most, so that no weight is far above 1.

    Mitsuba picks half and half, whatever they reflect, and weights a direction by both parts. Here it has the weight of
    one alone, and with half and half that of white walls doubles: over many walls, without end.
    """
    share = brdf_share(b)
    if w_from[2] <= 0.0 or share <= 0.0:
        return 0.0
    grazing = schlick_weight(w_from[2])
    most = wp.max(b.color)
    diffuse = share * most
    if b.layered == 0.0:
        diffuse = diffuse * (1.0 + grazing * (b.roughness - 0.5))
    diffuse = diffuse + _SHEEN_SHARE * b.sheen * (1.0 - b.metallic)
    root = (b.eta[0] - 1.0) / (b.eta[0] + 1.0)
    head_on = (1.0 - b.metallic) * root * root + b.metallic * most
    # towards grazing angles the reflection of rough surfaces grows less than that of smooth ones (Lagarde 2011)
    glossy = head_on + wp.max(1.0 - b.roughness - head_on, 0.0) * grazing
    glossy = glossy + bsdf_share(b) * wp.sqrt(most) * (1.0 - glossy)
    glossy = glossy + b.clearcoat * (_COAT_F0 + (1.0 - _COAT_F0) * grazing)
    return diffuse / (diffuse + wp.max(glossy, _GLOSSY_LEAST))


@wp.func
def probability_coat(b: Bsdf, front: bool) -> wp.float32:
    """Share of the clearcoat in samples of the glossy part."""
    if not front:
        return 0.0
    weight = _COAT_SHARE * b.clearcoat
    return weight / (1.0 + weight)


@wp.func
def probability_transmission(b: Bsdf, reflectance: wp.float32, front: bool) -> wp.float32:
    """Share of transmission at a facet of the main lobe: by what is transmitted there and what is reflected.

    Mitsuba reflects all samples that are not transmitted, also those that stand for light that the diffuse part has:
    of a surface that is glass by half every other sample, for the few per cent that Fresnel's formulas reflect.

    Args:
        reflectance: Fresnel's, at the facet.
    """
    if not front:
        return 1.0 - reflectance
    share = bsdf_share(b)
    through = share * (1.0 - reflectance)
    if share > 0.0 and share < 1.0:
        most = wp.max(b.color)
        through = through * wp.sqrt(most)
        # a tinted reflection is brighter than Fresnel's where the colour is deep: as bright, in one channel, as it is
        back = (1.0 - b.metallic) * reflectance + b.metallic * (most + (1.0 - most) * reflectance)
        if through > 0.0:
            through = through / (through + back)
    return through


@wp.func
def coat_alpha(b: Bsdf) -> wp.float32:
    """Roughness of the clearcoat."""
    return _COAT_MATT + b.clearcoat_gloss * (_COAT_GLOSSY - _COAT_MATT)


@wp.func
def coat_density(alpha: wp.float32, m: wp.vec3) -> wp.float32:
    """GTR1 (Burley 2012, equation 4, gamma = 1) [1/sr], for m.z > 0."""
    a2 = alpha * alpha
    # 1 + (a2 - 1) cos² without cancellation.
    spread = m[0] * m[0] + m[1] * m[1] + a2 * m[2] * m[2]
    return (a2 - 1.0) * INV_PI / (log_of(a2) * spread)


@wp.func
def sample_coat_normal(alpha: wp.float32, u: wp.vec2) -> wp.vec3:
    """A normal with pdf_solid_angle = density times cos (Burley 2012, appendix B.2)."""
    a2 = alpha * alpha
    c2 = wp.clamp((1.0 - pow_of(a2, 1.0 - u[1])) / (1.0 - a2), 0.0, 1.0)
    s = wp.sqrt(1.0 - c2)
    sc = sincos_of(_TWO_PI * u[0])
    return wp.vec3(s * sc[1], s * sc[0], wp.sqrt(c2))


@wp.func
def schlick(f0: wp.vec3, weight: wp.float32) -> wp.vec3:
    """From f0 at normal incidence to white at grazing."""
    return f0 + (wp.vec3(1.0) - f0) * weight


@wp.func
def main_reflectance(b: Bsdf, eta: wp.float32, at: Interface, weight: wp.float32, front: bool) -> wp.vec3:
    """Colour of the main lobe's reflection at a facet: dielectric, tinted dielectric and metal mixed.

    Args:
        weight: Schlick's at the facet.
    """
    if not front:
        return wp.vec3(bsdf_share(b) * at.reflectance)
    value = wp.vec3((1.0 - b.metallic) * (1.0 - b.spec_tint) * at.reflectance)
    if b.metallic > 0.0:
        value = value + schlick(b.color, weight) * b.metallic
    if b.spec_tint > 0.0:
        root = (eta - 1.0) / (eta + 1.0)
        value = value + schlick(tint(b.color) * (root * root), weight) * ((1.0 - b.metallic) * b.spec_tint)
    return value


@wp.func(inline=False)  # evaluated, and sampled in two ways
def reflected(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, m: wp.vec3) -> Lobes:
    """Reflection at facets with a normal m (m.z > 0), for directions on one side."""
    s = Lobes()
    front = w_from[2] > 0.0
    c = wp.dot(w_from, m)
    if c * w_from[2] <= 0.0 or wp.dot(w_to, m) * w_to[2] <= 0.0:
        return s
    eta = clamped_eta(b)
    alpha = clamped_alpha(b.alpha)
    at = fresnel_dielectric(c, eta)
    weight = schlick_weight(wp.abs(c))
    if eta <= 1.0:
        weight = schlick_weight(wp.abs(at.cos_to))
    coat = probability_coat(b, front)
    seen = 0.25 * normal_density(GGX, alpha, m) * masking_over_cos(GGX, alpha, w_from)
    s.pdf = (1.0 - coat) * (1.0 - probability_transmission(b, at.reflectance, front)) * seen
    if at.reflectance > 0.0:
        s.value = main_reflectance(b, eta, at, weight, front) * (seen * masking(GGX, alpha, w_to))
    if coat > 0.0:
        density = coat_density(coat_alpha(b), m)
        s.pdf = s.pdf + coat * density * m[2] / (4.0 * c)
        reflectance = _COAT_F0 + (1.0 - _COAT_F0) * weight
        shadowing = masking(GGX, _COAT_ALPHA, w_from) * masking(GGX, _COAT_ALPHA, w_to)
        s.value = s.value + wp.vec3(_COAT_SHARE * b.clearcoat * reflectance * density * shadowing * w_to[2])
    return s


@wp.func
def transmitted(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, mode: wp.int32) -> Lobes:
    """Transmission, for directions on either side (Walter et al. 2007, equations 16, 17 and 21)."""
    s = Lobes()
    share = bsdf_share(b)
    if share <= 0.0:
        return s
    front = w_from[2] > 0.0
    eta = clamped_eta(b)
    index = wp.float32(eta)
    if not front:
        index = 1.0 / eta
    m = wp.normalize(w_from + w_to * index)
    if m[2] < 0.0:
        m = -m
    c_from = wp.dot(w_from, m)
    c_to = wp.dot(w_to, m)
    if c_from * w_from[2] <= 0.0 or c_to * w_to[2] <= 0.0:
        return s
    alpha = clamped_alpha(b.alpha)
    reflectance = fresnel_dielectric(c_from, eta).reflectance
    root = c_from + index * c_to
    jacobian = index * index * wp.abs(c_from * c_to) / wp.max(root * root, _JACOBIAN_LEAST)
    seen = normal_density(GGX, alpha, m) * masking_over_cos(GGX, alpha, w_from) * jacobian
    coat = probability_coat(b, front)
    s.pdf = (1.0 - coat) * probability_transmission(b, reflectance, front) * seen
    scale = share * (1.0 - reflectance) * seen * masking(GGX, alpha, w_to)
    if mode == RADIANCE:
        scale = scale / (index * index)
    s.value = transmission_color(b) * scale
    return s


@wp.func
def transmission_color(b: Bsdf) -> wp.vec3:
    """The root of the base colour: light crosses two interfaces."""
    return wp.vec3(wp.sqrt(b.color[0]), wp.sqrt(b.color[1]), wp.sqrt(b.color[2]))


@wp.func
def glossy_lobes(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, mode: wp.int32) -> Lobes:
    """The whole glossy part for two directions."""
    sides = w_from[2] * w_to[2]
    if sides > 0.0 and (w_from[2] > 0.0 or bsdf_share(b) > 0.0):
        m = wp.normalize(w_from + w_to)
        if m[2] < 0.0:
            m = -m
        return reflected(b, w_from, w_to, m)
    if sides < 0.0:
        return transmitted(b, w_from, w_to, mode)
    return Lobes()


@wp.func
def eval_disney_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, mode: wp.int32) -> wp.vec3:
    """The glossy part times |cos(w_to)|."""
    return glossy_lobes(b, w_from, w_to, mode).value


@wp.func
def pdf_disney_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.float32:
    """pdf_solid_angle with which `sample_disney_glossy` makes w_to."""
    return glossy_lobes(b, w_from, w_to, RADIANCE).pdf


@wp.func
def sample_disney_glossy(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
    """The clearcoat, reflection or transmission. Light that a facet sends to the wrong side is lost."""
    s = BsdfSample()
    front = w_from[2] > 0.0
    share = bsdf_share(b)
    if w_from[2] == 0.0 or (not front and share <= 0.0):
        return s
    coat = probability_coat(b, front)
    if u_lobe < coat:
        return sample_reflected(b, w_from, sample_coat_normal(coat_alpha(b), u))
    alpha = clamped_alpha(b.alpha)
    above = w_from
    if not front:
        above = -w_from
    m = sample_visible_normal(GGX, alpha, above, u)
    eta = clamped_eta(b)
    at = fresnel_dielectric(wp.dot(w_from, m), eta)
    transmission = probability_transmission(b, at.reflectance, front)
    if (u_lobe - coat) / (1.0 - coat) >= transmission:
        return sample_reflected(b, w_from, m)
    to = refract(w_from, m, at)
    if to[2] * w_from[2] < 0.0:
        # Value over pdf: all that depends on the half vector cancels, but for the reflectance.
        scale = masking(GGX, alpha, to) / (1.0 - coat)
        scale = scale * (share * (1.0 - at.reflectance) / transmission)
        if mode == RADIANCE:
            scale = scale * at.ratio * at.ratio
        s.to = to
        s.weight = transmission_color(b) * scale
        s.pdf = transmitted(b, w_from, to, mode).pdf
        s.crosses = 1
    return s


@wp.func
def sample_reflected(b: Bsdf, w_from: wp.vec3, m: wp.vec3) -> BsdfSample:
    """The reflection of w_from at a facet, weighted by all lobes that reflect there."""
    s = BsdfSample()
    to = reflect(w_from, m)
    if to[2] * w_from[2] > 0.0:
        lobes = reflected(b, w_from, to, m)
        if lobes.pdf > 0.0:
            s.to = to
            s.weight = lobes.value / lobes.pdf
            s.pdf = lobes.pdf
    return s


@wp.func
def principled_alpha(roughness: wp.float32, anisotropic: wp.float32) -> wp.vec2:
    """Roughness of microfacets along the tangents (Burley 2012, section 5.4)."""
    squared = roughness * roughness
    aspect = wp.sqrt(1.0 - 0.9 * wp.clamp(anisotropic, 0.0, 1.0))
    return wp.vec2(wp.max(squared / aspect, _ALPHA_LEAST), wp.max(squared * aspect, _ALPHA_LEAST))


@cache
def make_principled(features: Features) -> LeafCode:
    """The code of PRINCIPLED."""
    value, number = make_parameters(features).value, make_parameters(features).number

    @wp.func
    def read(
        materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> Bsdf:
        b = Bsdf()
        b.kind = PRINCIPLED
        b.distribution = materials.distribution[node]
        b.color = value(materials, textures, node, _BASE_COLOR, uv, color)
        b.specular = b.color  # what a layer of albedo shows of a metal
        b.roughness = number(materials, textures, node, _ROUGHNESS, uv, color)
        b.eta = materials.value[node, _ETA]
        b.alpha = principled_alpha(b.roughness, number(materials, textures, node, _ANISOTROPIC, uv, color))
        b.metallic = number(materials, textures, node, _METALLIC, uv, color)
        b.spec_trans = number(materials, textures, node, _SPEC_TRANS, uv, color)
        b.spec_tint = number(materials, textures, node, _SPEC_TINT, uv, color)
        b.sheen = number(materials, textures, node, _SHEEN, uv, color)
        b.sheen_tint = number(materials, textures, node, _SHEEN_TINT, uv, color)
        b.flatness = number(materials, textures, node, _FLATNESS, uv, color)
        b.clearcoat = number(materials, textures, node, _CLEARCOAT, uv, color)
        b.clearcoat_gloss = number(materials, textures, node, _CLEARCOAT_GLOSS, uv, color)
        b.layered = materials.value[node, _LAYERED][0]
        return b

    return LeafCode(
        int(PRINCIPLED),
        read,
        DiffusePart(has_diffuse, eval_diffuse, probability_diffuse, is_even, reflectance_of_base, grazing_gain),
        GlossyPart(sample_disney_glossy, eval_disney_glossy, pdf_disney_glossy),
    )
