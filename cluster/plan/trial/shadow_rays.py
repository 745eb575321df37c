"""How many shadow rays go from what the camera sees, by photon mapping: more where they take little beside all else.

The plan, maps and records are made once for an image, whatever its samples. Where these are few, more shadow rays of
each hardly make the whole dearer, and leave less noise.
"""

from __future__ import annotations

from wdpm.cluster.plan.trial.figures import Trial
from wdpm.cluster.plan.trial.prices import FINDING_OUT, Prices
from wdpm.cluster.render_settings import RenderSettings

MORE = 8
"""Shadow rays, where there are more than by default. Twelve were better in one of nine scenes."""

LEAST_LEFT = 0.72
"""Of the noise of samples, what they leave at least: of scenes with much of it (materials, envmap, sponza and
breakfast-room, 4 samples) 0.69 to 0.78."""

LEAST_SAVED = 0.95
"""Of error times price, what must be left at most for it."""

MOST_SAMPLES = 2**16
"""Of a pixel, for it: places of samples are counted by their shadow rays."""


def shadow_rays(prices: Prices, trial: Trial, settings: RenderSettings, noise_share: float, price: float) -> int:
    """By error times price.

    Args:
        prices: of the maps as they will be.
        trial: with the shadow rays by default, or one where there is one lamp without extent: more are of no use there.
        noise_share: share of the error that samples make.
        price: of the whole with the shadow rays of the trial, but for the plan: of what is done once that is a part.
    """
    usual = settings.algorithm.shadow_rays
    tried = trial.by_photons.light_samples
    if tried != usual or settings.samples_of_pass > MOST_SAMPLES:
        return tried
    error = 1.0 - noise_share * (1.0 - _left(trial))
    dearer = 1.0 + prices.of_more_rays(MORE - usual) / (FINDING_OUT + price)
    return MORE if error * dearer <= LEAST_SAVED else usual


def _left(trial: Trial) -> float:
    """Of the noise of samples, what more shadow rays leave.

    Paths had one shadow ray, photon mapping `usual`. One part of the noise is thought to fall as their number grows,
    the other to stay: that of the ways that glass or metal sends light.
    """
    by_one, by_usual = trial.by_paths.of_direct, trial.by_photons.of_direct
    if not by_one > by_usual > 0.0:
        return 1.0
    usual = trial.by_photons.light_samples
    falls = (by_one - by_usual) / (1.0 - 1.0 / usual)  # of the noise of one
    return max(LEAST_LEFT, 1.0 - falls * (1.0 / usual - 1.0 / MORE) / by_usual)


def rays_in_words(rays: int) -> tuple[str, ...]:
    """What was chosen, for people; nothing where it is as ever."""
    if rays != MORE:
        return ()
    return (f"shadow rays: {rays} of each camera sample, as they take little beside what is done once for the image",)
