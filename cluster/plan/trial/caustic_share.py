"""How many samples of a pixel ask the caustic map: all of them, or one for several.

A gather of the caustic map takes about half as long as the rest of a sample. Where what it shows is nearly the same for
all samples of a pixel, since the photons that a gather takes lie much further apart than the pixel is wide, one that
asks may count for several: the mean stays, and what is added to the noise of the image is the difference that there is
among samples, so many times. A trial tells that difference by the photons of the pilot. (Splitting, as of Arvo & Kirk
1990: the rest of a sample is taken several times for each gather.)
"""

from __future__ import annotations

import numpy as np

from wdpm.cluster.plan.map_plans import MapPlans
from wdpm.cluster.plan.map_worth import irradiance_by
from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.plan.small_view import SeenPlaces, Values
from wdpm.cluster.plan.trial.figures import Trial
from wdpm.cluster.plan.trial.prices import Prices
from wdpm.cluster.render_settings import RenderSettings
from wdpm.kernels.constants import INV_PI
from wdpm.kernels.photons.deposits import CAUSTIC_MAP

SHARES = (1, 2, 4, 8)
"""1 of so many samples asks."""

LEAST_ASKING = 4
"""Samples of a pixel that ask, at least, on average: edges are smooth, and parts of an image that take half as many
samples as others still have whole runs."""

MOST_GRAIN = 0.25
"""Of the noise of all else, what caustics may add at most: the pilot's gathers are wider than those of the render, and
see less of what differs within a pixel."""

LEAST_SAVED = 0.95
"""Of error times price, what must be left at most for it."""

ASKED_PLACES = 2048
"""Places at which the pilot is asked, about: those of some pixels, with all their samples."""


def caustic_grain(pilot: PhotonPilot, places: SeenPlaces, truth: Values, samples: int, epsilon: float) -> float:
    """What a sample's caustics differ from those of its pixel, squared, of every pixel, as relMSE.

    Args:
        places: that samples of a trial ask maps at.
        truth: what its pixels show without caustics, about, shape [height, width, 3].
        samples: of each pixel.
        epsilon: as in relMSE.
    """
    pixel = places.all("pixel")
    if not len(pixel) or samples < 2 or not len(pilot.photons[CAUSTIC_MAP]["id"]):
        return 0.0
    every = -(-len(pixel) // ASKED_PLACES)
    rows = np.flatnonzero(pixel % every == 0)
    brought = irradiance_by(pilot, CAUSTIC_MAP, places.all("position")[rows], places.all("normal")[rows])
    seen = brought * places.all("weight")[rows].mean(axis=1, dtype=np.float64) * float(INV_PI)
    some = -(-truth.shape[0] * truth.shape[1] // every)
    by_sample = np.zeros((some, samples))
    np.add.at(by_sample, (pixel[rows] // every, places.all("sample")[rows]), seen)
    radiance = truth.mean(axis=2).reshape(-1)[::every] + by_sample.mean(axis=1)
    return float((by_sample.var(axis=1, ddof=1) / (radiance**2 + epsilon)).mean())


def caustic_share(prices: Prices, plans: MapPlans, trial: Trial, settings: RenderSettings) -> int:
    """1 of how many samples of a pixel asks the caustic map, by error times price.

    Args:
        prices, plans: of the maps as they will be.
    """
    error, spp = trial.map_errors[CAUSTIC_MAP], settings.samples_of_pass
    if error is None or not plans.maps[CAUSTIC_MAP].paths:
        return 1
    noise = trial.noise_by(settings)

    def worth(share: int) -> float:
        grain = (noise + share * trial.caustic_grain) / spp
        of_map = error.of(plans.expected[CAUSTIC_MAP], -(-spp // share))
        return (grain + of_map) * prices.of_photons(trial, settings, share)

    few = [share for share in SHARES if share * LEAST_ASKING <= spp]
    worths = {share: worth(share) for share in few if share * trial.caustic_grain <= MOST_GRAIN * noise}
    if len(worths) < 2:
        return 1
    best = min(worths, key=lambda share: worths[share])
    return best if worths[best] <= LEAST_SAVED * worths[1] else 1


def share_in_words(share: int) -> tuple[str, ...]:
    """What was chosen, for people; nothing where there was no choice."""
    if share == 1:
        return ()
    return (f"caustics: 1 of {share} samples of a pixel asks their map for all, as what these see of it is much alike",)
