"""What of light goes straight through a material, all choices averaged: shadow rays cannot choose."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.fresnel import pane_reflectance
from wdpm.kernels.materials.nodes import BLEND, MASK, Materials, make_parameters
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import THIN_DIELECTRIC

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@functools.cache
def make_straight(features: Features) -> SimpleNamespace:
    """`straight_transmittance` and `opacity_at`; see materials.py."""
    value, share = make_parameters(features).value, make_parameters(features).share

    @wp.func
    def share_of(materials: Materials, textures: Textures, node: wp.int32, uv: wp.vec2, color: wp.vec3) -> wp.float32:
        """Probability that choices lead to a node; to its holes, for a MASK."""
        product = wp.float32(1.0)
        below = wp.int32(node)
        if materials.kind[node] == MASK:
            product = 1.0 - share(materials, textures, node, uv, color)
        above = materials.parent[below]
        while above >= 0:
            kind = materials.kind[above]
            if kind == MASK:
                product = product * share(materials, textures, above, uv, color)
            if wp.static(features.blend):
                if kind == BLEND:
                    second = share(materials, textures, above, uv, color)
                    if materials.child[above, 1] == below:
                        product = product * second
                    else:
                        product = product * (1.0 - second)
            below = above
            above = materials.parent[below]
        return product

    @wp.func
    def straight_transmittance(
        materials: Materials, textures: Textures, root: wp.int32, uv: wp.vec2, color: wp.vec3, cos_theta: wp.float32
    ) -> wp.vec3:
        """Factor by which light is dimmed that goes straight through a material.

        1 for NULL, 1 - opacity for a MASK, the transmission of a thin dielectric, blends weighted; else 0.

        Args:
            cos_theta: absolute cosine between the light's direction and the surface's normal.
        """
        total = wp.vec3(0.0)
        if wp.static(features.passing):
            start = wp.int32(0)
            if root > 0:
                start = materials.straight_end[root - 1]
            for way in range(start, materials.straight_end[root]):
                node = materials.straight[way]
                weight = share_of(materials, textures, node, uv, color)
                passes = wp.vec3(1.0)
                if wp.static(features.thin_dielectric):
                    if materials.kind[node] == THIN_DIELECTRIC:
                        through = 1.0 - pane_reflectance(cos_theta, materials.value[node, 2][0])
                        passes = value(materials, textures, node, 1, uv, color) * through
                total = total + passes * weight
        return total

    @wp.func
    def opacity_at(materials: Materials, textures: Textures, root: wp.int32, uv: wp.vec2, color: wp.vec3) -> wp.float32:
        """Share of light, in [0, 1], that does not pass through holes of masks or boundaries of media."""
        opacity = wp.float32(1.0)
        if wp.static(features.passing):
            start = wp.int32(0)
            if root > 0:
                start = materials.straight_end[root - 1]
            for way in range(start, materials.straight_end[root]):
                node = materials.straight[way]
                if materials.kind[node] != THIN_DIELECTRIC:
                    opacity = opacity - share_of(materials, textures, node, uv, color)
        return wp.max(opacity, 0.0)

    return SimpleNamespace(straight_transmittance=straight_transmittance, opacity_at=opacity_at)
