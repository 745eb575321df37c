"""Lambertian reflection: all of it is gathered. The back is black."""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.constants import INV_PI
from wdpm.kernels.features import Features
from wdpm.kernels.materials.leaf import DiffusePart, LeafCode
from wdpm.kernels.materials.nodes import Materials, make_parameters
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import DIFFUSE, Bsdf
from wdpm.scenes.model.bsdfs import Diffuse

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_REFLECTANCE = wp.constant(Diffuse.KIND.slots["reflectance"])


@wp.func
def has_diffuse(b: Bsdf) -> bool:
    """Always."""
    return True


@wp.func
def eval_diffuse(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.vec3:
    """Alike in all directions [1/sr]."""
    return b.color * INV_PI


@wp.func
def probability_diffuse(b: Bsdf, w_from: wp.vec3) -> wp.float32:
    """There is nothing else."""
    return 1.0


@wp.func
def is_even(b: Bsdf) -> bool:
    """Exactly."""
    return True


@wp.func
def reflectance(b: Bsdf, w_from: wp.vec3) -> wp.vec3:
    """The albedo."""
    return b.color


@functools.cache
def make_diffuse(features: Features) -> LeafCode:
    """The code of DIFFUSE."""
    value = make_parameters(features).value

    @wp.func
    def read(
        materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> Bsdf:
        b = Bsdf()
        b.kind = DIFFUSE
        b.color = value(materials, textures, node, _REFLECTANCE, uv, color)
        return b

    part = DiffusePart(has_diffuse, eval_diffuse, probability_diffuse, is_even, reflectance)
    return LeafCode(int(DIFFUSE), read, part)
