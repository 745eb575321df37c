"""What of light goes straight through a material, all choices averaged: shadow rays cannot choose."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.leaves import leaves_of
from wdpm.kernels.materials.nodes import BLEND, MASK, Materials, make_parameters
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import NULL

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@dataclass(frozen=True, eq=False)
class StraightCode:
    """Functions of what goes straight through materials.

    Attributes:
        straight_transmittance: `(materials, textures, root, uv, color, cos_theta) -> vec3`.
        opacity_at: `(materials, textures, root, uv, color) -> float`.
    """

    straight_transmittance: wp.Function
    opacity_at: wp.Function


@wp.func
def _all(
    materials: wp.ref[Materials],
    textures: wp.ref[Textures],
    node: wp.int32,
    uv: wp.vec2,
    color: wp.vec3,
    cos_theta: wp.float32,
) -> wp.vec3:
    """What goes through NULL, and through the holes of a MASK."""
    return wp.vec3(1.0)


def _through(kind: int, straight: wp.Function, others: wp.Function) -> wp.Function:
    """As `others`, with one more kind of leaf."""

    @wp.func
    def through(
        materials: wp.ref[Materials],
        textures: wp.ref[Textures],
        node: wp.int32,
        uv: wp.vec2,
        color: wp.vec3,
        cos_theta: wp.float32,
    ) -> wp.vec3:
        if materials.kind[node] == kind:
            return straight(materials, textures, node, uv, color, cos_theta)
        return others(materials, textures, node, uv, color, cos_theta)

    return through


@functools.cache
def make_straight(features: Features) -> StraightCode:
    """What goes straight through materials, for the nodes, leaves and textures that features name."""
    share = make_parameters(features).share
    through = _all
    for leaf in reversed(leaves_of(features)):
        if leaf.straight is not None:
            through = _through(leaf.kind, leaf.straight, through)

    @wp.func
    def share_of(
        materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> wp.float32:
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
        materials: wp.ref[Materials],
        textures: wp.ref[Textures],
        root: wp.int32,
        uv: wp.vec2,
        color: wp.vec3,
        cos_theta: wp.float32,
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
                passes = through(materials, textures, node, uv, color, cos_theta)
                total = total + passes * weight
        return total

    @wp.func
    def opacity_at(
        materials: wp.ref[Materials], textures: wp.ref[Textures], root: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> wp.float32:
        """Share of light, in [0, 1], that does not pass through holes of masks or boundaries of media."""
        opacity = wp.float32(1.0)
        if wp.static(features.passing):
            start = wp.int32(0)
            if root > 0:
                start = materials.straight_end[root - 1]
            for way in range(start, materials.straight_end[root]):
                node = materials.straight[way]
                if materials.kind[node] == NULL or materials.kind[node] == MASK:
                    opacity = opacity - share_of(materials, textures, node, uv, color)
        return wp.max(opacity, 0.0)

    return StraightCode(straight_transmittance, opacity_at)
