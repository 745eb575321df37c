"""Which of two ways to render is better, and by what figures."""

from __future__ import annotations

from dataclasses import dataclass, replace

PATCHES = 4.0
"""What error of maps and records counts by beside that of samples: it is alike in many pixels, and seen where grain of
the same error is not."""


@dataclass(frozen=True)
class Way:
    """What an image is expected to come to by one integrator.

    Attributes:
        error: as relMSE.
        price: see Prices.
        of_caustics: the part of the error that caustics make.
        of_maps: the part of it that samples do not lessen.
    """

    error: float
    price: float
    of_caustics: float = 0.0
    of_maps: float = 0.0

    @property
    def worth(self) -> float:
        """Error times price, of which the least is best."""
        return self.error * self.price

    @property
    def as_seen(self) -> Way:
        """The same with the error of maps as it is seen."""
        return replace(self, error=self.error + (PATCHES - 1.0) * self.of_maps)

    def is_better_than(self, other: Way) -> bool:
        """Whether it has the smaller error for the same price; or, where trials saw none of either, is cheaper."""
        if not self.error and not other.error:
            return self.price < other.price
        return self.worth < other.worth


def words_for(paths: Way, photons: Way, bound: str = "") -> str:
    """Which of both is better, and by what figures.

    Args:
        bound: before what is expected, where that is a bound.
    """
    name = "path" if paths.is_better_than(photons) else "photons"
    price = f"{paths.price / photons.price:.2g} of the price"
    caustics = f", {paths.of_caustics:.2g} of it by caustics" if paths.of_caustics else ""
    if not paths.error and not photons.error:
        return f"{name}, since trials saw no noise by either, and path tracing is expected to take {price} of photons"
    if not photons.error:
        return f"{name}, since a trial saw no noise by photons, and by path tracing relMSE {paths.error:.2g}{caustics}"
    ratio = paths.worth / photons.worth
    return (
        f"{name}, since error times price of path tracing is expected to be {bound}{ratio:.2g} of that of photons "
        f"(relMSE {paths.error:.2g}{caustics}, against {photons.error:.2g}, for {price})"
    )
