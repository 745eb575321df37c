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

from wdpm.kernels.constants import INV_PI
from wdpm.kernels.maths.directions import around

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

REFLECTED = wp.constant(wp.float32(0.5))
"""Share of the light that surfaces are taken to reflect. How much they do does not matter: it shares out rays."""

_TINY = wp.constant(wp.float32(2.0**-126))

_A0, _A1, _A2, _A3, _A4, _A5 = (
    wp.constant(wp.float32(a)) for a in (0.15915424, -0.05299681, 0.03112904, -0.0192753, 0.00912454, -0.00213623)
)
"""Of atan(s) / (2 pi s) as a polynomial in s², for s from 0 to 1: it is off by 5.3e-7 at most (a fit at Chebyshev's
nodes)."""


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
def _turns_of(y: wp.float32, x: wp.float32) -> wp.float32:
    """Angle of the point (x, y) from the x axis, in turns from 0 to 1; to 6e-7, which is enough to tell strata apart.

    Some 10 ns less than the angle rounded correctly: half a million places are asked about for an image.
    """
    across = wp.abs(x)
    up = wp.abs(y)
    slope = wp.min(across, up) / wp.max(wp.max(across, up), _TINY)
    s = slope * slope
    turns = slope * (_A0 + s * (_A1 + s * (_A2 + s * (_A3 + s * (_A4 + s * _A5)))))
    if up > across:
        turns = 0.25 - turns
    if x < 0.0:
        turns = 0.5 - turns
    if y < 0.0:
        turns = 1.0 - turns
    return turns


@wp.func
def stratum_of(cosine2: wp.float32, x: wp.float32, y: wp.float32, rows: wp.int32, columns: wp.int32) -> wp.int32:
    """The stratum that a direction above the shading normal lies in: the inverse of records.stratum_direction.

    Args:
        cosine2: of its angle to the normal, squared.
        x, y: its parts along the axes of the frame about the normal (maths.directions.around), of whatever length.
    """
    row = wp.min(wp.int32(wp.max(1.0 - cosine2, 0.0) * wp.float32(rows)), rows - 1)
    column = wp.min(wp.int32(_turns_of(y, x) * wp.float32(columns)), columns - 1)
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
    front = normal[i]
    n = shading_normal[i]
    across = around(n, wp.vec3(1.0, 0.0, 0.0))
    along = around(n, wp.vec3(0.0, 1.0, 0.0))
    of_place = wp.float32(rows * columns) * (REFLECTED * INV_PI * INV_PI)
    for k in range(places.power.shape[0]):
        way = places.position[k] - x
        # Cosines times the distance: most places are told by these to see nothing of the record.
        arriving = wp.dot(way, n)
        leaving = -wp.dot(way, places.normal[k])
        if arriving > 0.0 and leaving > 0.0 and wp.dot(way, front) > 0.0:
            distance2 = wp.dot(way, way)
            if distance2 > 0.0:
                within = wp.max(distance2, places.radius[k] * places.radius[k])
                sent = places.power[k] * of_place * ((arriving / distance2) * (leaving / within))
                cosine2 = (arriving / distance2) * arriving
                stratum = stratum_of(cosine2, wp.dot(way, across), wp.dot(way, along), rows, columns)
                radiance_out[i, stratum] = radiance_out[i, stratum] + sent
