"""Scattering functions of all leaf materials: dispatch by kind, compiled for the kinds that a scene has.

What each function takes and gives, here and in the module of each material (types.py has directions and modes):

* `eval_diffuse(b, w_from, w_to) -> vec3`: diffuse part of the scattering function [1/sr], without the cosine.
* `is_even(b) -> bool`: whether irradiance, and how much it grazes, tell what the diffuse part reflects.
* `reflectance(b, w_from) -> vec3`: what it reflects of light that arrives alike from all sides, over its radiance.
* `grazing_gain(b, w_from) -> float`: by what share of that it reflects more for each unit by which light grazes more.
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

from dataclasses import dataclass
from functools import cache

import warp as wp

from wdpm.kernels.constants import INV_PI, PI
from wdpm.kernels.features import Features
from wdpm.kernels.materials.leaf import DiffusePart
from wdpm.kernels.materials.leaves import leaves_of
from wdpm.kernels.materials.types import DIFFUSE, Bsdf, BsdfSample
from wdpm.kernels.maths.directions import concentric_disk

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


_BELOW_ONE = wp.constant(wp.float32(1 - 2.0**-24))


@dataclass(frozen=True, eq=False)
class BsdfCode:
    """Scattering functions for the leaves of some features: those of the page's head, and `has_diffuse(b) -> bool`."""

    has_diffuse: wp.Function
    eval_diffuse: wp.Function
    probability_diffuse: wp.Function
    is_even: wp.Function
    reflectance: wp.Function
    grazing_gain: wp.Function
    eval_glossy: wp.Function
    pdf_glossy: wp.Function
    sample_glossy: wp.Function
    eval_all: wp.Function
    pdf_all: wp.Function
    sample_all: wp.Function


@wp.func
def cosine_direction(u: wp.vec2) -> wp.vec3:
    """A direction with pdf_solid_angle = cos / pi about z."""
    d = concentric_disk(u)
    return wp.vec3(d[0], d[1], wp.sqrt(wp.max(0.0, 1.0 - d[0] * d[0] - d[1] * d[1])))


@cache
def make_bsdf(features: Features) -> BsdfCode:
    """All functions of the page's head, for the kinds of materials that features name."""
    diffuse = _make_diffuse(features)
    eval_diffuse = diffuse.eval_diffuse
    probability_diffuse = diffuse.probability_diffuse
    eval_glossy, pdf_glossy, sample_glossy = _make_glossy(features)

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
            if wp.static(features.non_lambertian):
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

    return BsdfCode(
        diffuse.has_diffuse,
        eval_diffuse,
        probability_diffuse,
        diffuse.is_even,
        diffuse.reflectance,
        diffuse.grazing_gain or _gain_none,
        eval_glossy,
        pdf_glossy,
        sample_glossy,
        eval_all,
        pdf_all,
        sample_all,
    )


def _make_diffuse(features: Features) -> DiffusePart:
    """Functions of the diffuse part: each leaf's own, by kind."""
    has, evaluate, probability = _has_none, _eval_none, _probability_none
    even, reflected, gain = _has_none, _reflectance_none, _gain_none
    for leaf in reversed(leaves_of(features)):
        part = leaf.diffuse
        if part is not None:
            has = _has_of(leaf.kind, part.has_diffuse, has)
            evaluate = _eval_diffuse_of(leaf.kind, part.eval_diffuse, evaluate)
            probability = _probability_of(leaf.kind, part.probability_diffuse, probability)
            even = _has_of(leaf.kind, part.is_even, even)
            reflected = _reflectance_of(leaf.kind, part.reflectance, reflected)
            if part.grazing_gain is not None:
                gain = _probability_of(leaf.kind, part.grazing_gain, gain)

    @wp.func
    def eval_diffuse(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.vec3:
        if w_from[2] > 0.0 and w_to[2] > 0.0:
            return evaluate(b, w_from, w_to)
        return wp.vec3(0.0)

    @wp.func
    def probability_diffuse(b: Bsdf, w_from: wp.vec3) -> wp.float32:
        if w_from[2] > 0.0:
            return probability(b, w_from)
        return 0.0

    @wp.func
    def reflectance(b: Bsdf, w_from: wp.vec3) -> wp.vec3:
        if w_from[2] > 0.0:
            return reflected(b, w_from)
        return wp.vec3(0.0)

    @wp.func
    def grazing_gain(b: Bsdf, w_from: wp.vec3) -> wp.float32:
        if w_from[2] > 0.0:
            return gain(b, w_from)
        return 0.0

    return DiffusePart(has, eval_diffuse, probability_diffuse, even, reflectance, grazing_gain)


def _make_glossy(features: Features) -> tuple[wp.Function, wp.Function, wp.Function]:
    """`eval_glossy`, `pdf_glossy` and `sample_glossy`: each leaf's own, by kind."""
    evaluate, pdf, sample = _eval_glossy_none, _pdf_none, _sample_none
    for leaf in reversed(leaves_of(features)):
        part = leaf.glossy
        if part is not None:
            sample = _sample_of(leaf.kind, part.sample_glossy, sample)
            if part.eval_glossy is not None and part.pdf_glossy is not None:
                evaluate = _eval_glossy_of(leaf.kind, part.eval_glossy, evaluate)
                pdf = _pdf_of(leaf.kind, part.pdf_glossy, pdf)
    return evaluate, pdf, sample


# Of a leaf without the part. Each function below is as `others`, with one more kind of leaf.


@wp.func
def _has_none(b: Bsdf) -> bool:
    return False


@wp.func
def _eval_none(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.vec3:
    return wp.vec3(0.0)


@wp.func
def _probability_none(b: Bsdf, w_from: wp.vec3) -> wp.float32:
    return 0.0


@wp.func
def _reflectance_none(b: Bsdf, w_from: wp.vec3) -> wp.vec3:
    return wp.vec3(0.0)


@wp.func
def _gain_none(b: Bsdf, w_from: wp.vec3) -> wp.float32:
    return 0.0


@wp.func
def _eval_glossy_none(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, mode: wp.int32) -> wp.vec3:
    return wp.vec3(0.0)


@wp.func
def _pdf_none(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.float32:
    return 0.0


@wp.func
def _sample_none(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
    return BsdfSample()


def _has_of(kind: int, own: wp.Function, others: wp.Function) -> wp.Function:
    """Of has_diffuse and is_even."""

    @wp.func
    def has(b: Bsdf) -> bool:
        if b.kind == kind:
            return own(b)
        return others(b)

    return has


def _reflectance_of(kind: int, own: wp.Function, others: wp.Function) -> wp.Function:
    @wp.func
    def reflectance(b: Bsdf, w_from: wp.vec3) -> wp.vec3:
        if b.kind == kind:
            return own(b, w_from)
        return others(b, w_from)

    return reflectance


def _eval_diffuse_of(kind: int, own: wp.Function, others: wp.Function) -> wp.Function:
    @wp.func
    def eval_diffuse(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.vec3:
        if b.kind == kind:
            return own(b, w_from, w_to)
        return others(b, w_from, w_to)

    return eval_diffuse


def _probability_of(kind: int, own: wp.Function, others: wp.Function) -> wp.Function:
    @wp.func
    def probability_diffuse(b: Bsdf, w_from: wp.vec3) -> wp.float32:
        if b.kind == kind:
            return own(b, w_from)
        return others(b, w_from)

    return probability_diffuse


def _eval_glossy_of(kind: int, own: wp.Function, others: wp.Function) -> wp.Function:
    @wp.func
    def eval_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, mode: wp.int32) -> wp.vec3:
        if b.kind == kind:
            return own(b, w_from, w_to, mode)
        return others(b, w_from, w_to, mode)

    return eval_glossy


def _pdf_of(kind: int, own: wp.Function, others: wp.Function) -> wp.Function:
    @wp.func
    def pdf_glossy(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.float32:
        if b.kind == kind:
            return own(b, w_from, w_to)
        return others(b, w_from, w_to)

    return pdf_glossy


def _sample_of(kind: int, own: wp.Function, others: wp.Function) -> wp.Function:
    @wp.func
    def sample_glossy(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
        if b.kind == kind:
            return own(b, w_from, u_lobe, u, mode)
        return others(b, w_from, u_lobe, u, mode)

    return sample_glossy
