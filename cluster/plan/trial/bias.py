"""What photon maps show beyond what paths do, in regions of a small picture.

A gather takes in photons of all surfaces about it that lie and face alike: where a floor goes on beneath a wall,
those of the other side as well, be it a sunny field. Halves of the pilot's photons cannot tell, since they have that in
common. But paths can: what they bring to a pixel, less what photon mapping finds there without its maps, is what the
maps have to show. It is noisy, so regions are held against each other, and what noise explains is no bias. What maps
show too little is not told here: the pilot's gathers do not count how much surface there is within them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import take
from wdpm.cluster.plan.map_plans import MapPlans
from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.plan.pilot_gathers import AmongPhotons
from wdpm.cluster.plan.small_view import Values
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP
from wdpm.kernels.photons.flight import BOUNCE_BITS

REGION = 4
"""Pixels of a trial along the side of a region."""

SURE = 4.0
"""Variances of a region's mean that its squared difference must exceed to be bias: where there is none, one region in
twenty does."""

LEAST_NEIGHBOURS = 4
"""Photons that gathers look for, at least: with fewer, most of them have the same few for noise."""


@dataclass(frozen=True, eq=False)
class MapQueries:
    """Places of a trial at which maps are asked.

    Attributes:
        position, normal: shape [P, 3].
        pixel: of each, shape [P].
        share: of irradiance there in the mean radiance of its pixel, shape [P].
    """

    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    pixel: NDArray[np.int32]
    share: Values


def map_bias(
    pilot: PhotonPilot, plans: MapPlans, k: int, queries: MapQueries, wanted: Sequence[Values], weight: Values
) -> float:
    """Square of what the global map shows too much, as relMSE.

    Args:
        k: photons that its gathers look for.
        wanted: what the maps have to show, by two halves of the samples, each of shape [height, width].
        weight: of each pixel's squared error, shape [height, width].
    """
    if not len(pilot.photons[GLOBAL_MAP]["id"]) or not len(queries.pixel):
        return 0.0
    gathered = [_shown(pilot, number, plans, each, queries, weight.shape) for number, each in _maps(plans, k)]
    root = np.sqrt(weight)
    # Light of caustics may be found by paths, or not: of what maps show the part that agrees is held against them.
    every = [
        _beyond_noise([(sum(maps[half] for maps in some) - wanted[half]) * root for half in (0, 1)])
        for some in (gathered[:1], gathered)
    ]
    return float(np.minimum(every[0], every[1]).mean())


def _maps(plans: MapPlans, k: int) -> tuple[tuple[int, int], tuple[int, int]]:
    return (GLOBAL_MAP, k), (CAUSTIC_MAP, plans.caustic_k)


def _shown(
    pilot: PhotonPilot, number: int, plans: MapPlans, k: int, queries: MapQueries, shape: tuple[int, ...]
) -> list[Values]:
    """What two halves of the pilot's photons show, by gathers as wide as those of the render, shape [height, width]."""
    photons, paths = pilot.photons[number], pilot.world.maps[number].paths
    path, shown = photons["id"] >> BOUNCE_BITS, []
    for odd in (0, 1):
        half = take(photons, np.flatnonzero(path % 2 == odd))
        count, irradiance = len(half["id"]), np.zeros(len(queries.pixel))
        if count and plans.maps[number].paths:
            fewer = max(round(k * count / max(plans.expected[number], 1.0)), min(LEAST_NEIGHBOURS, k))
            reach = plans.maps[number].radius
            found, _ = AmongPhotons(pilot.cell, half).gather(queries.position, queries.normal, reach, min(fewer, k))
            irradiance = found.astype(np.float64) * 2.0 / paths
        pixels = np.bincount(queries.pixel, queries.share * irradiance, shape[0] * shape[1]).astype(np.float64)
        shown.append(pixels.reshape(shape))
    return shown


def _beyond_noise(halves: Sequence[Values]) -> Values:
    """Squared means of regions where they are above zero, less what noise explains, flat.

    Args:
        halves: of the differences of pixels, each of shape [height, width].
    """
    means = [_regions(half) for half in halves]
    of_pixels = _regions((halves[0] - halves[1]) ** 2)
    side = [min(REGION, length) for length in halves[0].shape]
    # What photons get wrong by chance is alike in the pixels of a region, and the halves' means tell it.
    noise = np.maximum(of_pixels / (4.0 * side[0] * side[1]), (means[0] - means[1]) ** 2 / 4.0)
    return np.maximum(np.maximum((means[0] + means[1]) / 2.0, 0.0) ** 2 - SURE * noise, 0.0)


def _regions(image: Values) -> Values:
    """Means of regions, flat: what does not fill one at the right and below is left out."""
    height, width = (min(REGION, length) for length in image.shape)
    down, across = image.shape[0] // height, image.shape[1] // width
    whole = image[: down * height, : across * width].reshape(down, height, across, width)
    return np.asarray(whole.mean(axis=(1, 3))).reshape(-1)
