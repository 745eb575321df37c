"""Fresnel's formula in double precision."""

from __future__ import annotations

import numpy as np
from furnaces import Array


def fresnel(cosine: Array, eta: float) -> Array:
    """Reflectance of an interface for unpolarised light."""
    inside = np.sqrt(1 - (1 - cosine**2) / eta**2)
    s = (cosine - eta * inside) / (cosine + eta * inside)
    p = (inside - eta * cosine) / (inside + eta * cosine)
    return np.asarray((s**2 + p**2) / 2)
