"""Materials on a device: the nodes of their trees, and the parameters of a node at a point."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.texture import Textures, luminance, make_textures
from wdpm.scenes.flat import material_table as mt
from wdpm.scenes.flat.material_coats import with_coats
from wdpm.scenes.flat.material_sides import gathering_sides
from wdpm.scenes.flat.material_table import MaterialTable
from wdpm.scenes.flat.material_ways import check_trees, follows_uv, straight_ways

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TWO_SIDED = wp.constant(mt.TWO_SIDED)
MASK = wp.constant(mt.MASK)
BLEND = wp.constant(mt.BLEND)
BUMP_MAP = wp.constant(mt.BUMP_MAP)
NORMAL_MAP = wp.constant(mt.NORMAL_MAP)
SAME_MEDIUM = wp.constant(mt.SAME_MEDIUM)


@wp.struct
class Materials:
    """All materials, a node of a tree a row; parameters as in scenes.flat.material_table.

    Attributes:
        gathers: sides of a root on which photons are stored (scenes.flat.material_sides).
        follows_uv: 1 where something in a root's tree can tell where u runs.
        parent: the node that a node is in, -1 for a root.
        straight_end: number of the last way of a root (exclusive) that light takes straight through; those of the root
            before it end where its own start.
        straight: the nodes that these ways end in: of the kinds material_ways.STRAIGHT; in a MASK, its holes.
    """

    kind: wp.array[wp.int32]
    child: wp.array2d[wp.int32]
    distribution: wp.array[wp.int32]
    value: wp.array2d[wp.vec3]
    texture: wp.array2d[wp.int32]
    medium: wp.array2d[wp.int32]
    gathers: wp.array[wp.int32]
    follows_uv: wp.array[wp.int32]
    parent: wp.array[wp.int32]
    straight_end: wp.array[wp.int32]
    straight: wp.array[wp.int32]


def upload(table: MaterialTable, device: str) -> Materials:
    """The materials on a device.

    Raises:
        SceneError: a tree that is nested too deep, or what kernels cannot do (scenes.flat.material_ways.check_trees).
    """
    check_trees(table)
    table = with_coats(table)
    ways = straight_ways(table)
    materials = Materials()
    materials.kind = wp.array(table.kind, dtype=wp.int32, device=device)
    materials.child = wp.array(table.child, dtype=wp.int32, device=device)
    materials.distribution = wp.array(table.distribution, dtype=wp.int32, device=device)
    materials.value = wp.array(table.value, dtype=wp.vec3, device=device)
    materials.texture = wp.array(table.texture, dtype=wp.int32, device=device)
    materials.medium = wp.array(table.medium, dtype=wp.int32, device=device)
    materials.gathers = wp.array(gathering_sides(table), dtype=wp.int32, device=device)
    materials.follows_uv = wp.array(follows_uv(table).astype(np.int32), dtype=wp.int32, device=device)
    materials.parent = wp.array(ways.parent, dtype=wp.int32, device=device)
    materials.straight_end = wp.array(ways.end, dtype=wp.int32, device=device)
    straight = ways.node if len(ways.node) else np.full(1, -1, np.int32)
    materials.straight = wp.array(straight, dtype=wp.int32, device=device)
    return materials


@wp.func
def medium_beyond(materials: wp.ref[Materials], root: wp.int32, front: wp.int32, medium: wp.int32) -> wp.int32:
    """The medium that a ray is in after it has crossed a surface, -1 for none.

    Args:
        front: 1 where it comes from the front.
        medium: the one that it comes from.
    """
    beyond = materials.medium[root, 1 - front]
    if beyond == SAME_MEDIUM:
        return medium
    return beyond


@dataclass(frozen=True, eq=False)
class ParameterCode:
    """Functions that read parameters of nodes at a point.

    Attributes:
        value: `(materials, textures, node, slot, uv, color) -> vec3`: a colour.
        number: `(materials, textures, node, slot, uv, color) -> float`: a number; of a texture, its luminance.
        roughness: likewise, not below zero.
        share: `(materials, textures, node, uv, color) -> float`: slot 0 in [0, 1], opacity of a MASK, 0 or 1 where it
            has a cutoff, or weight of a BLEND.
    """

    value: wp.Function
    number: wp.Function
    roughness: wp.Function
    share: wp.Function


@functools.cache
def make_parameters(features: Features) -> ParameterCode:
    """Parameters of nodes at a point, for the textures that features name."""
    lookup = make_textures(features).lookup

    @wp.func
    def value(
        materials: wp.ref[Materials],
        textures: wp.ref[Textures],
        node: wp.int32,
        slot: wp.int32,
        uv: wp.vec2,
        color: wp.vec3,
    ) -> wp.vec3:
        found = materials.value[node, slot]
        if wp.static(features.textures):
            texture = materials.texture[node, slot]
            if texture >= 0:
                found = wp.cw_mul(found, lookup(textures, texture, uv, color))
        return found

    @wp.func
    def number(
        materials: wp.ref[Materials],
        textures: wp.ref[Textures],
        node: wp.int32,
        slot: wp.int32,
        uv: wp.vec2,
        color: wp.vec3,
    ) -> wp.float32:
        found = materials.value[node, slot][0]
        if wp.static(features.textures):
            texture = materials.texture[node, slot]
            if texture >= 0:
                found = found * luminance(lookup(textures, texture, uv, color))
        return found

    @wp.func
    def roughness(
        materials: wp.ref[Materials],
        textures: wp.ref[Textures],
        node: wp.int32,
        slot: wp.int32,
        uv: wp.vec2,
        color: wp.vec3,
    ) -> wp.float32:
        return wp.max(number(materials, textures, node, slot, uv, color), 0.0)

    @wp.func
    def share(
        materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> wp.float32:
        found = number(materials, textures, node, 0, uv, color)
        cutoff = materials.value[node, 1][0]
        if cutoff > 0.0:
            if found < cutoff:
                return wp.float32(0.0)
            return wp.float32(1.0)
        return wp.clamp(found, 0.0, 1.0)

    return ParameterCode(value, number, roughness, share)
