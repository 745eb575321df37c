"""Translucent sheets: light that gets through leaves at the other side in all directions alike (0.6's `difftrans`).

Both sides scatter. The part is traced, like all that crosses a surface: gathers read photons of their own side alone.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.constants import INV_PI
from wdpm.kernels.features import Features
from wdpm.kernels.materials.leaf import GlossyPart, LeafCode
from wdpm.kernels.materials.nodes import Materials, make_parameters
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import Bsdf, BsdfSample
from wdpm.kernels.maths.directions import concentric_disk
from wdpm.scenes.model.bsdfs import Translucent

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TRANSLUCENT = wp.constant(Translucent.KIND.number)

_TRANSMITTANCE = wp.constant(Translucent.KIND.slots["transmittance"])


@wp.func
def eval_translucent(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, mode: wp.int32) -> wp.vec3:
    """Transmission times |cos(w_to)|."""
    return b.transmittance * pdf_translucent(b, w_from, w_to)


@wp.func
def pdf_translucent(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.float32:
    """Cosine over pi, on the other side."""
    if w_from[2] * w_to[2] < 0.0:
        return wp.abs(w_to[2]) * INV_PI
    return 0.0


@wp.func
def sample_translucent(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
    """A direction on the other side with pdf_solid_angle = cos / pi."""
    s = BsdfSample()
    d = concentric_disk(u)
    z = wp.sqrt(wp.max(0.0, 1.0 - d[0] * d[0] - d[1] * d[1]))
    s.to = wp.vec3(d[0], d[1], z)
    if w_from[2] > 0.0:
        s.to = wp.vec3(d[0], d[1], -z)
    s.weight = b.transmittance
    s.pdf = z * INV_PI
    s.crosses = 1
    return s


@functools.cache
def make_translucent(features: Features) -> LeafCode:
    """The code of TRANSLUCENT."""
    value = make_parameters(features).value

    @wp.func
    def read(
        materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> Bsdf:
        b = Bsdf()
        b.kind = TRANSLUCENT
        b.transmittance = value(materials, textures, node, _TRANSMITTANCE, uv, color)
        b.specular = b.transmittance  # what a layer of albedo shows
        return b

    return LeafCode(int(TRANSLUCENT), read, glossy=GlossyPart(sample_translucent, eval_translucent, pdf_translucent))
