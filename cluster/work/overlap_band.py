"""Which photons and surface points lie near a part of space: in the band around a cell, of which copies are kept there,
or within reach of the photons at which irradiance is worked out somewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays, take
from wdpm.kernels.rays.cells import FAR_AWAY


def rows_near(
    position: NDArray[np.float32], low: NDArray[np.float32], high: NDArray[np.float32], distance: float
) -> NDArray[np.intp]:
    """The points that lie in a box or no further from it than a distance."""
    if (low <= -FAR_AWAY).all() and (high >= FAR_AWAY).all():
        return np.arange(len(position))  # the only cell
    rows = np.arange(len(position))
    square = np.zeros(len(position))
    for axis in range(3):  # most are ruled out by the first axis or two, and not looked at again
        along = position[rows, axis]
        outside = np.maximum(np.maximum(low[axis] - along, along - high[axis]), 0.0).astype(np.float64)
        square += outside**2
        near = np.flatnonzero(square <= distance**2)
        rows, square = rows[near], square[near]
    return rows


def rows_in_bands(
    low: NDArray[np.float32], high: NDArray[np.float32], bands: Sequence[float], number: int, columns: Arrays
) -> NDArray[np.intp]:
    """Rows of those in a box, or no further from it than the band of their map."""
    return rows_near(columns["position"], low, high, bands[number])


@dataclass(frozen=True, eq=False)
class Region:
    """A box in which somebody works out irradiance at photons.

    Attributes:
        low, high: its corners, of which the low one is in it, float32, shape [3].
        reach: of gathers there.
    """

    low: NDArray[np.float32]
    high: NDArray[np.float32]
    reach: float

    def within(self, position: NDArray[np.float32]) -> NDArray[np.intp]:
        """Rows of the places that lie in the box."""
        return _rows_between(position, self.low, self.high)

    def near(self, position: NDArray[np.float32]) -> NDArray[np.intp]:
        """Rows of the places that gathers in the box may find, and of some at its corners that none does."""
        reach = np.float32(self.reach)
        return _rows_between(position, self.low - reach, self.high + reach)

    def photons(self, photons: Arrays, number: int) -> Arrays:
        """Photons of which those of one map are left out that no gather in the box finds."""
        wanted = photons["map"] != number
        wanted[self.near(photons["position"])] = True
        return take(photons, np.flatnonzero(wanted))


def _rows_between(
    position: NDArray[np.float32], low: NDArray[np.float32], high: NDArray[np.float32]
) -> NDArray[np.intp]:
    """Rows of the places that are at least `low` and below `high` along each axis."""
    rows = np.arange(len(position))
    for axis in range(3):  # most are ruled out by the first bounds, and not looked at again
        for bound, beyond in ((low[axis], np.greater_equal), (high[axis], np.less)):
            if np.isfinite(bound):
                rows = rows[beyond(position[rows, axis], bound)]
    return rows


def along(position: NDArray[np.float32], step: float) -> tuple[NDArray[np.float32], ...]:
    """Keys that sort places along a line through slabs of a width, ties as they come."""
    slabs = np.floor(position[:, 1:] / np.float32(step))
    return position[:, 0], slabs[:, 0], slabs[:, 1]
