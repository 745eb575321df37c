"""Thin panes: two parallel interfaces that are one surface, with all reflections between them.

Same parameters as Mitsuba 3's `thindielectric`. Both sides scatter, in delta directions only.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.fresnel import pane_reflectance
from wdpm.kernels.materials.leaf import GlossyPart, LeafCode
from wdpm.kernels.materials.nodes import Materials, make_parameters
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import Bsdf, BsdfSample
from wdpm.scenes.model.bsdfs import ThinDielectric

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

THIN_DIELECTRIC = wp.constant(ThinDielectric.KIND.number)

_SPECULAR = wp.constant(ThinDielectric.KIND.slots["specular_reflectance"])
_TRANSMITTANCE = wp.constant(ThinDielectric.KIND.slots["specular_transmittance"])
_ETA = wp.constant(ThinDielectric.KIND.slots["eta"])


@wp.func
def sample_pane(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
    """A thin pane's mirror direction, or straight on; both delta."""
    s = BsdfSample()
    s.delta = 1
    if u_lobe < pane_reflectance(w_from[2], b.eta[0]):
        s.to = wp.vec3(-w_from[0], -w_from[1], w_from[2])
        s.weight = b.specular
    else:
        s.to = -w_from
        s.weight = b.transmittance
        s.straight = 1
        s.crosses = 1
    return s


@functools.cache
def make_thin_dielectric(features: Features) -> LeafCode:
    """The code of THIN_DIELECTRIC."""
    value = make_parameters(features).value

    @wp.func
    def read(
        materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> Bsdf:
        b = Bsdf()
        b.kind = THIN_DIELECTRIC
        b.distribution = materials.distribution[node]
        b.specular = value(materials, textures, node, _SPECULAR, uv, color)
        b.transmittance = value(materials, textures, node, _TRANSMITTANCE, uv, color)
        b.eta = materials.value[node, _ETA]
        return b

    @wp.func
    def straight(
        materials: wp.ref[Materials],
        textures: wp.ref[Textures],
        node: wp.int32,
        uv: wp.vec2,
        color: wp.vec3,
        cos_theta: wp.float32,
    ) -> wp.vec3:
        through = 1.0 - pane_reflectance(cos_theta, materials.value[node, _ETA][0])
        return value(materials, textures, node, _TRANSMITTANCE, uv, color) * through

    return LeafCode(int(THIN_DIELECTRIC), read, glossy=GlossyPart(sample_pane), straight=straight)
