"""In what order surface points are given to triangles: along a curve through each mesh, by the area before them.

Points that measure how much surface there is (kernels.photons.surface_points) are spread evenly over all surfaces. A
triangle smaller than what a point stands for has one or none. Which have one must be even from place to place, however
a mesh numbers its triangles, and each triangle must know it without its neighbours, of which a cell may not have all.
So triangles are put in the order of a Hilbert curve through their mesh, and each is told what area comes before it: a
point lies on it where the next multiple of the area of a point falls within its own. Neighbours on the curve are
neighbours in space, so every small region has as many points as its area says, within one or two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.areas import triangle_areas

BITS = 10
"""Of a place on the curve, along each axis: a thousandth of the mesh's extent."""

LARGEST = 1e30
"""A coordinate beyond which nothing is rendered."""

FEW = 16
"""Triangles of a mesh that are left in their own order: scenes have many such meshes, and a curve takes its time."""

_AT_ONCE = 1 << 14
"""Triangles that are looked at together."""


@dataclass
class AreaBefore:
    """Tells meshes, one after another, what area comes before their triangles.

    Attributes:
        total: area of the meshes so far [squared units of the renderer's space].
    """

    total: float = 0.0

    def of_mesh(self, corners: NDArray[np.float32]) -> NDArray[np.float64]:
        """Of the triangles of the next mesh, given by their corners, shape [T, 3, 3]; float64, shape [T]."""
        within, area = along_curve(corners)
        return self.step(area) + within

    def step(self, area: float) -> float:
        """What comes before the next mesh, of this area."""
        before = self.total
        self.total += area
        return before


def along_curve(corners: NDArray[np.floating[Any]]) -> tuple[NDArray[np.float64], float]:
    """What area comes before each triangle of a mesh along a curve through it, float64, shape [T]; and the area of all.

    What is not finite has no area.
    """
    order = curve_order(corners) if len(corners) > FEW else np.arange(len(corners))
    before = np.empty(len(corners))
    total = 0.0
    for first in range(0, len(corners), _AT_ONCE):
        rows = order[first : first + _AT_ONCE]
        with np.errstate(over="ignore", invalid="ignore"):
            area = triangle_areas(corners[rows])
        area[~np.isfinite(area)] = 0.0
        sums = np.cumsum(area)
        before[rows] = total + (sums - area)
        total += float(sums[-1])
    return before, total


def curve_order(corners: NDArray[np.floating[Any]]) -> NDArray[np.integer[Any]]:
    """The order of a mesh's triangles along a Hilbert curve through the cube around their middles.

    Those that are not finite count as if they were at the origin.

    Returns:
        their rows, shape [T]; of triangles at one place the first comes first.
    """
    middles = np.empty((3, len(corners)), np.float32)
    for first in range(0, len(corners), _AT_ONCE):
        _add_corners(corners[first : first + _AT_ONCE], middles[:, first : first + _AT_ONCE])
    low = middles.min(axis=1)
    side = float((middles.max(axis=1) - low).max())
    scale = np.float32(((1 << BITS) - 1) / side if side > 0.0 else 0.0)
    keys = np.arange(len(corners), dtype=np.uint64)  # the row, and above it the place on the curve
    for first in range(0, len(corners), _AT_ONCE):
        places = (middles[:, first : first + _AT_ONCE] - low[:, None]) * scale
        keys[first : first + _AT_ONCE] |= hilbert_keys(places.astype(np.uint16)).astype(np.uint64) << np.uint64(32)
    keys.sort()
    return keys.astype(np.uint32)


def hilbert_keys(places: NDArray[np.uint16]) -> NDArray[np.uint32]:
    """How far along a Hilbert curve places lie, 30 bits, shape [N].

    Skilling 2004, "Programming the Hilbert curve": axes are exchanged and turned from the highest bit to the lowest,
    then the bits of all three are a Gray code of the place on the curve.

    Args:
        places: below 2^BITS along each axis, shape [3, N].
    """
    axes = list(places.copy())
    first = axes[0]
    for bit in range(BITS - 1, 0, -1):
        low = np.uint16((1 << bit) - 1)
        for axis in axes:
            above = -(axis >> np.uint16(bit) & np.uint16(1))  # all bits set where this one is
            exchanged = (first ^ axis) & low & ~above
            first ^= exchanged | (low & above)
            if axis is not first:
                axis ^= exchanged
    axes[1] ^= axes[0]
    axes[2] ^= axes[1]
    turn = np.zeros_like(first)
    for bit in range(BITS - 1, 0, -1):
        turn ^= -(axes[2] >> np.uint16(bit) & np.uint16(1)) & np.uint16((1 << bit) - 1)
    x, y, z = (_spread_bits(axis ^ turn) for axis in axes)
    keys: NDArray[np.uint32] = x << np.uint32(2) | y << np.uint32(1) | z
    return keys


def _spread_bits(values: NDArray[np.uint16]) -> NDArray[np.uint32]:
    """Bits 0 to 9 at 0, 3, ... 27."""
    spread = values.astype(np.uint32)
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        spread = (spread | spread << np.uint32(shift)) & np.uint32(mask)
    return spread


def _add_corners(corners: NDArray[np.floating[Any]], middles: NDArray[np.float32]) -> None:
    """Thrice the middles of triangles, axis by axis, shape [3, T]; the origin where they are not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        middles[:] = (corners[:, 0] + corners[:, 1] + corners[:, 2]).T
    middles[~(np.abs(middles) < LARGEST)] = 0.0
