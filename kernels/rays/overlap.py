"""Which triangles overlap which cells: the separating axis test of a triangle and a box, in double."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.launch import Launcher

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _separated(axis: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, half: wp.vec3d) -> wp.bool:
    """Whether a triangle and a box about the origin lie apart along an axis."""
    reach = half[0] * wp.abs(axis[0]) + half[1] * wp.abs(axis[1]) + half[2] * wp.abs(axis[2])
    pa = wp.dot(axis, a)
    pb = wp.dot(axis, b)
    pc = wp.dot(axis, c)
    return wp.min(pa, wp.min(pb, pc)) > reach or wp.max(pa, wp.max(pb, pc)) < -reach


@wp.func
def overlaps(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, low: wp.vec3d, high: wp.vec3d) -> wp.bool:
    """Whether a triangle and a box have a point in common (Akenine-Moeller 2001)."""
    centre = (low + high) * wp.float64(0.5)
    half = (high - low) * wp.float64(0.5)
    a -= centre
    b -= centre
    c -= centre
    for i in range(3):
        if wp.min(a[i], wp.min(b[i], c[i])) > half[i] or wp.max(a[i], wp.max(b[i], c[i])) < -half[i]:
            return False
    if _separated(wp.cross(b - a, c - a), a, b, c, half):
        return False
    for i in range(3):
        unit = wp.vec3d()
        unit[i] = wp.float64(1.0)
        if (
            _separated(wp.cross(unit, b - a), a, b, c, half)
            or _separated(wp.cross(unit, c - b), a, b, c, half)
            or _separated(wp.cross(unit, a - c), a, b, c, half)
        ):
            return False
    return True


@wp.kernel
def _overlap_kernel(
    corners: wp.array2d[wp.vec3],
    low: wp.array[wp.vec3d],
    high: wp.array[wp.vec3d],
    offset: wp.int32,
    overlaps_out: wp.array2d[wp.uint8],
) -> None:
    i = offset + wp.tid()
    a = wp.vec3d(corners[i, 0])
    b = wp.vec3d(corners[i, 1])
    c = wp.vec3d(corners[i, 2])
    for cell in range(low.shape[0]):
        if overlaps(a, b, c, low[cell], high[cell]):
            overlaps_out[i, cell] = wp.uint8(1)


def triangles_in_boxes(
    corners: NDArray[np.float32], low: NDArray[np.float64], high: NDArray[np.float64], launcher: Launcher
) -> NDArray[np.bool_]:
    """Whether triangle i overlaps box c, bool, shape [T, boxes]."""
    found = wp.zeros((len(corners), len(low)), dtype=wp.uint8, device=launcher.device)
    launcher(
        _overlap_kernel,
        len(corners),
        corners=wp.array(corners, dtype=wp.vec3, device=launcher.device),
        low=wp.array(low, dtype=wp.vec3d, device=launcher.device),
        high=wp.array(high, dtype=wp.vec3d, device=launcher.device),
        overlaps_out=found,
    )
    result: NDArray[np.bool_] = found.numpy().astype(bool)
    return result
