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
        areas[first : first + _AT_ONCE] = 0.5 * _length(_cross(block))
        let_go(block)
    return areas


def triangle_normals(corners: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit normals of triangles by their winding, float32, shape [T, 3]; none may be degenerate."""
    normal = _cross(corners)
    unit: NDArray[np.float32] = (normal / _length(normal)).T.astype(np.float32, order="C")
    return unit


def _cross(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    """Cross products of two edges of each, shape [3, T]: column by column, which takes a third of np.cross's time."""
    corner, *others = (corners[:, vertex].T.astype(np.float64) for vertex in range(3))
    a, b = (other - corner for other in others)
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _length(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of vectors, shape [3, T]."""
    length: NDArray[np.float64] = np.sqrt(vectors[0] ** 2 + vectors[1] ** 2 + vectors[2] ** 2)
    return length
