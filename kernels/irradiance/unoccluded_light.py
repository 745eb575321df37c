"""What lit places would send to irradiance records if nothing stood in between, by stratum of their hemispheres.

Rays find a small bright thing by chance: the inside of a lamp's cup, a patch of sun across a large room. Where lights
shine is known from photons (cluster.lit_places), as it is for instant radiosity (Keller 1997), and tells which strata
need more rays than the radiance around them calls for.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.constants import INV_PI, PI
from wdpm.kernels.maths.directions import around
from wdpm.kernels.maths.elementary import atan2_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

REFLECTED = wp.constant(wp.float32(0.5))
"""Share of the light that surfaces are taken to reflect. How much they do does not matter: it shares out rays."""


@wp.struct
class VirtualLights:
    """Places that light comes to straight from the lights, as cluster.lit_places has them.

    Attributes:
        position: [scene units].
        normal: unit, on the lit side.
        power: light that each stands for, mean of RGB [W].
        radius: of the area that each stands for: from nearer it sends no more [scene units].
    """

    position: wp.array[wp.vec3]
    normal: wp.array[wp.vec3]
    power: wp.array[wp.float32]
    radius: wp.array[wp.float32]


def upload(
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
    power: NDArray[np.float32],
    radius: NDArray[np.float32],
    device: str = "cpu",
) -> Any:
    """VirtualLights on a device."""
    places = VirtualLights()
    places.position, places.normal = (wp.array(a, dtype=wp.vec3, device=device) for a in (position, normal))
    places.power, places.radius = (wp.array(a, dtype=wp.float32, device=device) for a in (power, radius))
    return places


@wp.func
def stratum_of(direction: wp.vec3, normal: wp.vec3, rows: wp.int32, columns: wp.int32) -> wp.int32:
    """The stratum that a unit direction above the shading normal lies in: the inverse of records.stratum_direction."""
    cosine = wp.dot(direction, normal)
    x = wp.dot(direction, around(normal, wp.vec3(1.0, 0.0, 0.0)))
    y = wp.dot(direction, around(normal, wp.vec3(0.0, 1.0, 0.0)))
    turns = atan2_of(y, x) * (0.5 / PI)
    turns = turns - wp.floor(turns)
    row = wp.min(wp.int32(wp.max(1.0 - cosine * cosine, 0.0) * wp.float32(rows)), rows - 1)
    column = wp.min(wp.int32(turns * wp.float32(columns)), columns - 1)
    return row * columns + column


@wp.kernel
def unoccluded_radiance(
    places: VirtualLights,
    position: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    shading_normal: wp.array[wp.vec3],
    rows: wp.int32,
    columns: wp.int32,
    offset: wp.int32,
    radiance_out: wp.array2d[wp.float32],
) -> None:
    """N records, one thread a record.

    Args:
        position: of each record [scene units] [N].
        normal: unit geometric normals on the seen side [N].
        shading_normal: unit [N].
        radiance_out: mean over each stratum, mean of RGB [W/(m² sr)] [N, rows * columns]. Zeros before.
    """
    i = offset + wp.tid()
    x = position[i]
    n = shading_normal[i]
    of_irradiance = wp.float32(rows * columns) * INV_PI
    for k in range(places.power.shape[0]):
        way = places.position[k] - x
        distance2 = wp.dot(way, way)
        if distance2 > 0.0 and wp.dot(way, normal[i]) > 0.0:
            direction = way / wp.sqrt(distance2)
            arriving = wp.dot(direction, n)
            leaving = -wp.dot(direction, places.normal[k])
            if arriving > 0.0 and leaving > 0.0:
                within = wp.max(distance2, places.radius[k] * places.radius[k])
                sent = places.power[k] * (REFLECTED * INV_PI) * (arriving * leaving / within)
                stratum = stratum_of(direction, n, rows, columns)
                radiance_out[i, stratum] = radiance_out[i, stratum] + sent * of_irradiance
