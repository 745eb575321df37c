"""Where camera paths meet surfaces: what can be told of a vertex before its material is looked up."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.rays import Paths
from wdpm.kernels.materials.surface import Surfaces, position_at, row_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def places_of_paths(
    surfaces: Surfaces,
    paths: Paths,
    offset: wp.int32,
    position_out: wp.array[wp.vec3],
    normal_out: wp.array[wp.vec3],
    shading_normal_out: wp.array[wp.vec3],
    length_out: wp.array[wp.float32],
    side_out: wp.array[wp.int32],
) -> None:
    """Final hits that lie in this cell, seen from where their paths come.

    Args:
        position_out: of each hit, as surface_at computes it.
        normal_out: unit geometric normal on the seen side.
        shading_normal_out: unit interpolated normal, in the hemisphere of the geometric one; no map bends it.
        length_out: of the ray that hit it [scene units].
        side_out: 2 * material + 1 where the front is seen, 2 * material where the back is.
    """
    i = offset + wp.tid()
    row = row_of(surfaces, paths.prim[i])
    u = paths.u[i]
    v = paths.v[i]
    direction = paths.direction[i]
    normal = surfaces.front[row]
    shading = normal
    if surfaces.smooth[row] == 1:
        a = 1.0 - u - v
        blend = surfaces.normals[row, 0] * a + surfaces.normals[row, 1] * u + surfaces.normals[row, 2] * v
        if wp.dot(blend, normal) > 0.0:
            shading = wp.normalize(blend)
    front = wp.dot(normal, direction) < 0.0
    if (wp.dot(shading, direction) < 0.0) != front:
        shading = normal
    if not front:
        normal = -normal
        shading = -shading
    position_out[i] = position_at(surfaces, row, u, v)
    normal_out[i] = normal
    shading_normal_out[i] = shading
    length_out[i] = paths.t[i] * wp.length(direction)
    side_out[i] = 2 * surfaces.material[row] + wp.int32(front)
