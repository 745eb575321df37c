"""What a polygon that glows evenly gives to a place, by Lambert's formula."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def polygon_irradiance(corners: Array, point: Array, normal: Array) -> float:
    """Irradiance of a polygon of radiance 1 wholly above the horizon (Lambert 1760)."""
    arms = corners - point
    arms = arms / np.linalg.norm(arms, axis=1, keepdims=True)
    total = 0.0
    for one, other in zip(arms, np.roll(arms, -1, axis=0), strict=True):
        axis = np.cross(one, other)
        total += np.arccos(np.clip(one @ other, -1, 1)) * float(normal @ axis) / float(np.linalg.norm(axis))
    return abs(total) / 2
