"""No surface at all: light goes straight on. The boundary of a medium, or a hole that a mask leaves."""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.leaf import GlossyPart, LeafCode
from wdpm.kernels.materials.nodes import Materials
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import NULL, Bsdf, BsdfSample

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def sample_straight(b: Bsdf, w_from: wp.vec3, u_lobe: wp.float32, u: wp.vec2, mode: wp.int32) -> BsdfSample:
    """On as if there were nothing."""
    s = BsdfSample()
    s.to = -w_from
    s.weight = wp.vec3(1.0)
    s.delta = 1
    s.straight = 1
    s.crosses = 1
    return s


@wp.func
def read(materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3) -> Bsdf:
    """It has no parameters."""
    b = Bsdf()
    b.kind = NULL
    return b


@functools.cache
def make_null(features: Features) -> LeafCode:
    """The code of NULL."""
    return LeafCode(int(NULL), read, glossy=GlossyPart(sample_straight))
