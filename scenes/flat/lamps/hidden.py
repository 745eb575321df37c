"""Lamps that lie in the very plane of a surface, as one that somebody has put into a ceiling without cutting it.

Of two triangles that a ray meets at once it takes the one with the smaller number (docs/exactness.md). Is that the
ceiling's, the lamp is not seen, and paths that go on never meet it, though shadow rays do and expect the others to:
its light is lost in part. So lamps are numbered first where there is such a one, and nowhere else: numbers decide bits.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.arrays import Triangles

MOST_PLANES: Final = 32
"""That lamps lie in, the largest first."""

MOST_LOOKS: Final = 1 << 22
"""At triangles, for all planes: some hundredths of a second. In scenes of millions only the largest lamps are."""

IN_PLANE: Final = 2.0**-22
"""Surfaces closer than this, as a share of the coordinates, are in one plane as far as float32 can tell."""

PLACES: Final = np.array([[1 / 3, 1 / 3, 1 / 3], [0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])
"""Weights of the corners at the places of a lamp that are looked at."""


def hides_lamps(triangles: Triangles) -> bool:
    """Whether a triangle that comes before a lamp lies over it in its plane. Instances are not looked at."""
    lamps = np.flatnonzero(triangles.emitter >= 0)
    if not len(lamps) or lamps[-1] == len(lamps) - 1:  # all come first
        return False
    corners = triangles.positions[lamps].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(size, np.finfo(np.float64).tiny)[:, None]
    flat = _flat(triangles.emitter[lamps], corners, normals)
    lamps, corners, normals, size = lamps[flat], corners[flat], normals[flat], size[flat]
    before = int(lamps[-1]) if len(lamps) else 0
    if not before:
        return False
    planes = min(MOST_PLANES, max(MOST_LOOKS // before, 1))
    waiting = np.argsort(-size, kind="stable")
    for _ in range(planes):
        if not len(waiting):
            return False
        largest = waiting[0]
        near = _in_plane(corners[waiting], corners[largest, 0], normals[largest])
        own, waiting = waiting[near], waiting[~near]
        if _is_covered(triangles, lamps[own], corners[own], normals[largest]):
            return True
    return False


def _flat(emitter: NDArray[Any], corners: NDArray[Any], normals: NDArray[Any]) -> NDArray[np.bool_]:
    """Which triangles are of lamps that lie in one plane each: no other lies in a ceiling's as a whole.

    Args:
        emitter: lamp of each, shape [L].
        corners, normals: of the triangles, shape [L, 3, 3] and [L, 3].
    """
    _, first, lamp = np.unique(emitter, return_index=True, return_inverse=True)
    point, normal = corners[first, 0][lamp], normals[first][lamp]
    off = np.abs(np.einsum("lca,la->lc", corners - point[:, None], normal)).max(axis=1)
    reach = np.maximum(np.abs(corners).max(axis=(1, 2)), np.abs(point).max(axis=1))
    beside = np.bincount(lamp, off > IN_PLANE * reach, len(first))
    return np.asarray(beside[lamp] == 0)


def _is_covered(triangles: Triangles, lamps: NDArray[np.intp], corners: NDArray[Any], normal: NDArray[Any]) -> bool:
    """Whether one of some lamps in a plane has a place that lies in a triangle before it.

    Args:
        lamps, corners: rows of theirs, and their corners, shape [L] and [L, 3, 3].
    """
    before = int(lamps.max())
    first = triangles.positions[:before, 0]
    off = np.abs(first @ normal.astype(np.float32) - np.float32(corners[0, 0] @ normal))
    reach = float(max(np.abs(corners).max(), np.abs(first).max(initial=0.0)))
    rows = np.flatnonzero((off <= 8.0 * IN_PLANE * reach) & (triangles.emitter[:before] < 0))  # float32 is rounded
    others = triangles.positions[rows].astype(np.float64)
    near = _in_plane(others, corners[0, 0], normal)
    rows, others = rows[near], others[near]
    axes = [axis for axis in range(3) if axis != int(np.abs(normal).argmax())]
    places = np.einsum("pc,lca->lpa", PLACES, corners)[:, :, axes]
    for lamp, of_lamp in zip(lamps.tolist(), places, strict=True):
        flat = others[rows < lamp][:, :, axes]
        if len(flat) and _inside(of_lamp, flat):
            return True
    return False


def _in_plane(corners: NDArray[Any], point: NDArray[Any], normal: NDArray[Any]) -> NDArray[np.bool_]:
    """Of some triangles, shape [T, 3, 3], which lie in the plane of a point and a normal."""
    reach = max(float(np.abs(corners).max(initial=0.0)), float(np.abs(point).max()))
    near = np.abs(corners[:, 0] @ normal - point @ normal) <= 2.0 * IN_PLANE * reach  # most are not
    some = corners[near]
    off = np.abs((some - point) @ normal).max(axis=1)
    near[near] = off <= IN_PLANE * np.maximum(np.abs(some).max(axis=(1, 2)), np.abs(point).max())
    return np.asarray(near)


def _inside(places: NDArray[Any], triangles: NDArray[Any]) -> bool:
    """Whether any of some places in a plane, shape [P, 2], lies in any of some triangles, shape [T, 3, 2]."""
    sides = []
    for corner in range(3):
        start = triangles[:, corner]
        edge = triangles[:, (corner + 1) % 3] - start
        to = places[:, None, :] - start
        sides.append(edge[:, 0] * to[:, :, 1] - edge[:, 1] * to[:, :, 0])
    side = np.stack(sides)
    return bool(((side > 0.0).all(axis=0) | (side < 0.0).all(axis=0)).any())
