"""Which photons and surface points lie in the band around a cell, of which its neighbours' copies are kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.kernels.rays.cells import FAR_AWAY


def rows_near(
    position: NDArray[np.float32], low: NDArray[np.float32], high: NDArray[np.float32], distance: float
) -> NDArray[np.intp]:
    """The points that lie in a box or no further from it than a distance."""
    if (low <= -FAR_AWAY).all() and (high >= FAR_AWAY).all():
        return np.arange(len(position))  # the only cell
    outside = np.maximum(np.maximum(low - position, position - high), 0.0).astype(np.float64)
    return np.flatnonzero((outside**2).sum(axis=1) <= distance**2)


def rows_in_band(
    low: NDArray[np.float32], high: NDArray[np.float32], bands: Sequence[float], number: int, columns: Arrays
) -> NDArray[np.intp]:
    """Rows of those in a box, or no further from it than the band of their map."""
    return rows_near(columns["position"], low, high, bands[number])
