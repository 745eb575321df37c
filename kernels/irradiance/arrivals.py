"""What gather rays read where they arrive: the place, the nearest irradiance, and whether the ray ends there.

One kernel for what places_of_paths, read_irradiance and a comparison of each ray's length would do one after another.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.camera.vertices import CACHED, TRACE_ON
from wdpm.kernels.irradiance.at_photons import SEARCH_STACK, nearest_point, radius_at, value_at
from wdpm.kernels.irradiance.gather_places import place_of_path
from wdpm.kernels.photons.photon_map import PhotonMap
from wdpm.kernels.rays.cell_triangles import Surfaces

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ARRIVALS: dict[str, Any] = {"code": wp.int32, "value": wp.vec3, "length": wp.float32, "found": wp.bool}
"""What `read_arrivals` tells of each ray."""


@wp.kernel
def read_arrivals(
    surfaces: Surfaces,
    points: PhotonMap,
    paths: Paths,
    reach: wp.float32,
    offset: wp.int32,
    code_out: wp.array[wp.int32],
    value_out: wp.array[wp.vec3],
    length_out: wp.array[wp.float32],
    found_out: wp.array[wp.bool],
) -> None:
    """Irradiance that gather rays read. A ray shorter than what it would read is blurred over goes on, once.

    Args:
        points: irradiance at photons.
        paths: gather rays (diffuse > 0) whose final hits lie in this cell.
        reach: most distant point to read [scene units].
        code_out: CACHED where a ray reads and ends, else TRACE_ON.
        value_out: what it reads; zero where it goes on.
        length_out: of the ray [scene units].
        found_out: whether there is a point within reach.
    """
    i = offset + wp.tid()
    stack = wp.zeros(shape=(SEARCH_STACK,), dtype=wp.uint64)
    place = place_of_path(surfaces, paths, i)
    found = nearest_point(points, place.position, place.normal, reach, stack)
    code = wp.int32(TRACE_ON)
    value = wp.vec3(0.0)
    if found.place >= 0:
        if place.length >= radius_at(points, found.place) or paths.diffuse[i] > 1:
            code = CACHED
            value = value_at(points, found.place)
    code_out[i] = code
    value_out[i] = value
    length_out[i] = place.length
    found_out[i] = found.place >= 0
