"""Where lights shine first, for the gather rays of irradiance records: photons of a few thousand paths tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.lit_places import NO_LIT_PLACES, LitPlaces
from wdpm.cluster.plan.photon_pilot import PhotonPilot, direct_photons
from wdpm.cluster.plan.view import share_of_rays
from wdpm.cluster.records import CachePlan

PLACES = 512
"""Places, at most: each then stands for so little light that one by itself calls for no rays."""

LEAST_PLACES = 128
"""Of passes of few samples: beside their noise, and with hemispheres of as few strata, it is enough. Every record asks
about all of them."""

NEIGHBOURS = 4
"""Of a place, within its radius."""


def lit_places(pilot: PhotonPilot, cache: CachePlan, samples: int) -> LitPlaces:
    """A sample of the places that light comes to straight from the lights.

    Args:
        cache: plan of the irradiance records; there are none where it has no extra rays to share out.
        samples: of a pixel, in a pass.
    """
    if not cache.rounds or not cache.extra or not pilot.world.global_map.paths:
        return NO_LIT_PLACES
    photons, paths = direct_photons(pilot)
    count = len(photons["id"])
    if count <= NEIGHBOURS:
        return NO_LIT_PLACES
    chosen = np.linspace(0, count - 1, min(_places(samples), count)).astype(np.intp)
    position = photons["position"][chosen]
    power = photons["flux"][chosen].mean(axis=1, dtype=np.float64) * (count / len(chosen) / paths)
    # A photon's normal is on the side that it came to, front or not.
    return LitPlaces(position, photons["normal"][chosen], power.astype(np.float32), _radius(position))


def _places(samples: int) -> int:
    """In proportion to the strata of a record, as far as they are few."""
    return max(round(PLACES * min(2.0 * share_of_rays(samples), 1.0)), LEAST_PLACES)


def _radius(position: NDArray[np.float32]) -> NDArray[np.float32]:
    """Distance of the nearest NEIGHBOURS others, shape [P]."""
    across = [position[:, None, axis].astype(np.float64) - position[None, :, axis] for axis in range(3)]
    distance2 = across[0] ** 2 + across[1] ** 2 + across[2] ** 2
    nearest = np.partition(distance2, NEIGHBOURS, axis=1)[:, NEIGHBOURS]
    return np.sqrt(nearest).astype(np.float32)
