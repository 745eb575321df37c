"""What a ray finds where it hits: place, normals, material, light."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.constants import OFFSET_SHARE
from wdpm.kernels.features import Features
from wdpm.kernels.materials.dielectric import DIELECTRIC, is_smooth_dielectric
from wdpm.kernels.materials.frames import bump_shadowing, plain_frame
from wdpm.kernels.materials.principled import PRINCIPLED
from wdpm.kernels.materials.resolve import Materials, make_materials
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.thin.rough_pane import ROUGH_PANE
from wdpm.kernels.materials.thin.translucent import TRANSLUCENT
from wdpm.kernels.materials.thin_dielectric import THIN_DIELECTRIC
from wdpm.kernels.materials.types import DIFFUSE, Bsdf, BsdfSample
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.instanced_triangles import make_triangles

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Surface:
    """A point of a surface, seen from one side.

    Attributes:
        front: 1 where the seen side is the front.
        through: 1 where its diffuse part has its light from the other side (kernels.materials.thin.translucent).
        normal: unit geometric normal on the seen side.
        shading_normal: unit shading normal, in the same hemisphere where nothing bends it.
        s, t, n: axes of the local frame of `bsdf`: n is the shading normal of the material's front; where light comes
            through, that of the side that it comes from.
        bsdf: the material there, all textures read, all choices made.
        material: the root of its material tree.
        emitter: -1 where nothing is emitted.
        unbent: the shading normal before maps bent it, on the side of n; bumps2: how strongly, 0 for not at all
            (frames.bend_roughness2).
    """

    position: wp.vec3
    normal: wp.vec3
    shading_normal: wp.vec3
    s: wp.vec3
    t: wp.vec3
    n: wp.vec3
    bsdf: Bsdf
    material: wp.int32
    emitter: wp.int32
    front: wp.int32
    through: wp.int32
    uv: wp.vec2
    color: wp.vec3
    unbent: wp.vec3
    bumps2: wp.float32


@wp.func
def leave(position: wp.vec3, normal: wp.vec3, offset_min: wp.float32) -> wp.vec3:
    """Where a ray that leaves a surface on the side of `normal` starts: certainly on that side."""
    size = wp.abs(normal[0] * position[0]) + wp.abs(normal[1] * position[1]) + wp.abs(normal[2] * position[2])
    return position + normal * (OFFSET_SHARE * size + offset_min)


@wp.func
def lit_normal(s: Surface) -> wp.vec3:
    """The unit geometric normal on the side that light comes from which the diffuse part scatters to the seen side."""
    if s.through == 1:
        return -s.normal
    return s.normal


@wp.func
def lit_shading_normal(s: Surface) -> wp.vec3:
    """Likewise the shading normal."""
    if s.through == 1:
        return -s.shading_normal
    return s.shading_normal


@wp.func
def unfolded(s: Surface, direction: wp.vec3) -> wp.vec3:
    """A direction to the seen side, as if it was that which light comes from.

    Where light comes through it points away from the surface on the other side: so a sheet seen through is a diffuse
    surface like any other, seen from its lit side.
    """
    if s.through == 1:
        return -direction
    return direction


@wp.func
def to_local(s: Surface, direction: wp.vec3) -> wp.vec3:
    """A direction of the world in the frame of the surface's material."""
    return wp.vec3(wp.dot(direction, s.s), wp.dot(direction, s.t), wp.dot(direction, s.n))


@wp.func
def to_world(s: Surface, local: wp.vec3) -> wp.vec3:
    """A direction of the frame of the surface's material in the world."""
    return s.s * local[0] + s.t * local[1] + s.n * local[2]


@wp.func
def lets_light_through(s: Surface) -> bool:
    """Whether some of the light that comes to a surface goes on behind it, bent or scattered by its glossy part."""
    glass = s.bsdf.kind == DIELECTRIC or s.bsdf.kind == THIN_DIELECTRIC
    return glass or s.bsdf.kind == ROUGH_PANE or (s.bsdf.kind == PRINCIPLED and s.bsdf.spec_trans > 0.0)


@wp.func
def scatters_to_either_side(s: Surface) -> bool:
    """Whether light goes on at whichever side its direction points to, be it not the side that it was meant for.

    What lets light through has nothing to hide, and takes little of the light that comes to it. Where the interpolated
    normal of a coarse mesh sends light to the side that it was not meant for, it goes on from there, as in Mitsuba and
    pbrt: what is lost is seen as black. Bent normals are meant to lose it.
    """
    return lets_light_through(s) and s.bumps2 == 0.0


@wp.func
def goes_through(s: Surface, sampled: BsdfSample) -> wp.int32:
    """1 where a sampled direction of the glossy part leads to the other side of the surface."""
    crosses = sampled.crosses
    smooth_glass = s.bsdf.kind == DIELECTRIC and sampled.delta == 1
    if sampled.straight == 0 and sampled.diffuse == 0 and (smooth_glass or scatters_to_either_side(s)):
        crosses = wp.int32(wp.dot(s.normal, to_world(s, sampled.to)) < 0.0)
    return crosses


@wp.func
def bump_shading(s: Surface, to_light: wp.vec3) -> wp.float32:
    """Share of light that a bent normal's own bumps let reach the surface (frames.bump_shadowing)."""
    share = wp.float32(1.0)
    if s.bumps2 > 0.0:
        share = bump_shadowing(s.bumps2, wp.dot(s.unbent, to_light))
    return share


@wp.func
def is_turned_towards(s: Surface, direction: wp.vec3) -> bool:
    """Whether the bent normal of a surface is turned for who sees it from a direction (frames.bend)."""
    return wp.dot(s.unbent, direction) * wp.dot(s.n, direction) < 0.0


@wp.func
def turned(s: Surface) -> Surface:
    """The same with its bent normal turned by half a turn about the old one."""
    s.n = _half_turn(s.unbent, s.n)
    s.s = _half_turn(s.unbent, s.s)
    s.t = _half_turn(s.unbent, s.t)
    return s


@wp.func
def _half_turn(axis: wp.vec3, v: wp.vec3) -> wp.vec3:
    return axis * (2.0 * wp.dot(axis, v)) - v


@dataclass(frozen=True, eq=False)
class SurfaceCode:
    """Functions of surfaces.

    Attributes:
        surface_at: `(surfaces, materials, textures, prim, u, v, towards, u_choice) -> Surface`.
        surface_of_light: the same, but that no bent normal is turned towards `towards`: for light that comes from
            there, and is seen from elsewhere.
    """

    surface_at: wp.Function
    surface_of_light: wp.Function


@functools.cache
def make_surface(features: Features) -> SurfaceCode:
    """The surface at a hit."""
    return SurfaceCode(_make_surface_at(features, turns=True), _make_surface_at(features, turns=False))


def _make_surface_at(features: Features, *, turns: bool) -> wp.Function:
    resolve = make_materials(features).resolve

    triangles = make_triangles(features.instances)
    row_of, position_at, front_of = triangles.row_of, triangles.position_at, triangles.front_of
    corner_at, normal_at, uv_at, color_at = (
        triangles.corner_at,
        triangles.normal_at,
        triangles.uv_at,
        triangles.color_at,
    )
    table_row = triangles.table_row

    @wp.func
    def tangents(uv0: wp.vec2, uv1: wp.vec2, uv2: wp.vec2) -> wp.mat22:
        """Inverse of the matrix of the uv differences along edges 1 and 2; zero where it has none."""
        a = uv1 - uv0
        b = uv2 - uv0
        determinant = a[0] * b[1] - a[1] * b[0]
        m = wp.mat22(0.0)
        if determinant != 0.0:
            m = wp.mat22(b[1] / determinant, -a[1] / determinant, -b[0] / determinant, a[0] / determinant)
        return m

    @wp.func
    def surface_at(
        surfaces: wp.ref[Surfaces],
        materials: wp.ref[Materials],
        textures: wp.ref[Textures],
        prim: wp.int32,
        u: wp.float32,
        v: wp.float32,
        towards: wp.vec3,
        u_choice: wp.float32,
    ) -> Surface:
        """The surface at a hit, seen from the direction `towards` (pointing away from the surface).

        Args:
            u_choice: number in [0, 1) that makes the material's choices: masks, blends.
        """
        row = row_of(surfaces, prim)
        held = table_row(row)
        front_normal = front_of(surfaces, row)
        shading = front_normal
        a = 1.0 - u - v
        if surfaces.smooth[held] == 1:
            blend = normal_at(surfaces, row, 0) * a + normal_at(surfaces, row, 1) * u + normal_at(surfaces, row, 2) * v
            if wp.dot(blend, front_normal) > 0.0:
                shading = wp.normalize(blend)
        front = wp.dot(front_normal, towards) > 0.0
        interpolated = shading
        if (wp.dot(shading, towards) > 0.0) != front:
            shading = front_normal  # an interpolated normal that says that the other side is seen says too much
        s = Surface()
        s.position = position_at(surfaces, row, u, v)
        s.front = wp.int32(front)
        s.normal = front_normal
        if not front:
            s.normal = -front_normal
        s.material = surfaces.material[held]
        s.emitter = surfaces.emitter[held]
        if wp.static(features.textures or features.textured_lights):
            s.uv = uv_at(surfaces, row, 0) * a + uv_at(surfaces, row, 1) * u + uv_at(surfaces, row, 2) * v
        if wp.static(features.vertex_colors):
            if surfaces.colored == 1:
                s.color = color_at(surfaces, row, 0) * a + color_at(surfaces, row, 1) * u
                s.color = s.color + color_at(surfaces, row, 2) * v
        dp_du = wp.vec3(0.0)
        dp_dv = wp.vec3(0.0)
        if wp.static(features.oriented):
            m = tangents(uv_at(surfaces, row, 0), uv_at(surfaces, row, 1), uv_at(surfaces, row, 2))
            edge1 = corner_at(surfaces, row, 1) - corner_at(surfaces, row, 0)
            edge2 = corner_at(surfaces, row, 2) - corner_at(surfaces, row, 0)
            dp_du = edge1 * m[0, 0] + edge2 * m[0, 1]
            dp_dv = edge1 * m[1, 0] + edge2 * m[1, 1]
        seen_from = wp.vec3(0.0)
        if wp.static(turns):
            seen_from = towards
        r = resolve(materials, textures, s.material, s.uv, s.color, dp_du, dp_dv, shading, front, u_choice, seen_from)
        if wp.static(features.dielectric):
            # Which index is ahead is told by the same normal as directions, or light would be trapped (goes_through).
            if r.bsdf.kind == DIELECTRIC and r.bumps2 == 0.0 and is_smooth_dielectric(r.bsdf):
                r.n = interpolated
                r.unbent = interpolated
                plain = plain_frame(interpolated)
                r.s = plain.s
                r.t = plain.t
        s.bsdf = r.bsdf
        s.s = r.s
        s.t = r.t
        s.n = r.n
        s.shading_normal = r.n
        if wp.static(features.bent):
            s.unbent = r.unbent
            s.bumps2 = r.bumps2
        if not front and r.flipped == 0:
            s.shading_normal = -r.n
        if wp.static(features.translucent):
            if r.bsdf.kind == TRANSLUCENT:
                s.bsdf.kind = DIFFUSE
                s.through = 1
                s.n = -s.shading_normal
                if wp.dot(s.n, r.n) < 0.0:
                    s.unbent = -s.unbent
        return s

    made: wp.Function = surface_at
    return made
