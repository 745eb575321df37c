"""Scattering functions of all leaf materials: dispatch by kind, compiled for the kinds that a scene has.

What each function takes and gives, here and in the module of each material (bsdf_types.py has directions and modes):

* `eval_diffuse(b, w_from, w_to) -> vec3`: diffuse part of the scattering function [1/sr], without the cosine.
* `eval_glossy(b, w_from, w_to, mode) -> vec3`: glossy part times |cos(w_to)|; deltas are left out.
* `pdf_glossy(b, w_from, w_to) -> float`: pdf_solid_angle with which `sample_glossy` makes w_to; deltas are left out.
* `sample_glossy(b, w_from, u_lobe, u, mode) -> BsdfSample`: a direction of the glossy part.
* `probability_diffuse(b, w_from) -> float`: share of `sample_all` that goes to the diffuse part.
* `eval_all(b, w_from, w_to, mode) -> vec3`: both parts times |cos(w_to)|; deltas are left out.
* `pdf_all(b, w_from, w_to) -> float`, `sample_all(b, w_from, u_lobe, u, mode) -> BsdfSample`: likewise for a direction
  of either part. The sample's weight is that of the part it came from, over the probability of choosing that part: it
  is right for paths that go different ways by part. `pdf` is over both parts.

u_lobe is in [0, 1), u in [0, 1]². A sample whose weight is zero ends the path; its direction may be the zero vector.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import warp as wp

from wdpm.kernels.constants import INV_PI, PI
from wdpm.kernels.features import Features
from wdpm.kernels.materials.conductor import make_conductor
from wdpm.kernels.materials.dielectric import make_dielectric, sample_pane
from wdpm.kernels.materials.plastic import make_plastic
from wdpm.kernels.materials.principled import make_principled
from wdpm.kernels.materials.types import (
    CONDUCTOR,
    DIELECTRIC,
    DIFFUSE,
    NULL,
    PLASTIC,
    PRINCIPLED,
    THIN_DIELECTRIC,
    Bsdf,
    BsdfSample,
)
from wdpm.kernels.maths.directions import concentric_disk

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


_BELOW_ONE = wp.constant(wp.float32(1 - 2.0**-24))


@wp.func
def cosine_direction(u: wp.vec2) -> wp.vec3:
    """A direction with pdf_solid_angle = cos / pi about z."""
    d = concentric_disk(u)
    return wp.vec3(d[0], d[1], wp.sqrt(wp.max(0.0, 1.0 - d[0] * d[0] - d[1] * d[1])))


@wp.func
def sample_straight(w_from: wp.vec3) -> BsdfSample:
    """NULL: on as if there were nothing."""
    s = BsdfSample()
    s.to = -w_from
    s.weight = wp.vec3(1.0)
    s.delta = 1
    s.straight = 1
    s.crosses = 1
    return s


@cache
def make_bsdf(features: Features) -> SimpleNamespace:
    """All functions of the page's head, for the kinds of materials that features name."""
    diffuse = _make_diffuse(features)
    glossy = _make_glossy(features)
    eval_diffuse = diffuse.eval_diffuse
    probability_diffuse = diffuse.probability_diffuse
    eval_glossy = glossy.eval_glossy
    pdf_glossy = glossy.pdf_glossy
    sample_glossy = glossy.sample_glossy

    @wp.func
    def eval_all(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, mode: wp.int32) -> wp.vec3:
        value = eval_diffuse(b, w_from, w_to) * wp.abs(w_to[2])
        if wp.static(features.glossy):
            value = value + eval_glossy(b, w_from, w_to, mode)
        return value

    @wp.func
    def pdf_all(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.float32:
        p = probability_diffuse(b, w_from)
        pdf = wp.float32(0.0)
        if w_to[2] > 0.0:
            pdf = p * (w_to[2] * INV_PI)
        if wp.static(features.glossy):
            if p < 1.0:
                pdf = pdf + (1.0 - p) * pdf_glossy(b, w_from, w_to)
        return pdf

    @wp.func
    def sample_all(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
        p = probability_diffuse(b, w_from)
        s = BsdfSample()
        if u_lobe < p or p == 1.0:
            s.to = cosine_direction(u)
            s.weight = b.color
            s.pdf = p * (s.to[2] * INV_PI)
            s.diffuse = 1
            if wp.static(features.plastic or features.principled):
                if b.kind != DIFFUSE:
                    s.weight = eval_diffuse(b, w_from, s.to) * (PI / p)
                    s.pdf = s.pdf + (1.0 - p) * pdf_glossy(b, w_from, s.to)
            return s
        if wp.static(features.glossy or features.passing):
            rest = 1.0 - p
            if rest > 0.0:
                s = sample_glossy(b, w_from, wp.min((u_lobe - p) / rest, _BELOW_ONE), u, mode)
                s.weight = s.weight / rest
                if s.delta == 0:
                    s.pdf = rest * s.pdf + p * (wp.max(s.to[2], 0.0) * INV_PI)
        return s

    return SimpleNamespace(**vars(diffuse), **vars(glossy), eval_all=eval_all, pdf_all=pdf_all, sample_all=sample_all)


def _make_diffuse(features: Features) -> SimpleNamespace:
    """Functions of the diffuse part."""
    plastic = make_plastic(features)
    principled = make_principled(features)
    eval_plastic = plastic.eval_diffuse
    eval_principled = principled.eval_diffuse
    probability_plastic = plastic.probability_diffuse
    probability_principled = principled.probability_diffuse

    @wp.func
    def has_diffuse(b: Bsdf) -> bool:
        """Photons are stored here, and gathered."""
        if b.kind == DIFFUSE:
            return True
        if wp.static(features.plastic):
            if b.kind == PLASTIC:
                return True
        if wp.static(features.principled):
            if b.kind == PRINCIPLED:
                return b.metallic < 1.0 and b.spec_trans < 1.0
        return False

    @wp.func
    def eval_diffuse(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.vec3:
        if w_from[2] > 0.0 and w_to[2] > 0.0:
            if b.kind == DIFFUSE:
                return b.color * INV_PI
            if wp.static(features.plastic):
                if b.kind == PLASTIC:
                    return eval_plastic(b, w_from, w_to)
            if wp.static(features.principled):
                if b.kind == PRINCIPLED:
                    return eval_principled(b, w_from, w_to)
        return wp.vec3(0.0)

    @wp.func
    def probability_diffuse(b: Bsdf, w_from: wp.vec3) -> wp.float32:
        if w_from[2] > 0.0:
            if b.kind == DIFFUSE:
                return 1.0
            if wp.static(features.plastic):
                if b.kind == PLASTIC:
                    return probability_plastic(b, w_from)
            if wp.static(features.principled):
                if b.kind == PRINCIPLED:
                    return probability_principled(b, w_from)
        return 0.0

    return SimpleNamespace(has_diffuse=has_diffuse, eval_diffuse=eval_diffuse, probability_diffuse=probability_diffuse)


def _make_glossy(features: Features) -> SimpleNamespace:
    """Functions of the glossy part."""
    conductor = make_conductor(features)
    dielectric = make_dielectric(features)
    plastic = make_plastic(features)
    principled = make_principled(features)
    eval_conductor, pdf_conductor = conductor.eval_glossy, conductor.pdf_glossy
    eval_dielectric, pdf_dielectric = dielectric.eval_glossy, dielectric.pdf_glossy
    eval_plastic, pdf_plastic = plastic.eval_glossy, plastic.pdf_glossy
    eval_principled, pdf_principled = principled.eval_glossy, principled.pdf_glossy
    sample_conductor, sample_dielectric = conductor.sample_glossy, dielectric.sample_glossy
    sample_plastic, sample_principled = plastic.sample_glossy, principled.sample_glossy

    @wp.func
    def eval_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, mode: wp.int32) -> wp.vec3:
        if wp.static(features.conductor):
            if b.kind == CONDUCTOR:
                return eval_conductor(b, w_from, w_to, mode)
        if wp.static(features.dielectric):
            if b.kind == DIELECTRIC:
                return eval_dielectric(b, w_from, w_to, mode)
        if wp.static(features.plastic):
            if b.kind == PLASTIC:
                return eval_plastic(b, w_from, w_to, mode)
        if wp.static(features.principled):
            if b.kind == PRINCIPLED:
                return eval_principled(b, w_from, w_to, mode)
        return wp.vec3(0.0)

    @wp.func
    def pdf_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.float32:
        if wp.static(features.conductor):
            if b.kind == CONDUCTOR:
                return pdf_conductor(b, w_from, w_to)
        if wp.static(features.dielectric):
            if b.kind == DIELECTRIC:
                return pdf_dielectric(b, w_from, w_to)
        if wp.static(features.plastic):
            if b.kind == PLASTIC:
                return pdf_plastic(b, w_from, w_to)
        if wp.static(features.principled):
            if b.kind == PRINCIPLED:
                return pdf_principled(b, w_from, w_to)
        return 0.0

    @wp.func
    def sample_glossy(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
        if wp.static(features.conductor):
            if b.kind == CONDUCTOR:
                return sample_conductor(b, w_from, u_lobe, u, mode)
        if wp.static(features.dielectric):
            if b.kind == DIELECTRIC:
                return sample_dielectric(b, w_from, u_lobe, u, mode)
        if wp.static(features.thin_dielectric):
            if b.kind == THIN_DIELECTRIC:
                return sample_pane(b, w_from, u_lobe)
        if wp.static(features.plastic):
            if b.kind == PLASTIC:
                return sample_plastic(b, w_from, u_lobe, u, mode)
        if wp.static(features.principled):
            if b.kind == PRINCIPLED:
                return sample_principled(b, w_from, u_lobe, u, mode)
        if wp.static(features.passing):
            if b.kind == NULL:
                return sample_straight(w_from)
        return BsdfSample()

    return SimpleNamespace(eval_glossy=eval_glossy, pdf_glossy=pdf_glossy, sample_glossy=sample_glossy)
