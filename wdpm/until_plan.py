"""Picks settings by what trials measured: those that reach an error soonest, or come nearest to the truth in a time.

The model of an image of N passes of s samples each, with q_i the squared radius of pass i as a share of the first's:

    time  = start + N (pass_cost + s sample_cost)                   (less the passes that the trial rendered already)
    noise = (pass_noise mean(1 / q_i) + 0.8 sample_noise / s) / N   (a narrower disc holds fewer photons)
            + rare (2 / (N s))^1.5                                  (the estimate's fear of rare bright samples)
    bias² = bias mean(q_i)

Bias falls as the squared radius, and bias² as its square, where light varies smoothly; along edges, where bias is
largest, bias² falls as the radius. Its first power lies between. More photons in a pass make discs smaller, at the same
k: noise stays, and bias falls. Another k need not be tried: k and photons divided by as much are passes of the same
radius, of which as many more cost the same photons and leave the same noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from wdpm.kernels.settings import Integrator, RenderSettings
from wdpm.pass_plan import ALPHA, PassPlan
from wdpm.until_gauge import LEAST_PASSES
from wdpm.until_trial import Trial

MOST_PASSES = 4096
MOST_SPP = 64
"""Samples of a pass. More would make passes so long that a render could not stop soon after it is good enough."""

STRATIFIED = 0.8
"""Of half the squared difference of two successive samples, what each of 8 to 16 adds to the noise of their mean: they
share out a pixel evenly. Measured: 0.7 to 0.9."""

RARE_POWER = 1.5
"""Measured on scenes with and without caustics: between 0.9 and 2.2."""

MARGIN = 1.1
"""Upper end of an estimate over the estimate."""

FACTORS = (1 / 4, 1, 4)
"""Of photons, around those that were tried."""

MOST_PHOTONS = 4_000_000
"""In a map of one pass: some 64 bytes each, and as much again while its tree is built."""


@dataclass(frozen=True)
class Course:
    """What to render, and what is expected of it.

    Attributes:
        settings: with passes and samples.
        trial: that it follows from.
        seconds: from the first pass to the last.
        noise, bias: expected, as weighted mean squares.
    """

    settings: RenderSettings
    trial: Trial
    seconds: float
    noise: float
    bias: float

    @property
    def passes(self) -> int:
        return self.settings.passes

    @property
    def samples(self) -> int:
        """Of each pass."""
        return self.settings.spp // self.settings.passes

    @property
    def error(self) -> float:
        """Weighted mean square."""
        return self.noise + self.bias


def with_photons(trial: Trial, factor: float) -> Trial:
    """What is expected of the same trial with `factor` times the photons in all maps, and the same k."""
    if factor == 1:
        return trial
    old = trial.settings
    names = ("photons", "caustic_photons", "volume_photons")
    settings = replace(old, **{name: min(round(getattr(old, name) * factor), MOST_PHOTONS) for name in names})
    most = max(getattr(old, name) for name in names)
    factor = max(getattr(settings, name) for name in names) / most if most else 1.0
    return replace(trial, settings=settings, pass_cost=trial.pass_cost * factor, bias=trial.bias / factor, results={})


def course(trial: Trial, passes: int, samples: int) -> Course:
    """What is expected of so many passes, by the model above."""
    inverse, mean = _shares(passes)
    biased = trial.settings.integrator is Integrator.PHOTONS
    kept = sum(PassPlan(number, number * samples, samples) in trial.results for number in range(min(passes, 2)))
    rare = trial.rare * (2 / (passes * samples)) ** RARE_POWER
    noise = (
        trial.pass_noise * (inverse if biased else 1.0) + STRATIFIED * trial.sample_noise / samples
    ) / passes + rare
    return Course(
        replace(trial.settings, passes=passes, spp=passes * samples),
        trial,
        trial.start + (passes - kept) * (trial.pass_cost + samples * trial.sample_cost),
        noise,
        trial.bias * mean,
    )


def soonest(trials: Iterable[Trial], mean_square: float, least: int = LEAST_PASSES) -> Course | None:
    """The course that is expected to be known to have reached an error soonest; None if none does."""
    found = [
        reaching
        for trial in trials
        for samples in _powers_of_two()
        if (reaching := _first_to_reach(trial, samples, mean_square, least)) is not None
    ]
    return min(found, key=lambda each: each.seconds, default=None)


def nearest(trials: Iterable[Trial], seconds: float) -> Course:
    """The course with the least expected error of those that fit into a time; the shortest if none fits."""
    fitting, shortest = [], []
    for trial in trials:
        for samples in _powers_of_two():
            one = trial.pass_cost + samples * trial.sample_cost
            passes = int(min(max((seconds - trial.start) / max(one, 1e-9), 1), MOST_PASSES))
            each = course(trial, passes, samples)
            shortest.append(each)
            # Many short passes: the last ends close to the time, whatever was expected of them.
            if each.seconds <= seconds and (passes >= LEAST_PASSES or samples == 1):
                fitting.append(replace(each, noise=each.noise * (1 + 1 / passes)))
    return min(fitting, key=lambda e: e.error) if fitting else min(shortest, key=lambda e: e.seconds)


def _first_to_reach(trial: Trial, samples: int, mean_square: float, least: int) -> Course | None:
    """With the fewest passes that do."""

    def reaches(passes: int) -> bool:
        return MARGIN * course(trial, passes, samples).error <= mean_square

    high = least
    while not reaches(high):
        high *= 2
        if high > MOST_PASSES:
            return None
    low = max(high // 2, least)
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if reaches(middle) else (middle + 1, high)
    return course(trial, high, samples)


def _powers_of_two() -> list[int]:
    return [2**i for i in range(int(math.log2(MOST_SPP)) + 1)]


@cache
def _shares(passes: int) -> tuple[float, float]:
    """Means over passes of 1 / q and of q."""
    share = np.cumprod(np.append(1.0, (np.arange(1, passes) + ALPHA) / (np.arange(1, passes) + 1)))
    return float((1.0 / share).mean()), float(share.mean())
