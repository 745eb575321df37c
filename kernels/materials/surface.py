"""What a ray finds where it hits: place, normals, material, light."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.constants import OFFSET_MIN_SHARE, OFFSET_SHARE
from wdpm.kernels.features import Features
from wdpm.kernels.materials.frames import bump_shadowing
from wdpm.kernels.materials.resolve import Materials, make_materials
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import Bsdf
from wdpm.scenes.flat.arrays import Triangles

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Surfaces:
    """The triangles of a cell, sorted by global number."""

    count: wp.int32
    ids: wp.array[wp.int32]
    corners: wp.array2d[wp.vec3]  # [triangles, 3]
    front: wp.array[wp.vec3]  # unit geometric normal of each triangle's front
    smooth: wp.array[wp.int32]  # 1 where there are normals to interpolate
    normals: wp.array2d[wp.vec3]  # [triangles, 3]; zero where flat
    uvs: wp.array2d[wp.vec2]  # [triangles, 3]
    colored: wp.int32  # 1 where there are vertex colours
    colors: wp.array2d[wp.vec3]  # [triangles, 3], or none
    material: wp.array[wp.int32]
    emitter: wp.array[wp.int32]
    offset_min: wp.float32  # least distance at which rays leave a surface


@wp.struct
class Surface:
    """A point of a surface, seen from one side.

    Attributes:
        front: 1 where the seen side is the front.
        normal: unit geometric normal on the seen side.
        shading_normal: unit shading normal, in the same hemisphere where nothing bends it.
        s, t, n: axes of the local frame of `bsdf`: n is the shading normal of the material's front.
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
    uv: wp.vec2
    color: wp.vec3
    unbent: wp.vec3
    bumps2: wp.float32


def upload(triangles: Triangles, extent: float, device: str) -> Surfaces:
    """A cell's triangles on a device."""
    surfaces = Surfaces()
    surfaces.count = len(triangles)
    surfaces.ids = wp.array(triangles.ids, dtype=wp.int32, device=device)
    surfaces.corners = wp.array(triangles.positions, dtype=wp.vec3, device=device)
    front, smooth = front_normals(triangles)
    surfaces.front = wp.array(front, dtype=wp.vec3, device=device)
    surfaces.smooth = wp.array(smooth, dtype=wp.int32, device=device)
    surfaces.normals = wp.array(triangles.normals, dtype=wp.vec3, device=device)
    surfaces.uvs = wp.array(triangles.uvs, dtype=wp.vec2, device=device)
    surfaces.colored = int(len(triangles.colors) > 0)
    surfaces.colors = wp.array(triangles.colors.reshape(-1, 3, 3), dtype=wp.vec3, device=device)
    surfaces.material = wp.array(triangles.material, dtype=wp.int32, device=device)
    surfaces.emitter = wp.array(triangles.emitter, dtype=wp.int32, device=device)
    surfaces.offset_min = float(extent) * OFFSET_MIN_SHARE
    return surfaces


def front_normals(triangles: Triangles) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Unit geometric normals of the triangles' fronts, and whether each has normals to interpolate.

    The front is the side that the vertex normals are on; without them, the one from which the corners go
    counter-clockwise. Computed in double: a cross product of needles cancels.
    """
    p = triangles.positions.astype(np.float64)
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    against = np.einsum("ij,ij->i", normal, triangles.normals.sum(axis=1, dtype=np.float64)) < 0
    normal[against] *= -1.0
    smooth = (triangles.normals != 0).any(axis=2).all(axis=1)
    return normal.astype(np.float32), smooth.astype(np.int32)


@wp.func
def row_of(surfaces: wp.ref[Surfaces], prim: wp.int32) -> wp.int32:
    """The row of a global triangle number; the triangle must be in the cell."""
    # A cell that holds the whole scene finds it at once.
    guess = wp.min(prim, surfaces.count - 1)
    if surfaces.ids[guess] == prim:
        return guess
    low = wp.int32(0)
    high = surfaces.count - 1
    while low < high:
        middle = (low + high) // 2
        if surfaces.ids[middle] < prim:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def position_at(surfaces: wp.ref[Surfaces], row: wp.int32, u: wp.float32, v: wp.float32) -> wp.vec3:
    """A point of a triangle, combined in double and rounded once.

    That is what makes the offset of leaving rays provable (constants.OFFSET_SHARE).
    """
    b = wp.float64(u)
    c = wp.float64(v)
    a = wp.float64(1.0) - b - c
    p0 = wp.vec3d(surfaces.corners[row, 0])
    p1 = wp.vec3d(surfaces.corners[row, 1])
    p2 = wp.vec3d(surfaces.corners[row, 2])
    return wp.vec3(p0 * a + p1 * b + p2 * c)


@wp.func
def clearance(surfaces: wp.ref[Surfaces], prim: wp.int32, position: wp.vec3) -> wp.float32:
    """Distance of a point of a triangle to the nearest of its edges."""
    row = row_of(surfaces, prim)
    nearest = wp.float32(3.0e38)
    for corner in range(3):
        start = surfaces.corners[row, corner]
        edge = wp.normalize(surfaces.corners[row, (corner + 1) % 3] - start)
        arm = position - start
        nearest = wp.min(nearest, wp.length(wp.cross(edge, arm)))
    return nearest


@wp.func
def leave(position: wp.vec3, normal: wp.vec3, offset_min: wp.float32) -> wp.vec3:
    """Where a ray that leaves a surface on the side of `normal` starts: certainly on that side."""
    size = wp.abs(normal[0] * position[0]) + wp.abs(normal[1] * position[1]) + wp.abs(normal[2] * position[2])
    return position + normal * (OFFSET_SHARE * size + offset_min)


@wp.func
def to_local(s: Surface, direction: wp.vec3) -> wp.vec3:
    """A direction of the world in the frame of the surface's material."""
    return wp.vec3(wp.dot(direction, s.s), wp.dot(direction, s.t), wp.dot(direction, s.n))


@wp.func
def to_world(s: Surface, local: wp.vec3) -> wp.vec3:
    """A direction of the frame of the surface's material in the world."""
    return s.s * local[0] + s.t * local[1] + s.n * local[2]


@wp.func
def bump_shading(s: Surface, to_light: wp.vec3) -> wp.float32:
    """Share of light that a bent normal's own bumps let reach the surface (frames.bump_shadowing)."""
    share = wp.float32(1.0)
    if s.bumps2 > 0.0:
        share = bump_shadowing(s.bumps2, wp.dot(s.unbent, to_light))
    return share


@dataclass(frozen=True, eq=False)
class SurfaceCode:
    """Functions of surfaces.

    Attributes:
        surface_at: `(surfaces, materials, textures, prim, u, v, towards, u_choice) -> Surface`.
    """

    surface_at: wp.Function


@functools.cache
def make_surface(features: Features) -> SurfaceCode:
    """The surface at a hit."""
    resolve = make_materials(features).resolve

    @wp.func
    def tangents(surfaces: wp.ref[Surfaces], row: wp.int32) -> wp.mat22:
        """Inverse of the matrix of the uv differences along edges 1 and 2; zero where it has none."""
        a = surfaces.uvs[row, 1] - surfaces.uvs[row, 0]
        b = surfaces.uvs[row, 2] - surfaces.uvs[row, 0]
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
        front_normal = surfaces.front[row]
        shading = front_normal
        a = 1.0 - u - v
        if surfaces.smooth[row] == 1:
            blend = surfaces.normals[row, 0] * a + surfaces.normals[row, 1] * u + surfaces.normals[row, 2] * v
            if wp.dot(blend, front_normal) > 0.0:
                shading = wp.normalize(blend)
        front = wp.dot(front_normal, towards) > 0.0
        if (wp.dot(shading, towards) > 0.0) != front:
            shading = front_normal  # an interpolated normal that says that the other side is seen says too much
        s = Surface()
        s.position = position_at(surfaces, row, u, v)
        s.front = wp.int32(front)
        s.normal = front_normal
        if not front:
            s.normal = -front_normal
        s.material = surfaces.material[row]
        s.emitter = surfaces.emitter[row]
        if wp.static(features.textures or features.textured_lights):
            s.uv = surfaces.uvs[row, 0] * a + surfaces.uvs[row, 1] * u + surfaces.uvs[row, 2] * v
        if wp.static(features.vertex_colors):
            if surfaces.colored == 1:
                s.color = surfaces.colors[row, 0] * a + surfaces.colors[row, 1] * u + surfaces.colors[row, 2] * v
        dp_du = wp.vec3(0.0)
        dp_dv = wp.vec3(0.0)
        if wp.static(features.oriented):
            m = tangents(surfaces, row)
            edge1 = surfaces.corners[row, 1] - surfaces.corners[row, 0]
            edge2 = surfaces.corners[row, 2] - surfaces.corners[row, 0]
            dp_du = edge1 * m[0, 0] + edge2 * m[0, 1]
            dp_dv = edge1 * m[1, 0] + edge2 * m[1, 1]
        r = resolve(materials, textures, s.material, s.uv, s.color, dp_du, dp_dv, shading, front, u_choice, towards)
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
        return s

    return SurfaceCode(surface_at)
