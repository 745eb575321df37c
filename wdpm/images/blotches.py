"""Blotches: how much of an image's error is as wide as a person sees at once.

The same squared error is grain if neighbouring pixels err independently, and blotches if whole areas err together:
what an interpolation between few places, or the look-up of few photons, leaves behind. Figures for single pixels cannot
tell these apart; the spectrum of the error can. That of grain is white: each frequency has the same share of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WIDTH = 16
"""Waves of the error that are longer than this are blotches [pixels]: with fewer, edges that are a pixel off would be
counted as such."""

LARGEST = 1.0
"""Errors count up to this: a single bright pixel has as white a spectrum as there is, and would hide all others."""

LEAST = 1e-24
"""Power of an error that is none: roundings of its mean."""


@dataclass(frozen=True)
class Blotches:
    """The part of an image's relative error whose waves are longer than WIDTH pixels, without the mean.

    Attributes:
        error: its root mean square, as a share of the light there.
        times: its power, over what it would be of white noise with the power of the whole error; 1 for grain.
    """

    error: float
    times: float

    def in_words(self) -> str:
        """For people."""
        return f"{self.error:.2%} over {WIDTH} pixels and more, {self.times:.1f} times that of white noise"


def blotches(relative: NDArray[np.float64]) -> Blotches | None:
    """The blotches of an image against a reference.

    Args:
        relative: what the image is off by, as a share of the light there, shape [height, width, 3]. What is not finite
            counts as right.

    Returns:
        None where the image is too small to have any, or all of it is off alike.
    """
    error = np.where(np.isfinite(relative), relative, 0.0).mean(axis=2).clip(-LARGEST, LARGEST)
    power = np.abs(np.fft.fft2(error - error.mean()) / error.size) ** 2
    height, width = error.shape
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.fftfreq(width)[None, :])
    of_blotches, of_all = (frequency > 0) & (frequency < 1 / WIDTH), frequency > 0
    total, low = float(power[of_all].sum()), float(power[of_blotches].sum())
    if not of_blotches.any() or total <= LEAST:
        return None
    white = total * np.count_nonzero(of_blotches) / np.count_nonzero(of_all)
    return Blotches(float(np.sqrt(low)), low / white)
