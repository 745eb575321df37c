"""Picks settings by what trials measured: those that reach an error soonest, or come nearest to the truth in a time.

The model of an image of N passes of s samples each, with q_i the squared radius of pass i as a share of the first's:

    time  = start + N (pass_cost + s sample_cost)              (less the passes that the trial rendered already)
    noise = pass_noise mean(1 / q_i) / N                       (a narrower disc holds fewer photons)
            + g(N s) sample_noise / (N s)                      (all samples of a pixel are stratified together)
            + rare (2 / (N s))^1.4 + lone pixels               (the estimate's fear of rare bright samples)
    bias² = bias mean(q_i)

The irradiance records of a pass have rays by its samples (pass_plan.worth): their part of pass_cost grows as the rays
do, and RECORD_NOISE of pass_noise falls with them.

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

from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.convergence import LEAST_PASSES
from wdpm.goal.trial import MARGIN, TRIED, Trial, stratified
from wdpm.rendering.pass_plan import ALPHA, PassPlan, share_of_rays

MOST_PASSES = 4096
MOST_SPP = 64
"""Samples of a pass. More would make passes so long that a render could not stop soon after it is good enough."""

RECORD_NOISE = 0.8
"""Of the noise that samples do not lessen, the part of the records' gather rays, where there are records."""

RARE_POWER = 1.4
"""Measured on scenes with and without caustics: between 0.9 and 2.2."""

LIKELY_NONE = math.log(2.0)
"""Pixels expected, of which as likely as not there is none (Poisson)."""

BY_PHOTONS = 0.5
"""Of a pass's cost without samples, what fewer photons can be relied on to save, until they are tried: the rest may be
what each pass takes whatever its photons."""

FACTORS = (1 / 4, 1, 4)
"""Of photons, around those that were tried."""

MOST_PHOTONS = 4_000_000
"""In a map of one pass: some 64 bytes each, and as much again while its tree is built."""


@dataclass(frozen=True)
class Schedule:
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
    def ready(self) -> bool:
        """Whether the renderer of the trial goes on: with passes of one sample, as it has been told it would have."""
        return self.trial.ready and self.samples == 1

    @property
    def ends_at_once(self) -> bool:
        """Whether the first pass, which the trial has rendered, is known to be good enough."""
        return self.ready and self.passes == 1 and self.trial.at_once is not None

    @property
    def error(self) -> float:
        """Weighted mean square; not a number where nothing was measured."""
        return self.noise + self.bias if self.trial.measured else math.nan


def with_photons(trial: Trial, factor: float) -> Trial:
    """What is expected of the same trial with `factor` times the photons in all maps, and the same k."""
    if factor == 1:
        return trial
    old = trial.settings
    names = ("photons", "caustic_photons", "volume_photons")
    settings = replace(old, **{name: min(round(getattr(old, name) * factor), MOST_PHOTONS) for name in names})
    most = max(getattr(old, name) for name in names)
    factor = max(getattr(settings, name) for name in names) / most if most else 1.0
    times = factor if factor > 1 else 1.0 - BY_PHOTONS + BY_PHOTONS * factor
    cost = (trial.pass_cost - trial.record_cost) * times + trial.record_cost
    bias, likely = trial.bias / factor, trial.likely_bias / factor
    return replace(trial, settings=settings, pass_cost=cost, bias=bias, likely_bias=likely, results={}, ready=False)


def pass_cost(trial: Trial, samples: int) -> float:
    """Seconds of a pass but for its samples."""
    return trial.pass_cost + trial.record_cost * (_rays(samples) - 1.0)


def pass_noise(trial: Trial, samples: int) -> float:
    """Mean square of one pass that samples do not lessen."""
    by_records = RECORD_NOISE if trial.record_cost > 0 else 0.0
    return trial.pass_noise * (1.0 - by_records + by_records / _rays(samples))


def _rays(samples: int) -> float:
    """Gather rays of a record, of those that it has in a trial."""
    return share_of_rays(samples) / share_of_rays(1)


def schedule_of(trial: Trial, passes: int, samples: int, *, likely: bool = False) -> Schedule:
    """What is expected of so many passes, by the model above; of the likely bias, not of the most that it may be."""
    inverse, mean = _shares(passes)
    biased = trial.settings.algorithm.biased
    kept = sum(PassPlan(number, number * samples, samples) in trial.results for number in range(min(passes, 2)))
    total = passes * samples
    by_samples = stratified(total) * trial.sample_noise / total + _feared(trial, total)
    noise = pass_noise(trial, samples) * (inverse if biased else 1.0) / passes + by_samples
    return Schedule(
        replace(trial.settings, passes=passes, spp=passes * samples),
        trial,
        (0.0 if trial.ready and samples == 1 else trial.start)
        + (passes - kept) * (pass_cost(trial, samples) + samples * trial.sample_cost),
        noise,
        (trial.likely_bias if likely else trial.bias) * mean,
    )


def _feared(trial: Trial, samples: int) -> float:
    """What the estimate adds to the noise for fear of rare bright samples."""
    return trial.rare * (TRIED / samples) ** RARE_POWER + lone_left(trial.lone, samples)


def lone_left(lone: tuple[float, ...], samples: int) -> float:
    """What is feared, as likely as not, of pixels that one sample of two saw far too bright, after more samples.

    Until a sample of the other half sees it too, what is feared of such a pixel falls with the square of their
    number n. If any share of the pixel may be bright, as likely one as another, m samples leave it unseen with a
    probability of 6 / ((m + 2) (m + 3)). It is a single pixel that counts, so the mean says little: as likely as not,
    no pixel is left of the largest of which less than one is expected to be.
    """
    if not lone:
        return 0.0
    other = samples / 2.0
    unseen = min(12.0 / ((other + 2.0) * (other + 3.0)), 1.0)
    gone = math.ceil(LIKELY_NONE / unseen) - 1
    return sum(lone[gone:]) * unseen * (TRIED / samples) ** 2


def soonest(trials: Iterable[Trial], mean_square: float, *, likely: bool = False) -> Schedule | None:
    """The schedule that is expected to be known to have reached an error soonest; None if none does.

    Args:
        likely: take bias to be what it is estimated to be, not the most that it may be.
    """
    found = [
        reaching
        for trial in trials
        for samples in _powers_of_two()
        if (reaching := _first_to_reach(trial, samples, mean_square, likely)) is not None
    ]
    return min(found, key=lambda each: each.seconds, default=None)


def nearest(trials: Iterable[Trial], seconds: float) -> Schedule:
    """The schedule with the least expected error of those that fit into a time; the shortest if none fits."""
    fitting, shortest = [], []
    for trial in trials:
        for samples in _powers_of_two():
            one = pass_cost(trial, samples) + samples * trial.sample_cost
            passes = int(min(max((seconds - trial.start) / max(one, 1e-9), 1), MOST_PASSES))
            each = schedule_of(trial, passes, samples)
            shortest.append(each)
            # Many short passes: the last ends close to the time, whatever was expected of them.
            if each.seconds <= seconds and (passes >= LEAST_PASSES or samples == 1):
                fitting.append(replace(each, noise=each.noise * (1 + 1 / passes)))
    return (
        min(fitting, key=lambda e: (not e.trial.measured, e.noise + e.bias))
        if fitting
        else min(shortest, key=lambda e: e.seconds)
    )


def _first_to_reach(trial: Trial, samples: int, mean_square: float, likely: bool) -> Schedule | None:
    """With the fewest passes that do."""

    def reaches(passes: int) -> bool:
        return MARGIN * schedule_of(trial, passes, samples, likely=likely).error <= mean_square

    high = LEAST_PASSES
    while not reaches(high):
        high *= 2
        if high > MOST_PASSES:
            return None
    low = max(high // 2, LEAST_PASSES)
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if reaches(middle) else (middle + 1, high)
    return schedule_of(trial, high, samples, likely=likely)


def _powers_of_two() -> list[int]:
    return [2**i for i in range(int(math.log2(MOST_SPP)) + 1)]


@cache
def _shares(passes: int) -> tuple[float, float]:
    """Means over passes of 1 / q and of q."""
    share = np.cumprod(np.append(1.0, (np.arange(1, passes) + ALPHA) / (np.arange(1, passes) + 1)))
    return float((1.0 / share).mean()), float(share.mean())
