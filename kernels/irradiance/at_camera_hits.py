"""What irradiance records tell of places that the camera sees: whether they serve there, and what is reflected of it.

One kernel for what places_of_paths, a look at the material's sides and interpolate would do one after another.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.camera.vertices import CACHED, TRACE_ON
from wdpm.kernels.constants import INV_PI
from wdpm.kernels.irradiance.cache import CAPACITY, STACK_CAPACITY, interpolated
from wdpm.kernels.irradiance.gather_places import place_of_path
from wdpm.kernels.irradiance.record_tree import IrradianceCache
from wdpm.kernels.rays.cell_triangles import Surfaces

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

OF_RECORDS: dict[str, Any] = {
    "code": wp.int32,
    "value": wp.vec3,
    "grazing": wp.float32,
    "length": wp.float32,
    "asked": wp.bool,
}
"""What `read_records` tells of each hit."""


@wp.kernel
def read_records(
    surfaces: Surfaces,
    cache: IrradianceCache,
    sides: wp.array[wp.int32],
    paths: Paths,
    offset: wp.int32,
    code_out: wp.array[wp.int32],
    value_out: wp.array[wp.vec3],
    grazing_out: wp.array[wp.float32],
    length_out: wp.array[wp.float32],
    asked_out: wp.array[wp.bool],
) -> None:
    """What a white Lambertian surface reflects by irradiance records.

    Args:
        sides: of each material, as scenes.flat.material_sides.even_sides has them.
        paths: without a diffuse scattering so far, whose final hits lie in this cell.
        code_out: CACHED where a record reaches, else TRACE_ON.
        value_out: radiance; zero where none reaches.
        grazing_out: how much its light grazes the surface (kernels.maths.schlick).
        length_out: of the ray [scene units].
        asked_out: whether records may serve there.
    """
    i = offset + wp.tid()
    stack = wp.zeros(shape=(STACK_CAPACITY,), dtype=wp.int32)
    found = wp.zeros(shape=(CAPACITY,), dtype=wp.uint64)
    place = place_of_path(surfaces, paths, i)
    front = place.side & 1
    code = wp.int32(TRACE_ON)
    value = wp.vec3(0.0)
    grazing = wp.float32(0.0)
    asked = (sides[place.side >> 1] & (2 - front)) != 0
    if asked:
        told = interpolated(cache, place.position, place.shading_normal, stack, found)
        if told.weight > 0.0:
            code = CACHED
            value = told.irradiance * INV_PI
            grazing = told.grazing
    code_out[i] = code
    value_out[i] = value
    grazing_out[i] = grazing
    length_out[i] = place.length
    asked_out[i] = asked
