"""Materials at a point: from the root of a material's tree, through masks, blends, sides and bumps, to one leaf.

Every node on the way is decided by one random number, which each choice stretches back to [0, 1). What a leaf's
parameters are is read from values and textures. Kernels are compiled for the nodes and leaves that a scene has.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.frames import (
    Frame,
    bend,
    bend_roughness2,
    bumped_normal,
    mirrored,
    plain_frame,
    uv_frame,
)
from wdpm.kernels.materials.leaves import make_leaves
from wdpm.kernels.materials.nodes import (
    BLEND,
    BUMP_MAP,
    MASK,
    NORMAL_MAP,
    TWO_SIDED,
    Materials,
    make_parameters,
    medium_beyond,
    upload,
)
from wdpm.kernels.materials.straight import make_straight
from wdpm.kernels.materials.texture import Textures, make_textures
from wdpm.kernels.materials.types import NULL, Bsdf
from wdpm.scenes.flat.material_ways import DEPTH_MOST

__all__ = ["Materials", "Resolved", "make_materials", "medium_beyond", "upload"]

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Static conditions prune only where they stand alone.
# ruff: noqa: SIM109

_DEPTH_MOST = wp.constant(DEPTH_MOST)
_BELOW_ONE = wp.constant(wp.float32(1 - 2.0**-24))


@wp.struct
class Resolved:
    """A material at a point, all choices made.

    Attributes:
        bsdf: the leaf; its kind is NULL where light goes straight through.
        passes: 1 where it does, through a mask's hole or a boundary of media.
        flipped: 1 where n is on the back, as the back is seen like a front.
        s, t, n: orthonormal axes of the leaf's frame; n is its shading normal. The frame is left-handed where it is the
            mirror image of a front's.
        unbent: the shading normal before bump and normal maps, on the side of n.
        bumps2: squared roughness of the bumps that bend it, 0 without any: for frames.bump_shadowing.
    """

    bsdf: Bsdf
    passes: wp.int32
    flipped: wp.int32
    s: wp.vec3
    t: wp.vec3
    n: wp.vec3
    unbent: wp.vec3
    bumps2: wp.float32


@dataclass(frozen=True, eq=False)
class MaterialCode:
    """Functions of materials.

    Attributes:
        resolve: `(materials, textures, root, uv, color, dp_du, dp_dv, normal, from_front, u_choice, towards) ->
            Resolved`.
        straight_transmittance: `(materials, textures, root, uv, color, cos_theta) -> vec3`.
        opacity_at: `(materials, textures, root, uv, color) -> float`.
    """

    resolve: wp.Function
    straight_transmittance: wp.Function
    opacity_at: wp.Function


@functools.cache
def make_materials(features: Features) -> MaterialCode:
    """Functions of materials, for the nodes, leaves and textures that features name."""
    share = make_parameters(features).share
    leaf_at = make_leaves(features)
    bent_frame = _make_bending(features)

    @wp.func
    def resolve(
        materials: wp.ref[Materials],
        textures: wp.ref[Textures],
        root: wp.int32,
        uv: wp.vec2,
        color: wp.vec3,
        dp_du: wp.vec3,
        dp_dv: wp.vec3,
        normal: wp.vec3,
        from_front: bool,
        u_choice: wp.float32,
        towards: wp.vec3 = wp.vec3(0.0, 0.0, 0.0),  # noqa: B008 - a value that nothing changes
    ) -> Resolved:
        """A material at a point.

        Args:
            color: the vertices' colour at the point.
            dp_du, dp_dv: derivatives of position by u and v; what is not known is zero.
            normal: unit shading normal of the geometric front.
            from_front: whether the geometric front is what is seen.
            u_choice: number in [0, 1) that makes all choices.
            towards: unit direction to where the path came from; only bump and normal maps ask for it.
        """
        r = Resolved()
        node = wp.int32(root)
        kind = materials.kind[node]
        place = wp.int32(0)
        depth = wp.int32(0)
        behind = wp.int32(0)
        if not from_front:
            behind = 1
        u = wp.float32(u_choice)
        r.n = normal
        r.unbent = normal
        frame = Frame()
        follows = wp.int32(0)
        if wp.static(features.oriented):
            follows = materials.follows_uv[root]
            if follows == 1:
                frame = uv_frame(normal, dp_du, dp_dv)
        while kind >= TWO_SIDED and depth < _DEPTH_MOST:
            depth += 1
            place = 0
            if kind == TWO_SIDED:
                if behind == 1:
                    place = 1
                    behind = 0
                    r.flipped = 1
                    r.n = -r.n
                    r.unbent = -r.unbent
                    if wp.static(features.oriented):
                        frame = mirrored(frame)
            if wp.static(features.blend):
                if kind == BLEND:
                    second = share(materials, textures, node, uv, color)
                    first = 1.0 - second
                    if u < first:
                        u = wp.min(u / first, _BELOW_ONE)
                    else:
                        u = wp.clamp((u - first) / second, 0.0, _BELOW_ONE)
                        place = 1
            if wp.static(features.passing):
                if kind == MASK:
                    opacity = share(materials, textures, node, uv, color)
                    if u < opacity:
                        u = wp.min(u / opacity, _BELOW_ONE)
                    else:
                        place = -1
            if wp.static(features.bent):
                if kind == BUMP_MAP or kind == NORMAL_MAP:
                    frame = bent_frame(materials, textures, node, kind, uv, color, frame, towards)
                    r.n = frame.n
                    r.bumps2 = bend_roughness2(wp.dot(r.n, r.unbent))
            if place < 0:
                kind = NULL
            else:
                node = materials.child[node, place]
                kind = materials.kind[node]
        if kind == NULL:
            r.passes = 1
        r.bsdf = leaf_at(materials, textures, node, kind, uv, color)
        if follows == 0:
            frame = plain_frame(r.n)
        r.s = frame.s
        r.t = frame.t
        return r

    straight = make_straight(features)
    return MaterialCode(resolve, straight.straight_transmittance, straight.opacity_at)


def _make_bending(features: Features) -> wp.Function:
    """The frame that a bump or normal map makes of another."""
    lookup = make_textures(features).lookup
    slope = make_textures(features).slope

    @wp.func
    def bent_frame(
        materials: wp.ref[Materials],
        textures: wp.ref[Textures],
        node: wp.int32,
        kind: wp.int32,
        uv: wp.vec2,
        color: wp.vec3,
        frame: Frame,
        towards: wp.vec3,
    ) -> Frame:
        texture = materials.texture[node, 0]
        normal = wp.vec3(0.0, 0.0, 1.0)
        if kind == BUMP_MAP:
            normal = bumped_normal(frame, slope(textures, texture, uv) * materials.value[node, 0][0])
        else:
            normal = lookup(textures, texture, uv, color) * 2.0 - wp.vec3(1.0)
            if materials.value[node, 1][0] * frame.dv[1] < 0.0:  # the texture lies mirrored here
                normal = wp.vec3(normal[0], -normal[1], normal[2])
        return bend(frame, normal, towards)

    return bent_frame
