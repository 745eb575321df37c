"""What gather rays read where they arrive: the place, the nearest irradiance, and whether the ray ends there.

One kernel for what places_of_paths, read_irradiance and a comparison of each ray's length would do one after another.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.camera.vertices import CACHED, TRACE_ON
from wdpm.kernels.irradiance.at_photons import SEARCH_STACK, grazing_at, nearest_point, radius_at, value_at
from wdpm.kernels.irradiance.gather_places import Place, place_of_path
from wdpm.kernels.photons.photon_map import PhotonMap
from wdpm.kernels.rays.cell_triangles import Surfaces

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ARRIVALS: dict[str, Any] = {
    "code": wp.int32,
    "value": wp.vec3,
    "grazing": wp.float32,
    "length": wp.float32,
    "found": wp.bool,
}
"""What `read_arrivals` tells of each ray."""


@wp.struct
class Arrival:
    """What a gather ray reads where it arrives.

    Attributes:
        code: CACHED where it reads and ends, else TRACE_ON.
        value: what it reads; zero where it goes on.
        grazing: how much that light grazes the surface (kernels.maths.schlick).
        found: 1 where there is a point within reach.
    """

    code: wp.int32
    value: wp.vec3
    grazing: wp.float32
    found: wp.int32


@wp.func
def arrive(
    points: wp.ref[PhotonMap], place: Place, diffuse: wp.int32, reach: wp.float32, stack: wp.array[wp.uint64]
) -> Arrival:
    """What a gather ray reads at a place. A ray shorter than what it would read is blurred over goes on, once.

    Args:
        points: irradiance at photons.
        diffuse: as in kernels.ray_fields.PATH, above 0.
        reach: most distant point to read [scene units].
        stack: scratch, at least SEARCH_STACK.
    """
    found = nearest_point(points, place.position, place.normal, reach, stack)
    arrival = Arrival()
    arrival.code = TRACE_ON
    if found.place >= 0:
        arrival.found = 1
        if place.length >= radius_at(points, found.place) or diffuse > 1:
            arrival.code = CACHED
            arrival.value = value_at(points, found.place)
            arrival.grazing = grazing_at(points, found.place)
    return arrival


@wp.kernel
def read_arrivals(
    surfaces: Surfaces,
    points: PhotonMap,
    paths: Paths,
    reach: wp.float32,
    offset: wp.int32,
    code_out: wp.array[wp.int32],
    value_out: wp.array[wp.vec3],
    grazing_out: wp.array[wp.float32],
    length_out: wp.array[wp.float32],
    found_out: wp.array[wp.bool],
) -> None:
    """Irradiance that gather rays read. See `arrive`.

    Args:
        paths: gather rays (diffuse > 0) whose final hits lie in this cell.
        code_out: CACHED where a ray reads and ends, else TRACE_ON.
        value_out: what it reads; zero where it goes on.
        grazing_out: how much that light grazes the surface.
        length_out: of the ray [scene units].
        found_out: whether there is a point within reach.
    """
    i = offset + wp.tid()
    stack = wp.zeros(shape=(SEARCH_STACK,), dtype=wp.uint64)
    place = place_of_path(surfaces, paths, i)
    arrival = arrive(points, place, paths.diffuse[i], reach, stack)
    code_out[i] = arrival.code
    value_out[i] = arrival.value
    grazing_out[i] = arrival.grazing
    length_out[i] = place.length
    found_out[i] = arrival.found == 1
