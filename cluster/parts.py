"""The parts of a camera sample: where each contribution of each vertex of a path stands in the sum.

A vertex has one part for each of its shadow rays, then one each for what it emits, for photons of the global and of the
caustic map, and for the stretch of medium before it. Parts are added in the order of their places, so the sum does not
depend on when they come home. Beyond a diffuse scattering that was traced, all of them are indirect light: those parts
have places of their own, after all others.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.kernels.limits import CHAIN_LIMIT
from wdpm.kernels.shading import BEAM_PART, BOUNCES, EMISSION_PART, PARTS

EMISSION: Final = int(EMISSION_PART)
INDIRECT: Final = 1
CAUSTIC: Final = 2
BEAM: Final = int(BEAM_PART)

LAST_BOUNCE: Final = CHAIN_LIMIT
"""Of a path that has used up its vertices."""

DIRECT_LAYER, INDIRECT_LAYER, CAUSTIC_LAYER, VOLUME_LAYER = range(4)

_LAYER_OF_PART = np.array([DIRECT_LAYER, INDIRECT_LAYER, CAUSTIC_LAYER, VOLUME_LAYER], np.int32)


def place_of(
    bounce: NDArray[np.int32], diffuse: NDArray[np.int32], part: int, light_samples: int
) -> NDArray[np.int32]:
    """The places of one part, EMISSION .. BEAM, of some vertices.

    Args:
        diffuse: diffuse scatterings that were traced before each vertex.
    """
    row = bounce + np.where(diffuse > 0, np.int32(BOUNCES), np.int32(0))
    return (row * np.int32(light_samples + PARTS) + np.int32(light_samples + part)).astype(np.int32)


def bounce_of(place: NDArray[np.int32], light_samples: int) -> NDArray[np.int32]:
    """The vertices that places belong to."""
    return (place // (light_samples + int(PARTS)) % int(BOUNCES)).astype(np.int32)


def layer_of(place: NDArray[np.int32], light_samples: int) -> NDArray[np.int32]:
    """Which layer of the image each place belongs to."""
    row, column = np.divmod(place, light_samples + int(PARTS))
    part = column - light_samples
    layer = np.where(part < 0, DIRECT_LAYER, _LAYER_OF_PART[np.maximum(part, 0)])
    indirect = (row >= int(BOUNCES)) & (layer != VOLUME_LAYER)
    return np.where(indirect, INDIRECT_LAYER, layer).astype(np.int32)


def credit_of_vertex(light_samples: int) -> int:
    """Credit of what a vertex starts besides the ray that goes on: result, caustics, shadow rays, stretch of medium."""
    return 3 + light_samples


def credit_of(bounce: NDArray[np.int32], light_samples: int) -> int:
    """Credit of some rays of camera paths: enough for all vertices that each may still have."""
    return int((LAST_BOUNCE + 1 - bounce.astype(np.int64)).sum()) * credit_of_vertex(light_samples)


def credit_of_camera_ray(light_samples: int) -> int:
    """Credit of a ray that leaves the camera."""
    return (LAST_BOUNCE + 1) * credit_of_vertex(light_samples)
