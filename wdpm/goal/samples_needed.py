"""How many samples an error asks for: before anything is rendered, and once a few passes tell."""

from __future__ import annotations

import math

from wdpm.goal.convergence import Estimate

USUAL_NOISE = 0.01
"""relMSE times samples of an ordinary scene, where no trial has told it: on ten scenes 0.001 to 0.15."""

BESIDE_TRIAL = 2.0
"""Noise of an image over what the trial of a plan tells of it, which sees no outlines and no records: on ten scenes 1
to 4, and 10 behind glass. With few samples the estimate, too, says more than there is (convergence.py)."""

BIAS_SHARE = 0.8
"""Of an error asked for, what bias may be at most for noise to be lessened until both together are within it."""

SURELY = 1.05
"""As many times the samples that are expected to do: one pass more would cost more."""

LEAST_MORE = 1.25
"""As many times the samples so far are rendered at least, where they do not do: each pass makes photons of its own."""

MOST_GROWTH = 8.0
"""As many times the samples so far are rendered at most before the estimate is made again: of two samples it may be
twice what they leave."""


def samples_by_trial(noise: float | None, mean_square: float) -> float:
    """Samples a pixel that an error is likely to ask for.

    Args:
        noise: of one sample of each pixel, as relMSE, as the trial of a plan saw it; None where there was none.
        mean_square: error asked for.
    """
    if noise is None:
        return USUAL_NOISE / mean_square
    return BESIDE_TRIAL * noise / mean_square


def samples_by_estimate(estimate: Estimate, samples: int, mean_square: float, most_growth: float = MOST_GROWTH) -> int:
    """Samples a pixel in all after which the estimate is expected to be within an error.

    Noise falls with their number, and its interval with it; bias is as it is. Where its interval takes up most of what
    is asked for, that may be noise as well, and is taken to fall.

    Args:
        estimate: of the mean of so many samples.
        most_growth: as many times these at most.
    """
    bias, noise = estimate.bias, estimate.noise
    least = min(bias.value, BIAS_SHARE * mean_square)
    wider = min(bias.high - bias.value, BIAS_SHARE * mean_square - least)
    rest = mean_square - least
    # share * value + hypot(share * spread, wider) = rest, for the share of the noise that may be left
    value, spread = noise.value, noise.high - noise.value
    if not value > 0:
        return samples
    low, high = 0.0, 1.0
    for _ in range(50):
        share = (low + high) / 2.0
        low, high = (low, share) if share * value + math.hypot(share * spread, wider) > rest else (share, high)
    wanted = max(SURELY / max(low, 1e-9), LEAST_MORE) * samples
    return math.ceil(min(wanted, most_growth * samples))
