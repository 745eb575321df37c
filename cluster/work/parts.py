"""The parts of a camera sample: where each contribution of each vertex of a path stands in the sum.

A vertex has one part for each of its shadow rays, then one each for what it emits, for photons of the global and of the
caustic map, for the stretch of medium before it, and for how far the ray went, where that is asked. Parts are added in
the order of their places, so the sum does not
depend on when they come home. Beyond a diffuse scattering that was traced, all of them are indirect light, and beyond
one in a medium they are light of the medium: those parts have places of their own, after all others. A lamp that the
ray of the first diffuse scattering meets is direct light, as it is for the shadow rays that it shares the work with.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.runs import Numbers, Runs
from wdpm.kernels.camera.vertices import (
    BEAM_PART,
    BOUNCES,
    CAUSTIC_PART,
    EMISSION_PART,
    INDIRECT_PART,
    MEDIUM_SECTION,
    PARTS,
    REACH_PART,
    SEEN_SECTION,
    SURFACE_SECTION,
)
from wdpm.kernels.limits import CHAIN_LIMIT

EMISSION: Final = int(EMISSION_PART)
INDIRECT: Final = int(INDIRECT_PART)
CAUSTIC: Final = int(CAUSTIC_PART)
BEAM: Final = int(BEAM_PART)
REACH: Final = int(REACH_PART)

LAST_BOUNCE: Final = CHAIN_LIMIT
"""Of a path that has used up its vertices."""

DIRECT_LAYER, INDIRECT_LAYER, CAUSTIC_LAYER, VOLUME_LAYER = range(4)

_SEEN, _SURFACE, _MEDIUM = np.array([SEEN_SECTION, SURFACE_SECTION, MEDIUM_SECTION], np.int32)

_NO_LAYER = -1
_LAYER_OF_PART = np.array([DIRECT_LAYER, INDIRECT_LAYER, CAUSTIC_LAYER, VOLUME_LAYER, _NO_LAYER], np.int32)


def place_of(bounce: NDArray[np.int32], diffuse: NDArray[np.int32], part: int, light_samples: int) -> NDArray[np.int32]:
    """The places of one part, EMISSION .. REACH, of some vertices.

    Args:
        diffuse: as in kernels.ray_fields.PATH.
    """
    beyond = diffuse > (1 if part == EMISSION else 0)
    section = np.where(beyond, _SURFACE, np.where(diffuse < 0, _MEDIUM, _SEEN))
    row = bounce + section * np.int32(BOUNCES)
    place: NDArray[np.int32] = row * np.int32(light_samples + PARTS) + np.int32(light_samples + part)
    return place


def bounce_of(place: NDArray[np.int32], light_samples: int) -> NDArray[np.int32]:
    """The vertices that places belong to."""
    return (place // (light_samples + int(PARTS)) % int(BOUNCES)).astype(np.int32)


def layer_of(place: NDArray[np.int32], light_samples: int) -> NDArray[np.int32]:
    """Which layer of the image each place belongs to.

    Args:
        place: none is negative.
    """
    places = int(place.max(initial=0)) + 1
    if places >= len(place):
        return _layers(place, light_samples)
    # Many parts have few different places: what each of those is, is worked out once.
    return _layers(np.arange(places, dtype=np.int32), light_samples).take(place)


def _layers(place: NDArray[np.int32], light_samples: int) -> NDArray[np.int32]:
    row, column = np.divmod(place, light_samples + int(PARTS))
    part = column - light_samples
    layer = np.where(part < 0, DIRECT_LAYER, _LAYER_OF_PART[np.maximum(part, 0)])
    section = row // int(BOUNCES)
    layer = np.where(section == int(SURFACE_SECTION), INDIRECT_LAYER, layer)
    return np.where(section == int(MEDIUM_SECTION), VOLUME_LAYER, layer).astype(np.int32)


def is_of_gather_ray(place: NDArray[np.int32], light_samples: int) -> NDArray[np.bool_]:
    """Which places are beyond a diffuse scattering on a surface that was traced."""
    row = place // np.int32(light_samples + PARTS)
    beyond: NDArray[np.bool_] = row // np.int32(BOUNCES) == _SURFACE
    return beyond


def part_of(place: NDArray[np.int32], light_samples: int) -> NDArray[np.int32]:
    """Which part each place is of: EMISSION .. REACH, negative for a shadow ray."""
    return (place % np.int32(light_samples + PARTS) - np.int32(light_samples)).astype(np.int32)


def credit_of_vertex(light_samples: int) -> int:
    """Credit of what a vertex starts besides the ray that goes on: result, caustics, shadow rays, stretch of medium."""
    return 3 + light_samples


def credit_of(runs: Runs, bounce: NDArray[np.int32], light_samples: int) -> Numbers:
    """Credit of some rays of camera paths: enough for all vertices that they may still have, shape [runs].

    Args:
        runs: whose the rays are.
        bounce: of each ray, shape [rays].
    """
    return (runs.rows * (LAST_BOUNCE + 1) - runs.sums(bounce)) * credit_of_vertex(light_samples)


def credit_of_camera_ray(light_samples: int) -> int:
    """Credit of a ray that leaves the camera."""
    return (LAST_BOUNCE + 1) * credit_of_vertex(light_samples)
