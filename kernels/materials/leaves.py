"""All leaves of materials: the list of what makes their code, and the leaf at a point with its parameters read."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Final

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.conductor import make_conductor
from wdpm.kernels.materials.dielectric import make_dielectric
from wdpm.kernels.materials.diffuse import make_diffuse
from wdpm.kernels.materials.leaf import LeafCode
from wdpm.kernels.materials.nodes import Materials
from wdpm.kernels.materials.null import make_null
from wdpm.kernels.materials.plastic import make_plastic
from wdpm.kernels.materials.principled import make_principled
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.thin.rough_pane import make_rough_pane
from wdpm.kernels.materials.thin.translucent import make_translucent
from wdpm.kernels.materials.thin_dielectric import make_thin_dielectric
from wdpm.kernels.materials.types import BLACK, Bsdf
from wdpm.scenes.model.bsdfs import (
    Conductor,
    Dielectric,
    Diffuse,
    Leaf,
    Null,
    Plastic,
    Principled,
    RoughPane,
    ThinDielectric,
    Translucent,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MAKERS: Final[dict[type[Leaf], Callable[[Features], LeafCode]]] = {
    Diffuse: make_diffuse,
    Conductor: make_conductor,
    Dielectric: make_dielectric,
    ThinDielectric: make_thin_dielectric,
    Plastic: make_plastic,
    Principled: make_principled,
    Translucent: make_translucent,
    RoughPane: make_rough_pane,
    Null: make_null,
}
"""What makes the code of each leaf; it is asked about in this order."""


def leaves_of(features: Features) -> tuple[LeafCode, ...]:
    """The code of the leaves that features name."""
    return tuple(make(features) for leaf, make in MAKERS.items() if features.compiles(leaf.KIND))


@functools.cache
def make_leaves(features: Features) -> wp.Function:
    """`leaf_at(materials, textures, node, kind, uv, color) -> Bsdf`, for the leaves that features name."""
    found = _black
    for leaf in reversed(leaves_of(features)):
        found = _read(leaf.kind, leaf.read, found)
    return found


@wp.func
def _black(
    materials: wp.ref[Materials],
    textures: wp.ref[Textures],
    node: wp.int32,
    kind: wp.int32,
    uv: wp.vec2,
    color: wp.vec3,
) -> Bsdf:
    b = Bsdf()
    b.kind = BLACK
    return b


def _read(own_kind: int, read: wp.Function, others: wp.Function) -> wp.Function:
    """As `others`, with one more kind."""

    @wp.func
    def leaf_at(
        materials: wp.ref[Materials],
        textures: wp.ref[Textures],
        node: wp.int32,
        kind: wp.int32,
        uv: wp.vec2,
        color: wp.vec3,
    ) -> Bsdf:
        if kind == own_kind:
            return read(materials, textures, node, uv, color)
        return others(materials, textures, node, kind, uv, color)

    return leaf_at
