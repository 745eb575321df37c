"""The triangles of a cell with instances: the same questions as of those with arrays of their own (cell_triangles.py).

A row is then two numbers: of the triangle among all that are stored, and of the instance that it belongs to, or -1.
"""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from wdpm.kernels.rays import cell_triangles as triangles
from wdpm.kernels.rays.cell_triangles import Surfaces, combined, distance_to_line
from wdpm.kernels.rays.instances import instance_corner, instance_front, instance_normal, instance_of, shape_corner

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def row_of_all(surfaces: wp.ref[Surfaces], prim: wp.int32) -> wp.vec2i:
    """The row of a global triangle number; the triangle must be in the cell."""
    instance = instance_of(surfaces.instances, prim)
    row = wp.int32(0)
    if instance >= 0:
        own = surfaces.instances.first[instance] + prim - surfaces.instances.base[instance]
        row = surfaces.count + own
    else:
        row = triangles.row_of(surfaces, prim)
    return wp.vec2i(row, instance)


@wp.func
def table_row_of_all(row: wp.vec2i) -> wp.int32:
    """The row in the arrays that do not depend on where a triangle stands."""
    return row[0]


@wp.func
def corner_at_all(surfaces: wp.ref[Surfaces], row: wp.vec2i, corner: wp.int32) -> wp.vec3:
    """A corner of a triangle."""
    if row[1] < 0:
        return surfaces.corners[row[0], corner]
    return instance_corner(surfaces.instances, row[1], row[0] - surfaces.count, corner)


@wp.func
def normal_at_all(surfaces: wp.ref[Surfaces], row: wp.vec2i, corner: wp.int32) -> wp.vec3:
    """The normal at a corner of a triangle; zero where it is flat."""
    if row[1] < 0:
        return surfaces.normals[row[0], corner]
    return instance_normal(surfaces.instances, row[1], row[0] - surfaces.count, corner)


@wp.func
def front_of_all(surfaces: wp.ref[Surfaces], row: wp.vec2i) -> wp.vec3:
    """Unit geometric normal of a triangle's front."""
    if row[1] < 0:
        return surfaces.front[row[0]]
    return instance_front(surfaces.instances, row[1], row[0] - surfaces.count)


@wp.func
def stored_corner(surfaces: wp.ref[Surfaces], row: wp.vec2i, corner: wp.int32) -> wp.int32:
    """Under which corner of its row the texture coordinates and the colour of a corner are stored."""
    stored = corner
    if row[1] >= 0:
        stored = shape_corner(surfaces.instances, row[1], corner)
    return stored


@wp.func
def uv_at_all(surfaces: wp.ref[Surfaces], row: wp.vec2i, corner: wp.int32) -> wp.vec2:
    """Texture coordinates at a corner of a triangle."""
    return surfaces.uvs[row[0], stored_corner(surfaces, row, corner)]


@wp.func
def color_at_all(surfaces: wp.ref[Surfaces], row: wp.vec2i, corner: wp.int32) -> wp.vec3:
    """The colour at a corner of a triangle, where there are any."""
    return surfaces.colors[row[0], stored_corner(surfaces, row, corner)]


@wp.func
def position_at_all(surfaces: wp.ref[Surfaces], row: wp.vec2i, u: wp.float32, v: wp.float32) -> wp.vec3:
    """A point of a triangle."""
    a = corner_at_all(surfaces, row, 0)
    b = corner_at_all(surfaces, row, 1)
    c = corner_at_all(surfaces, row, 2)
    return combined(a, b, c, u, v)


@wp.func
def clearance_of_all(surfaces: wp.ref[Surfaces], prim: wp.int32, position: wp.vec3) -> wp.float32:
    """Distance of a point of a triangle to the nearest of its edges."""
    row = row_of_all(surfaces, prim)
    nearest = wp.float32(3.0e38)
    for corner in range(3):
        start = corner_at_all(surfaces, row, corner)
        end = corner_at_all(surfaces, row, (corner + 1) % 3)
        nearest = wp.min(nearest, distance_to_line(start, end, position))
    return nearest


@dataclass(frozen=True, eq=False)
class TriangleCode:
    """Functions of triangles; `row` is what row_of gives.

    Attributes:
        row_of: `(surfaces, prim) -> row`.
        table_row: `(row) -> int32`, the row in arrays that do not depend on where a triangle stands.
        front_of: `(surfaces, row) -> vec3`.
        corner_at, normal_at, uv_at, color_at: `(surfaces, row, corner) -> vec3 or vec2`.
        position_at: `(surfaces, row, u, v) -> vec3`.
        clearance: `(surfaces, prim, position) -> float32`.
    """

    row_of: wp.Function
    table_row: wp.Function
    front_of: wp.Function
    corner_at: wp.Function
    normal_at: wp.Function
    uv_at: wp.Function
    color_at: wp.Function
    position_at: wp.Function
    clearance: wp.Function


PLAIN = TriangleCode(
    triangles.row_of,
    triangles.table_row,
    triangles.front_of,
    triangles.corner_at,
    triangles.normal_at,
    triangles.uv_at,
    triangles.color_at,
    triangles.position_at,
    triangles.clearance,
)
ALL = TriangleCode(
    row_of_all,
    table_row_of_all,
    front_of_all,
    corner_at_all,
    normal_at_all,
    uv_at_all,
    color_at_all,
    position_at_all,
    clearance_of_all,
)


def make_triangles(instances: bool) -> TriangleCode:
    """The functions for scenes with or without instances."""
    return ALL if instances else PLAIN
