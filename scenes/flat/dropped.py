"""Which triangles of a scene are dropped: those that no ray could find, and those that would never be seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.model.scene import Solid

KEPT, NON_FINITE, ZERO_AREA, NO_NORMAL, DUPLICATE, TOO_SMALL = range(6)
"""Numbers of the causes."""

CAUSES = {
    NON_FINITE: "not finite",
    ZERO_AREA: "zero area",
    NO_NORMAL: "no normal in single precision",
    DUPLICATE: "the same as another, which hides it",
    TOO_SMALL: "too small beside the whole scene to have an area in single precision; does something lie far off?",
}
"""In words."""

_MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93], np.uint64)
"""Odd numbers without pattern, for keys of places."""


def drop_cause(positions: NDArray[np.float32], glows: NDArray[np.bool_]) -> NDArray[np.int8]:
    """Why triangles are dropped: KEPT, or the number of a cause, shape [T].

    Args:
        positions: corners in the renderer's space, shape [T, 3, 3].
        glows: whether they are light sources, shape [T]: of these, each of several in one place shines.
    """
    cause = degenerate_cause(positions)
    cause[(cause == KEPT) & repeated(positions) & ~glows] = DUPLICATE
    return cause


def mark_small(cause: NDArray[np.int8], meshes: Sequence[Solid], sizes: Sequence[int]) -> None:
    """Tell triangles that have no area from those that have one, but beside the scene's extent are next to nothing.

    Args:
        cause: of all triangles, shape [T]: ZERO_AREA becomes TOO_SMALL.
        meshes, sizes: whose triangles these are, in order, and how many each has.
    """
    if not (cause == ZERO_AREA).any():
        return
    for mesh, part in zip(meshes, np.split(cause, np.cumsum(sizes)[:-1]), strict=True):
        flat = np.flatnonzero(part == ZERO_AREA)
        part[flat[have_area(mesh, flat)]] = TOO_SMALL


def have_area(mesh: Solid, faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether faces of a mesh have an area where it was made, shape [F]; beside its scene it may be next to nothing."""
    corners = mesh.vertices[mesh.faces[faces]]
    return np.asarray(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any(axis=1))


def counted(cause: NDArray[np.int8]) -> dict[str, int]:
    """How many triangles are dropped, by cause in words."""
    counts = {words: int(np.sum(cause == number)) for number, words in CAUSES.items()}
    return {words: count for words, count in counts.items() if count}


def degenerate_cause(positions: NDArray[np.float32]) -> NDArray[np.int8]:
    """Why triangles cannot be rendered: KEPT, or the number of a cause, shape [T].

    Args:
        positions: corners in the renderer's space, shape [T, 3, 3].
    """
    cause = np.empty(len(positions), np.int8)
    for first in range(0, len(positions), _AT_ONCE):
        cause[first : first + _AT_ONCE] = _degenerate(positions[first : first + _AT_ONCE])
    return cause


_AT_ONCE = 1 << 16
"""Triangles that are looked at together: what is worked out of them fits into a cache."""


def _degenerate(positions: NDArray[np.float32]) -> NDArray[np.int8]:
    cause = np.full(len(positions), KEPT, dtype=np.int8)
    with np.errstate(invalid="ignore", over="ignore", under="ignore"):
        # axis by axis: NumPy is slow at rows of three
        ax, ay, az = (positions[:, 1, axis] - positions[:, 0, axis] for axis in range(3))
        bx, by, bz = (positions[:, 2, axis] - positions[:, 0, axis] for axis in range(3))
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        square = x * x + y * y + z * z
    # nearly all have a normal in single precision, and the exact test is needed for the rest only
    cause[~(np.isfinite(square) & (square > 0))] = NO_NORMAL
    doubtful = np.flatnonzero(cause)
    corners = positions[doubtful].astype(np.float64)
    finite = np.isfinite(corners).all(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        exact = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cause[doubtful[finite & ~exact.any(axis=1)]] = ZERO_AREA
    cause[doubtful[~finite]] = NON_FINITE
    return cause


def repeated(positions: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Triangles with the very corners of an earlier one, in whatever order, shape [T].

    Of surfaces in one place the first is seen, so these are never; but their area would count as surface.
    """
    key = np.empty(len(positions), np.uint64)
    for begin in range(0, len(positions), _AT_ONCE):
        key[begin : begin + _AT_ONCE] = _keys(positions[begin : begin + _AT_ONCE])
    is_repeated = np.zeros(len(key), np.bool_)
    ordered = np.sort(key)
    several = np.unique(ordered[1:][ordered[1:] == ordered[:-1]])  # keys of more than one triangle: few, if any
    del ordered
    if not len(several):
        return is_repeated
    rows = np.flatnonzero(np.isin(key, several))
    _, first, inverse = np.unique(key[rows], return_index=True, return_inverse=True)
    for row, earlier in zip(rows.tolist(), rows[first[inverse]].tolist(), strict=True):
        if row != earlier:  # keys that are alike by chance must not drop anything
            same = {tuple(c) for c in positions[row].tolist()} == {tuple(c) for c in positions[earlier].tolist()}
            is_repeated[row] = same
    return is_repeated


def _keys(positions: NDArray[np.float32]) -> NDArray[np.uint64]:
    """A number for the places of each triangle's corners, whatever their order, shape [T]."""
    bits = (positions + np.float32(0.0)).view(np.uint32).astype(np.uint64)  # -0 and 0 are the same place
    corner = (bits[..., 0] * _MIX[0]) ^ (bits[..., 1] * _MIX[1]) ^ (bits[..., 2] * _MIX[2])
    corner = (corner ^ (corner >> np.uint64(29))) * _MIX[3]
    key: NDArray[np.uint64] = corner.sum(axis=1, dtype=np.uint64)
    return key
