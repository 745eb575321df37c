"""Leaves of materials with their parameters read at a point."""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.nodes import Materials, make_parameters
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import (
    BLACK,
    CONDUCTOR,
    DIELECTRIC,
    DIFFUSE,
    NULL,
    PLASTIC,
    PRINCIPLED,
    THIN_DIELECTRIC,
    Bsdf,
)
from wdpm.scenes.flat import material_coats

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Static conditions prune only where they stand alone.
# ruff: noqa: SIM109

_SPECULAR_LEAST = wp.constant(wp.float32(1e-3))  # alpha of PRINCIPLED
_OUTER = wp.constant(material_coats.OUTER)
_INNER = wp.constant(material_coats.INNER)
_INTERNAL = wp.constant(material_coats.INTERNAL)


@wp.func
def principled_alpha(roughness: wp.float32, anisotropic: wp.float32) -> wp.vec2:
    """Roughness of microfacets along the tangents (Burley 2012, section 5.4)."""
    squared = roughness * roughness
    aspect = wp.sqrt(1.0 - 0.9 * wp.clamp(anisotropic, 0.0, 1.0))
    return wp.vec2(wp.max(squared / aspect, _SPECULAR_LEAST), wp.max(squared * aspect, _SPECULAR_LEAST))


@functools.cache
def make_leaves(features: Features) -> wp.Function:
    """`leaf_at(materials, textures, node, kind, uv, color) -> Bsdf`, for the leaves that features name."""
    value, number = make_parameters(features).value, make_parameters(features).number

    @wp.func
    def roughness(
        materials: Materials, textures: Textures, node: wp.int32, slot: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> wp.float32:
        return wp.max(number(materials, textures, node, slot, uv, color), 0.0)

    @wp.func
    def principled(materials: Materials, textures: Textures, node: wp.int32, uv: wp.vec2, color: wp.vec3) -> Bsdf:
        b = Bsdf()
        b.kind = PRINCIPLED
        b.distribution = materials.distribution[node]
        b.color = value(materials, textures, node, 0, uv, color)
        b.specular = b.color  # what a layer of albedo shows of a metal
        b.roughness = number(materials, textures, node, 1, uv, color)
        b.eta = materials.value[node, 2]
        b.alpha = principled_alpha(b.roughness, number(materials, textures, node, 3, uv, color))
        b.metallic = number(materials, textures, node, 4, uv, color)
        b.spec_trans = number(materials, textures, node, 5, uv, color)
        b.spec_tint = number(materials, textures, node, 6, uv, color)
        b.sheen = number(materials, textures, node, 7, uv, color)
        b.sheen_tint = number(materials, textures, node, 8, uv, color)
        b.flatness = number(materials, textures, node, 9, uv, color)
        b.clearcoat = number(materials, textures, node, 10, uv, color)
        b.clearcoat_gloss = number(materials, textures, node, 11, uv, color)
        return b

    @wp.func
    def leaf_at(
        materials: Materials, textures: Textures, node: wp.int32, kind: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> Bsdf:
        b = Bsdf()
        b.kind = BLACK
        if kind == DIFFUSE:
            b.kind = DIFFUSE
            b.color = value(materials, textures, node, 0, uv, color)
        if wp.static(features.conductor):
            if kind == CONDUCTOR:
                b.kind = CONDUCTOR
                b.distribution = materials.distribution[node]
                b.specular = value(materials, textures, node, 0, uv, color)
                b.eta = value(materials, textures, node, 1, uv, color)
                b.k = value(materials, textures, node, 2, uv, color)
        if wp.static(features.dielectric or features.thin_dielectric):
            if kind == DIELECTRIC or kind == THIN_DIELECTRIC:
                b.kind = kind
                b.distribution = materials.distribution[node]
                b.specular = value(materials, textures, node, 0, uv, color)
                b.transmittance = value(materials, textures, node, 1, uv, color)
                b.eta = materials.value[node, 2]
        if wp.static(features.rough):
            if kind == CONDUCTOR or kind == DIELECTRIC:
                b.alpha = wp.vec2(
                    roughness(materials, textures, node, 3, uv, color),
                    roughness(materials, textures, node, 4, uv, color),
                )
        if wp.static(features.plastic):
            if kind == PLASTIC:
                b.kind = PLASTIC
                b.distribution = materials.distribution[node]
                b.specular = value(materials, textures, node, 0, uv, color)
                b.color = value(materials, textures, node, 1, uv, color)
                b.eta = wp.vec3(materials.value[node, 2][0], materials.value[node, _INTERNAL][0], 0.0)
                alpha = materials.value[node, 3][0]
                b.alpha = wp.vec2(alpha, alpha)
                b.nonlinear = wp.int32(materials.value[node, 5][0])
                b.transmittance = materials.value[node, _OUTER]
                b.k = materials.value[node, _INNER]
        if wp.static(features.principled):
            if kind == PRINCIPLED:
                b = principled(materials, textures, node, uv, color)
        if wp.static(features.passing):
            if kind == NULL:
                b.kind = NULL
        return b

    return leaf_at
