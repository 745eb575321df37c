"""In which part of space each team works out irradiance at photons, where none needs all photons for that.

Gather rays read irradiance that was worked out ahead at some photons. Where nothing else reads the global map, a team
needs but the photons near those at which it works irradiance out: with regions that are compact, a small share of all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.session import Session
from wdpm.cluster.world import NO_REGIONS

LEAST_PLACES = 32
"""Of the sample, in each region: fewer say nothing of its size."""

SORTING = 1.0
"""What it takes to sort a photon into a tree, over all else that is done with it: who has all photons shares that."""


def regions_of(session: Session, teams: int) -> NDArray[np.float32]:
    """The region of each team, as protocol.BuildMaps has them; none where all need all photons, or nearly."""
    world, places = session.world, session.places
    if teams == 1 or world.top_tree.cells > 1 or not world.gathers_ahead or len(places) < LEAST_PLACES * teams:
        return NO_REGIONS
    regions = _divided(places, teams)
    held = np.mean([_near(places, region, world.global_map.radius) for region in regions])
    worth = held * (1.0 + SORTING) < 1.0 + SORTING / teams
    return regions if worth else NO_REGIONS


def _divided(places: NDArray[np.float32], parts: int) -> NDArray[np.float32]:
    """Boxes with as many places each, about: halved across the longest side, float32, shape [parts, 2, 3]."""
    if parts == 1:
        return np.stack([np.full((1, 3), -np.inf, np.float32), np.full((1, 3), np.inf, np.float32)], axis=1)
    axis = int(np.argmax(np.ptp(places, axis=0))) if len(places) else 0
    few = parts // 2
    plane = np.sort(places[:, axis])[len(places) * few // parts] if len(places) else np.float32(0)
    low, high = _divided(places[places[:, axis] < plane], few), _divided(places[places[:, axis] >= plane], parts - few)
    low[:, 1, axis] = np.minimum(low[:, 1, axis], plane)
    high[:, 0, axis] = np.maximum(high[:, 0, axis], plane)
    return np.concatenate([low, high])


def _near(places: NDArray[np.float32], region: NDArray[np.float32], reach: float) -> float:
    """The share of the places that lie in a region, or no further from it than `reach`."""
    outside = np.maximum(np.maximum(region[0] - places, places - region[1]), 0.0)
    return float(np.mean((outside**2).sum(axis=1) <= reach**2))
