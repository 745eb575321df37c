"""Where camera paths meet surfaces: what can be told of a vertex before its material is looked up."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.instanced_triangles import (
    front_of_all,
    normal_at_all,
    position_at_all,
    row_of_all,
    table_row_of_all,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Places:
    """Vertices before their materials are looked up.

    Attributes:
        position: as surface_at computes it [scene units].
        normal: unit geometric normal on the seen side.
        shading_normal: unit interpolated normal, in the hemisphere of the geometric one; no map bends it.
        length: of the ray that hit it [scene units].
        side: 2 * material + 1 where the front is seen, 2 * material where the back is.
    """

    position: wp.array[wp.vec3]
    normal: wp.array[wp.vec3]
    shading_normal: wp.array[wp.vec3]
    length: wp.array[wp.float32]
    side: wp.array[wp.int32]


@wp.struct
class Place:
    """One of them."""

    position: wp.vec3
    normal: wp.vec3
    shading_normal: wp.vec3
    length: wp.float32
    side: wp.int32


@wp.func
def place_at(
    surfaces: wp.ref[Surfaces], direction: wp.vec3, t: wp.float32, prim: wp.int32, u: wp.float32, v: wp.float32
) -> Place:
    """Where a ray in a direction, whose final hit lies in this cell, has arrived."""
    row = row_of_all(surfaces, prim)
    held = table_row_of_all(row)
    normal = front_of_all(surfaces, row)
    shading = normal
    if surfaces.smooth[held] == 1:
        a = 1.0 - u - v
        blend = normal_at_all(surfaces, row, 0) * a + normal_at_all(surfaces, row, 1) * u
        blend = blend + normal_at_all(surfaces, row, 2) * v
        if wp.dot(blend, normal) > 0.0:
            shading = wp.normalize(blend)
    front = wp.dot(normal, direction) < 0.0
    if (wp.dot(shading, direction) < 0.0) != front:
        shading = normal
    if not front:
        normal = -normal
        shading = -shading
    place = Place()
    place.position = position_at_all(surfaces, row, u, v)
    place.normal = normal
    place.shading_normal = shading
    place.length = t * wp.length(direction)
    place.side = 2 * surfaces.material[held] + wp.int32(front)
    return place


@wp.func
def place_of_path(surfaces: wp.ref[Surfaces], paths: wp.ref[Paths], i: wp.int32) -> Place:
    """Where path i has arrived."""
    return place_at(surfaces, paths.direction[i], paths.t[i], paths.prim[i], paths.u[i], paths.v[i])


@wp.kernel
def places_of_paths(surfaces: Surfaces, paths: Paths, offset: wp.int32, places_out: Places) -> None:
    """Final hits that lie in this cell, seen from where their paths come."""
    i = offset + wp.tid()
    place = place_of_path(surfaces, paths, i)
    places_out.position[i] = place.position
    places_out.normal[i] = place.normal
    places_out.shading_normal[i] = place.shading_normal
    places_out.length[i] = place.length
    places_out.side[i] = place.side
