"""Rough panes: microfacets that reflect, or let light through to the mirror image of where they would reflect it.

The specular lobes of Mitsuba 3's `principledthin`, after Burley 2015, "Extending the Disney BRDF to a BSDF with
Integrated Subsurface Scattering", section 4: a sheet does not bend light, but its two interfaces blur it, less so than
a reflection does: roughness is scaled by 0.65 eta - 0.35, or as glTF wants it. Both sides scatter alike.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.fresnel import fresnel_dielectric, reflect
from wdpm.kernels.materials.leaf import GlossyPart, LeafCode
from wdpm.kernels.materials.microfacet import (
    clamped_alpha,
    masking,
    masking_over_cos,
    normal_density,
    sample_visible_normal,
)
from wdpm.kernels.materials.nodes import Materials, make_parameters
from wdpm.kernels.materials.principled import principled_alpha, schlick
from wdpm.kernels.materials.principled_base import tint
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import GGX, Bsdf, BsdfSample
from wdpm.kernels.maths.schlick import schlick_weight
from wdpm.scenes.model.bsdfs import RoughPane

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ROUGH_PANE = wp.constant(RoughPane.KIND.number)

_BASE_COLOR = wp.constant(RoughPane.KIND.slots["base_color"])
_ROUGHNESS = wp.constant(RoughPane.KIND.slots["roughness"])
_ANISOTROPIC = wp.constant(RoughPane.KIND.slots["anisotropic"])
_ETA = wp.constant(RoughPane.KIND.slots["eta"])
_SPEC_TINT = wp.constant(RoughPane.KIND.slots["spec_tint"])
_BLUR = wp.constant(RoughPane.KIND.slots["blur"])

_LEAST_SHARE = wp.constant(wp.float32(0.05))
"""Of samples that reflect, and of those that do not."""

_NEXT_TO_NOTHING = wp.constant(wp.float32(1e-6))


@wp.struct
class PaneLobe:
    """Value (times |cos(w_to)|) over pdf_solid_angle, and the latter, of one of the two lobes."""

    weight: wp.vec3
    pdf: wp.float32


@wp.func
def pane_alpha(b: Bsdf) -> wp.vec2:
    """Roughness of transmission along the tangents, which takes the place of `k` in a pane."""
    return wp.vec2(b.k[0], b.k[1])


@wp.func
def turned(w: wp.vec3, like: wp.vec3) -> wp.vec3:
    """A direction seen from the side of another: both sides are alike."""
    if like[2] < 0.0:
        return -w
    return w


@wp.func
def pane_reflection(b: Bsdf, c: wp.float32) -> wp.vec3:
    """Colour of reflection at a facet; c: cosine to its normal."""
    at = fresnel_dielectric(c, b.eta[0])
    value = wp.vec3(at.reflectance)
    if b.spec_tint > 0.0:
        weight = schlick_weight(c)
        if b.eta[0] <= 1.0:
            weight = schlick_weight(wp.abs(at.cos_to))
        root = (b.eta[0] - 1.0) / (b.eta[0] + 1.0)
        value = value + (schlick(tint(b.color) * (root * root), weight) - value) * b.spec_tint
    return value


@wp.func
def share_reflected(b: Bsdf, w_from: wp.vec3) -> wp.float32:
    """Share of samples that reflect: by what the lobes reflect and let through, but neither none nor all.

    Told at one facet for all of them: light that grazes a rough pane meets facets that lean towards it, which reflect
    far less than a flat pane does (as scenes.flat.plastic_coat has it).
    """
    mu = wp.abs(w_from[2])
    alpha2 = wp.min(b.alpha[0] * b.alpha[1], 1.0)
    c = wp.sqrt((mu * mu + alpha2) / (1.0 + alpha2))
    back = wp.max(pane_reflection(b, c))
    through = wp.max(b.color) * (1.0 - fresnel_dielectric(c, b.eta[0]).reflectance)
    return _LEAST_SHARE + (1.0 - 2.0 * _LEAST_SHARE) * back / (back + wp.max(through, _NEXT_TO_NOTHING))


@wp.func
def pane_lobe(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> PaneLobe:
    """The lobe that leads from one direction to the other."""
    s = PaneLobe()
    if w_from[2] == 0.0 or w_to[2] == 0.0:
        return s
    start = turned(w_from, w_from)
    to = turned(w_to, w_from)
    p = share_reflected(b, w_from)
    crosses = to[2] < 0.0
    alpha = b.alpha
    mirrored = to
    if crosses:
        p = 1.0 - p
        alpha = pane_alpha(b)
        mirrored = wp.vec3(to[0], to[1], -to[2])
    m = wp.normalize(start + mirrored)
    if crosses and wp.dot(to, m) >= 0.0:
        return s
    alpha = clamped_alpha(alpha)
    c = wp.dot(start, m)
    color = pane_reflection(b, c)
    if crosses:
        color = b.color * (1.0 - fresnel_dielectric(c, b.eta[0]).reflectance)
    s.weight = color * (masking(GGX, alpha, to) / p)
    s.pdf = p * 0.25 * normal_density(GGX, alpha, m) * masking_over_cos(GGX, alpha, start)
    return s


@wp.func
def eval_pane(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, mode: wp.int32) -> wp.vec3:
    """Both lobes times |cos(w_to)|."""
    lobe = pane_lobe(b, w_from, w_to)
    return lobe.weight * lobe.pdf


@wp.func
def pdf_pane(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.float32:
    """pdf_solid_angle with which `sample_rough_pane` makes w_to."""
    return pane_lobe(b, w_from, w_to).pdf


@wp.func
def sample_rough_pane(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
    """A reflection, or its mirror image on the other side. Light that a facet sends to the wrong side is lost."""
    s = BsdfSample()
    if w_from[2] == 0.0:
        return s
    alpha = b.alpha
    crosses = u_lobe >= share_reflected(b, w_from)
    if crosses:
        alpha = pane_alpha(b)
    start = turned(w_from, w_from)
    to = reflect(start, sample_visible_normal(GGX, clamped_alpha(alpha), start, u))
    if to[2] > 0.0:
        if crosses:
            to = wp.vec3(to[0], to[1], -to[2])
        to = turned(to, w_from)
        lobe = pane_lobe(b, w_from, to)
        if lobe.pdf > 0.0:
            s.to = to
            s.weight = lobe.weight
            s.pdf = lobe.pdf
            s.crosses = wp.int32(crosses)
    return s


@functools.cache
def make_rough_pane(features: Features) -> LeafCode:
    """The code of ROUGH_PANE."""
    value, number = make_parameters(features).value, make_parameters(features).number

    @wp.func
    def read(
        materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> Bsdf:
        b = Bsdf()
        b.kind = ROUGH_PANE
        b.distribution = GGX
        b.color = value(materials, textures, node, _BASE_COLOR, uv, color)
        b.specular = b.color  # what a layer of albedo shows
        b.roughness = number(materials, textures, node, _ROUGHNESS, uv, color)
        eta = wp.max(number(materials, textures, node, _ETA, uv, color), 1.0e-3)
        b.eta = wp.vec3(eta)
        anisotropic = number(materials, textures, node, _ANISOTROPIC, uv, color)
        b.alpha = principled_alpha(b.roughness, anisotropic)
        blur = materials.value[node, _BLUR][0]
        if blur == 0.0:
            blur = 0.65 * eta - 0.35
        through = principled_alpha(blur * b.roughness, anisotropic)
        b.k = wp.vec3(through[0], through[1], 0.0)
        b.spec_tint = number(materials, textures, node, _SPEC_TINT, uv, color)
        return b

    return LeafCode(int(ROUGH_PANE), read, glossy=GlossyPart(sample_rough_pane, eval_pane, pdf_pane))
