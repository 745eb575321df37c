"""What a person asks of a render in place of its settings: an error, a time, or both."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from wdpm.images.comparison import RELATIVE_FLOOR
from wdpm.scenes.errors import SettingsError

LEAST_SECONDS = 1.0
"""Of a time budget: what a process takes to start."""


class Metric(Enum):
    """How far an image is off, as `wdpm compare` has it."""

    RELMSE = "relmse"
    """Mean of (a - b)² / (b² + 0.01)."""
    RMSE = "rmse"
    """Root of the mean of (a - b)²."""

    @property
    def is_relative(self) -> bool:
        """Whether an error is one in comparison with the truth."""
        return self is Metric.RELMSE

    def weight(self, *images: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of a pixel's squared error.

        Args:
            images: stand for the reference; where there are several, the weight is the geometric mean of theirs.
        """
        if self is Metric.RMSE:
            return np.ones_like(images[0])
        product = np.ones_like(images[0])
        for image in images:
            product *= image**2 + RELATIVE_FLOOR
        weight: NDArray[np.float64] = product ** (-1.0 / len(images))
        return weight

    def figure(self, mean_square: float) -> float:
        """From the weighted mean of squared errors."""
        return math.sqrt(max(mean_square, 0.0)) if self is Metric.RMSE else mean_square

    def mean_square(self, figure: float) -> float:
        """The inverse of `figure`."""
        return figure**2 if self is Metric.RMSE else figure


@dataclass(frozen=True)
class Goal:
    """When a render is done: at the error or at the time, whichever comes first.

    Attributes:
        error: that the image may have; None for any.
        metric: that it is measured with.
        seconds: wall-clock time from the start of the process to the image on disk; None for any.

    Raises:
        SettingsError: neither is given, or one is out of range.
    """

    error: float | None = None
    metric: Metric = Metric.RELMSE
    seconds: float | None = None

    def __post_init__(self) -> None:
        if self.error is None and self.seconds is None:
            raise SettingsError("neither an error nor a time is asked for; give until_error or time_budget")
        if self.error is not None and not (math.isfinite(self.error) and self.error > 0):
            raise SettingsError(f"until_error is {self.error}; expected a positive number, like 0.02")
        if self.seconds is not None and not (math.isfinite(self.seconds) and self.seconds >= LEAST_SECONDS):
            raise SettingsError(
                f"time_budget is {self.seconds} s; expected at least {LEAST_SECONDS:g} s, as a process takes to start"
            )

    @property
    def mean_square(self) -> float:
        """The error asked for as a weighted mean of squares; infinite if any will do."""
        return math.inf if self.error is None else self.metric.mean_square(self.error)


def goal_of(error: float | None, metric: str = Metric.RELMSE.value, seconds: float | None = None) -> Goal:
    """A goal by the name of its metric. Raises SettingsError: see Goal, and for an unknown name."""
    names = [each.value for each in Metric]
    if metric not in names:
        raise SettingsError(f"metric is {metric!r}; expected one of {', '.join(names)}")
    return Goal(error, Metric(metric), seconds)
