"""Polygons cut into triangles: fans around the first corner, and ears where a fan would fold over.

Most polygons of files are convex, and any corner's fan is right. Programs write concave ones as well, frames of windows
and letters among them, whose fan would cover what lies outside: they are found by a triangle that faces the other way.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.meshes.polygons.ears import cut_ears

_BLOCK: Final = 1 << 16
"""Triangles that are looked at together: bounds memory."""

_FLAT: Final = 1e-9
"""Area of a triangle, as a share of its polygon's, that is taken for none: what collinear corners leave by rounding."""


def triangulate_fans(
    counts: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cuts polygons into fans around their first corner.

    Args:
        counts: corners of each polygon (at least 3), whose corners lie one after another, shape [P].

    Returns:
        corners: positions in the list of all corners, shape [T, 3].
        polygon: the polygon that each triangle is of, shape [T].
    """
    polygon = np.repeat(np.arange(len(counts)), counts - 2)
    start = np.concatenate([[0], np.cumsum(counts)[:-1]])[polygon] if len(counts) else polygon
    first_triangle = np.concatenate([[0], np.cumsum(counts - 2)[:-1]])[polygon] if len(counts) else polygon
    step = np.arange(len(polygon)) - first_triangle
    return np.stack([start, start + step + 1, start + step + 2], axis=1).astype(np.int64), polygon


def triangulate(
    counts: NDArray[np.int64], corner_vertex: NDArray[np.int64], vertices: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cuts polygons into triangles that cover them: as many, for each, as its fan has, and in the fan's place.

    Args:
        counts: corners of each polygon (at least 3), whose corners lie one after another, shape [P].
        corner_vertex: the vertex at each corner, shape [K].
        vertices: positions, shape [V, 3].

    Returns:
        corners: positions in the list of all corners, shape [T, 3]; fans, but for polygons that these do not cover.
        polygon: the polygon that each triangle is of, shape [T].
    """
    corners, polygon = triangulate_fans(counts)
    first = np.concatenate([[0], np.cumsum(counts - 2)])
    begin = 0
    while begin < len(counts):
        end = max(begin + 1, int(np.searchsorted(first, first[begin] + _BLOCK, side="right")) - 1)
        triangles = slice(first[begin], first[end])
        if counts[begin:end].max() > 3:
            folded = _folded(vertices[corner_vertex[corners[triangles]]], polygon[triangles] - begin, end - begin)
            for number in (begin + np.flatnonzero(folded)).tolist():
                start = int(corners[first[number], 0])
                place = vertices[corner_vertex[start : start + int(counts[number])]]
                ears = cut_ears(place)
                if ears is not None:
                    corners[first[number] : first[number + 1]] = start + ears
        begin = end
    return corners, polygon


def _folded(places: NDArray[np.float64], polygon: NDArray[np.int64], count: int) -> NDArray[np.bool_]:
    """Which of some polygons have a triangle in their fan that faces the other way than all of it together.

    Args:
        places: corners of the triangles, shape [T, 3, 3].
        polygon: of each triangle, ascending, each of `count` with one at least.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        normal = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
        whole = np.add.reduceat(normal, np.searchsorted(polygon, np.arange(count)), axis=0)
        along = np.einsum("ij,ij->i", normal, whole[polygon])
        against = along < -_FLAT * np.einsum("ij,ij->i", whole, whole)[polygon]
    folded = np.zeros(count, np.bool_)
    folded[polygon[against]] = True
    return folded
