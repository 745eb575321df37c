"""What a ray finds where it hits: place, normals, albedo, emission."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels import texture
from wdpm.kernels.constants import OFFSET_MIN_SHARE, OFFSET_SHARE
from wdpm.kernels.texture import Textures
from wdpm.scenes.geometry import Triangles

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Surfaces:
    """The triangles of a cell, sorted by global number, and all materials."""

    count: wp.int32
    ids: wp.array[wp.int32]
    corners: wp.array2d[wp.vec3]  # [triangles, 3]
    front: wp.array[wp.vec3]  # unit geometric normal of each triangle's front
    smooth: wp.array[wp.int32]  # 1 where there are normals to interpolate
    normals: wp.array2d[wp.vec3]  # [triangles, 3]; zero where flat
    uvs: wp.array2d[wp.vec2]  # [triangles, 3]
    material: wp.array[wp.int32]
    emitter: wp.array[wp.int32]
    reflectance: wp.array[wp.vec3]  # by material
    texture: wp.array[wp.int32]  # by material; -1 without
    twosided: wp.array[wp.int32]  # by material
    emitter_radiance: wp.array[wp.vec3]  # by emitter
    textures: Textures
    offset_min: wp.float32  # least distance at which rays leave a surface


@wp.struct
class Surface:
    """A point of a surface, seen from one side.

    Attributes:
        normal: unit geometric normal on the seen side.
        shading_normal: unit interpolated normal, in the same hemisphere.
        front: whether the seen side is the front.
        reflects: whether the seen side reflects at all.
    """

    position: wp.vec3
    normal: wp.vec3
    shading_normal: wp.vec3
    albedo: wp.vec3
    emitter: wp.int32
    front: wp.bool
    reflects: wp.bool


def upload(
    triangles: Triangles,
    reflectance: NDArray[np.float32],
    texture_of_material: NDArray[np.int32],
    twosided: NDArray[np.int32],
    emitter_radiance: NDArray[np.float32],
    textures: Textures,
    extent: float,
    device: str,
) -> Surfaces:
    """A cell's triangles and all materials on a device."""
    surfaces = Surfaces()
    surfaces.count = len(triangles)
    surfaces.ids = wp.array(triangles.ids, dtype=wp.int32, device=device)
    surfaces.corners = wp.array(triangles.positions, dtype=wp.vec3, device=device)
    front, smooth = front_normals(triangles)
    surfaces.front = wp.array(front, dtype=wp.vec3, device=device)
    surfaces.smooth = wp.array(smooth, dtype=wp.int32, device=device)
    surfaces.normals = wp.array(triangles.normals, dtype=wp.vec3, device=device)
    surfaces.uvs = wp.array(triangles.uvs, dtype=wp.vec2, device=device)
    surfaces.material = wp.array(triangles.material, dtype=wp.int32, device=device)
    surfaces.emitter = wp.array(triangles.emitter, dtype=wp.int32, device=device)
    surfaces.reflectance = wp.array(reflectance, dtype=wp.vec3, device=device)
    surfaces.texture = wp.array(texture_of_material, dtype=wp.int32, device=device)
    surfaces.twosided = wp.array(twosided, dtype=wp.int32, device=device)
    surfaces.emitter_radiance = wp.array(emitter_radiance, dtype=wp.vec3, device=device)
    surfaces.textures = textures

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
def row_of(surfaces: Surfaces, prim: wp.int32) -> wp.int32:
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
def position_at(surfaces: Surfaces, row: wp.int32, u: wp.float32, v: wp.float32) -> wp.vec3:
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
def clearance(surfaces: Surfaces, prim: wp.int32, position: wp.vec3) -> wp.float32:
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
def surface_at(surfaces: Surfaces, prim: wp.int32, u: wp.float32, v: wp.float32, towards: wp.vec3) -> Surface:
    """The surface at a hit, seen from the direction `towards` (pointing away from the surface)."""
    row = row_of(surfaces, prim)
    normal = surfaces.front[row]
    shading = normal
    if surfaces.smooth[row] == 1:
        blend = surfaces.normals[row, 0] * (1.0 - u - v) + surfaces.normals[row, 1] * u + surfaces.normals[row, 2] * v
        if wp.dot(blend, normal) > 0.0:
            shading = wp.normalize(blend)
    front = wp.dot(normal, towards) > 0.0
    material = surfaces.material[row]
    s = Surface()
    s.position = position_at(surfaces, row, u, v)
    s.front = front
    s.reflects = front or surfaces.twosided[material] == 1
    s.normal = normal
    s.shading_normal = shading
    if not front:
        s.normal = -normal
        s.shading_normal = -shading
    s.albedo = surfaces.reflectance[material]
    image = surfaces.texture[material]
    if image >= 0:
        uv = surfaces.uvs[row, 0] * (1.0 - u - v) + surfaces.uvs[row, 1] * u + surfaces.uvs[row, 2] * v
        s.albedo = wp.cw_mul(s.albedo, texture.lookup(surfaces.textures, image, uv))
    s.emitter = surfaces.emitter[row]
    return s


@wp.func
def leave(position: wp.vec3, normal: wp.vec3, offset_min: wp.float32) -> wp.vec3:
    """Where a ray that leaves a surface on the side of `normal` starts: certainly on that side."""
    size = wp.abs(normal[0] * position[0]) + wp.abs(normal[1] * position[1]) + wp.abs(normal[2] * position[2])
    return position + normal * (OFFSET_SHARE * size + offset_min)
