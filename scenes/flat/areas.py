"""Areas and normals of triangles, computed in double: a cross product of needles cancels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.room import let_go

_AT_ONCE = 1 << 16
"""Triangles that are looked at together: in double, all of a large scene would take thrice what it holds."""


def triangle_areas(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    """Areas of triangles given by their corners, shape [T, 3, 3]; float64, shape [T]."""
    areas = np.empty(len(corners))
    for first in range(0, len(corners), _AT_ONCE):
        block = corners[first : first + _AT_ONCE]
        areas[first : first + _AT_ONCE] = 0.5 * np.linalg.norm(_cross(block), axis=1)
        let_go(block)
    return areas


def triangle_normals(corners: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit normals of triangles by their winding, float32, shape [T, 3]; none may be degenerate."""
    normal = _cross(corners)
    unit: NDArray[np.float32] = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
    return unit


def _cross(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    p = corners.astype(np.float64)
    return np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
