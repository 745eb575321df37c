"""How long a path tracer takes to an error: measured at some numbers of samples, and the law through them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from wdpm.bench.peers.mitsuba import Cost

E = TypeVar("E")


@dataclass(frozen=True)
class Point(Generic[E]):
    """An image with `spp` samples a pixel."""

    spp: int
    error: E
    cost: Cost


@dataclass(frozen=True)
class Answer:
    """What an error takes.

    Attributes:
        spp: samples a pixel.
        cost: of them.
        extrapolated: whether no more or no fewer samples than that were measured.
    """

    spp: float
    cost: Cost
    extrapolated: bool


@dataclass(frozen=True)
class ErrorLaw:
    """error = constant / samples: a path tracer has noise alone, and relMSE is a variance.

    Attributes:
        points: measured; at least one.
    """

    points: tuple[Point[float], ...]

    @property
    def constant(self) -> float:
        """Geometric mean of error x samples over the points; 0 where an image was without error."""
        if any(point.error == 0 for point in self.points):
            return 0.0
        return math.exp(float(np.mean([math.log(point.error * point.spp) for point in self.points])))

    @property
    def slope(self) -> float | None:
        """Of a free line through the points, log error over log samples: -1 if the law holds.

        None of a single number of samples, or where an image was without error.
        """
        if len({point.spp for point in self.points}) < 2 or self.constant == 0:
            return None
        x, y = (np.log([getattr(point, name) for point in self.points]) for name in ("spp", "error"))
        return float(np.polyfit(x, y, 1)[0])

    @property
    def longest(self) -> Point[float]:
        """The one with the most samples."""
        return max(self.points, key=lambda point: point.spp)

    def to(self, error: float, speed: Point[float] | None = None) -> Answer:
        """What an error takes, at the speed of a render: the longest, unless another is given."""
        return self.with_samples(max(1.0, self.constant / error), speed)

    def with_samples(self, spp: float, speed: Point[float] | None = None) -> Answer:
        """What so many samples take, at the speed of a render: the longest, unless another is given."""
        speed = speed or self.longest
        cost = Cost(speed.cost.wall_s * spp / speed.spp, speed.cost.cpu_s * spp / speed.spp)
        return Answer(spp, cost, not min(point.spp for point in self.points) <= spp <= self.longest.spp)

    def beyond(self, error: float) -> Answer:
        """What an error takes of a renderer that has work besides its samples: time is a line through its points.

        That line goes through those with the fewest and with the most samples; with one of them, through nothing.
        """
        spp, most = max(1.0, self.constant / error), self.longest
        least = min(self.points, key=lambda point: point.spp)
        if least.spp == most.spp:
            return self.with_samples(spp)

        def at(low: float, high: float) -> float:
            return max(0.0, high + (high - low) * (spp - most.spp) / (most.spp - least.spp))

        cost = Cost(at(least.cost.wall_s, most.cost.wall_s), at(least.cost.cpu_s, most.cost.cpu_s))
        return Answer(spp, cost, not least.spp <= spp <= most.spp)
