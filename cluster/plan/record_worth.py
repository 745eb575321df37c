"""How good irradiance records need be: as good as is seen beside the noise of the samples.

What a record gets wrong shows as a blotch, wherever samples leave less noise than that. In a cathedral that lamps light
evenly they do; in a room that the sky lights through its windows hardly a blotch is seen, and gather rays that make
records better still would take most of the time. So a trial of a few thousand samples tells the noise of one, of a part
of the image that is not the noisiest, and records get as many gather rays as it takes to err less than that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from wdpm.cluster.plan.light_guide import Learnt
from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.plan.small_view import (
    Halves,
    Values,
    box_blurred,
    mean_but_for_chance,
    relmse_epsilon,
    small_camera,
    without_photons,
)
from wdpm.cluster.plan.trial.prices import least_rays, tolerance_for
from wdpm.cluster.plan.view import SAMPLES_OF_PLAN
from wdpm.cluster.records import CachePlan
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.kernels.camera.pixel_filter import noise_left
from wdpm.scenes.flat.flatten import FlatScene

TRIAL_PIXELS = 1024
"""Of the image of a trial that tells how noisy one sample is."""

SEEN_SAMPLES = 2
"""In passes of so many samples what a trial has seen is not looked at again, which would take some 3 % of their
time. That of more samples, which are spread over pixels and lamps, is less noise a sample than a tolerance is told by:
in a court under the sky, with 16, records were made so much better for it that the image took a third more time."""

NOISIEST = 0.1
"""Share of the image that is not looked at, the noisiest: blotches are seen in the rest of it."""


@dataclass(frozen=True, eq=False)
class SampleNoise:
    """What a trial that chose the integrator has seen already.

    Attributes:
        noise: squared error of one sample of each pixel, as relMSE, shape [height, width].
        indirect: the mean square of indirect light, weighted likewise.
    """

    noise: Values
    indirect: float


@dataclass(frozen=True)
class RecordWorth:
    """How good records are to be.

    Attributes:
        tolerance: relative standard error, with SAMPLES_OF_PLAN samples a pixel, as CachePlan.tolerance.
        least_rays: as CachePlan has it.
    """

    tolerance: float
    least_rays: float

    def plan(self, cache: CachePlan) -> CachePlan:
        """The plan of records that may err so much: they get fewer rays, and reach further where things are near.

        Samples that are so many times noisier are worth as many times fewer, squared, and records are made for so few
        (wdpm.rendering.pass_plan.worth).
        """
        clearance = cache.clearance * math.sqrt(self.tolerance / cache.tolerance)
        return replace(cache, tolerance=self.tolerance, clearance=clearance, least_rays=self.least_rays)


def worth_of_records(
    flat: FlatScene,
    pilot: PhotonPilot,
    settings: RenderSettings,
    learnt: Learnt,
    cache: CachePlan,
    seen: SampleNoise | None = None,
) -> RecordWorth:
    """How good records are to be.

    Args:
        pilot: that was flown for these settings.
        learnt: how shadow rays choose among lights.
        cache: with the least tolerance, which it is where records get no rays for it.
        seen: what a trial has seen; None to look now.
    """
    if not cache.extra:
        return RecordWorth(cache.tolerance, cache.least_rays)
    least = cache.least_rays
    if seen is None or settings.samples_of_pass > SEEN_SAMPLES:  # all rays of records
        seen = _look(flat, pilot, settings, learnt)
    else:
        least = least_rays(mean_but_for_chance(seen.noise) / settings.samples_of_pass, seen.indirect)
    noise = _but_the_noisiest(seen.noise) / SAMPLES_OF_PLAN
    return RecordWorth(max(cache.tolerance, tolerance_for(noise, seen.indirect)), least)


def _look(flat: FlatScene, pilot: PhotonPilot, settings: RenderSettings, learnt: Learnt) -> SampleNoise:
    """A small image twice, by paths and without indirect light."""
    looking = replace(flat, camera=small_camera(flat.camera, TRIAL_PIXELS))
    paths = Integrator.PATH
    without = tuple(effect for effect in settings.without if effect not in paths.algorithm.cannot_leave_out)
    whole = replace(settings, integrator=paths, indirect=Indirect.MAP, light_samples=1, without=without)
    with without_photons(pilot) as worker:
        without_indirect = Halves(looking, worker, replace(settings, indirect=Indirect.MAP), learnt)
        by_path = Halves(looking, worker, whole, learnt)
    seen = box_blurred(np.mean([half["beauty"] for half in by_path.layers], axis=0))
    weight = 1.0 / (seen**2 + relmse_epsilon(seen))
    noise = without_indirect.noise(weight).mean(axis=2) * noise_left(flat.camera.filter)
    return SampleNoise(noise, by_path.figures(weight).indirect)


def records_in_words(tolerance: float, cache: CachePlan) -> tuple[str, ...]:
    """What was decided of the records, for people; nothing where they are as exact as they may be."""
    if tolerance <= cache.tolerance:
        return ()
    return (f"irradiance records: with an error of {tolerance:.2g}, since samples are so noisy that it is not seen",)


def _but_the_noisiest(noise: Values) -> float:
    """Mean over pixels, the noisiest ones left out."""
    ascending = np.sort(noise, axis=None)
    return float(ascending[: max(1, round(len(ascending) * (1.0 - NOISIEST)))].mean())
