"""What a cell holds, in outline: boxes around all its triangles, so that a ray passes by where a cell is empty.

Every process has the outlines of all cells.

**Nothing is missed.** A hit lies, but for a few roundings, on the part of its triangle that is in its cell, and so in
one of the cell's boxes. These are grown by `pad`, and a ray's interval in one is computed as in the triangles' trees,
so it contains the hit's t: no box with a hit is left out (see triangle.py for the roundings).

**Planes.** A box whose triangles all lie in one plane has that plane, as a slab: the least and the largest distance
of their corners along its normal. A ray meets the box only where it is in the slab, too. Along the normal of what is
seen well from its front, `pad` is a wide margin: rays leave a surface, and end at a lamp, a few roundings off it, and
would meet the box of each, although they can hit neither. So here the error of the hit itself counts. Let s be the
length of a triangle's longest edge, A its area, D its distance along the ray, and the cosine between ray and normal
at least 2^-6. Sheared corners add up to S <= 12 s, and are known to 2^-52 (D + S); the determinant is at least
2^-6 * 2A, which is at least 2^-10 s² where 2A >= s² / 16, so weights are known to 2^-50 S² / 2^-10 s², and the point
that they tell is off the ray by at most 2^-52 D + 2^-28.7 s. Slabs are grown by 2^-28 s (SLAB_SHARE), s that of the
largest. The determinant is above EDGE_ON of S times distance wherever D <= 2^12 s: further away (`reach`, by the
smallest s), and at lower cosines, planes are not asked. A hit's t is then in the slab's interval in double; both are
rounded to float alike, and rounding is monotone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.rays.lanes import children_enter, children_leave, lanes_not_above, lowest_bit, vec8
from wdpm.kernels.rays.triangle import EXIT_SCALE

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SLAB_SHARE = 2.0**-28
"""Growth of a slab, as a share of the longest edge of its triangles."""

REACH_SHARE = 2.0**12
"""How far a plane is asked, in longest edges of its smallest triangle."""

GROUP = 64
"""Boxes of a group: eight blocks of eight."""

LEAST_COSINE = wp.constant(2.0**-5)
"""Between a plane's normal and a direction whose largest component is 1: a cosine of 2^-5 / sqrt(3) at least."""

ROUNDING = wp.constant(1.0 - 2.0**-45)
"""Covers the roundings of a slab's interval in double."""


@wp.struct
class Outlines:
    """The boxes of all cells, eight a block, and eight blocks a group, with boxes around each block (lanes.py).

    Attributes:
        first: of the groups of each cell, and the end of the last.
        blocks: boxes around blocks: six rows a group, as Bvh.bounds.
        boxes: six rows a block; blocks 8 g to 8 g + 7 are those of group g.
        plane: of each box: the number of its plane, -1 for none.
        normal: of planes, unit vectors.
        slab: of planes: least and largest distance along the normal, grown, and from how far it is asked.
    """

    first: wp.array[wp.int32]
    blocks: wp.array[vec8]
    boxes: wp.array[vec8]
    plane: wp.array[wp.int32]
    normal: wp.array[wp.vec3d]
    slab: wp.array[wp.vec3d]


def upload(
    first: NDArray[np.int32],
    low: NDArray[np.float32],
    high: NDArray[np.float32],
    plane: NDArray[np.int32],
    normal: NDArray[np.float64],
    slab: NDArray[np.float64],
    pad: float,
    device: str,
) -> Any:
    """Outlines on a device.

    Args:
        first: of the boxes of each cell, and the end of the last.
        low, high: boxes as they are, shape [boxes, 3]; those near each other stand together.
        plane: shape [boxes].
        slab: shape [planes, 3].
    """
    groups = -(-np.diff(first) // GROUP)
    start = np.concatenate([[0], np.cumsum(groups)])
    cell = np.repeat(np.arange(len(groups)), np.diff(first))
    place = start[cell] * GROUP + np.arange(len(low)) - first[cell]
    bounds = np.full((2, start[-1] * GROUP, 3), np.inf, np.float32)
    bounds[1] = -np.inf
    bounds[0, place], bounds[1, place] = low - np.float32(pad), high + np.float32(pad)
    around = bounds.reshape(2, -1, 8, 3)
    planes = np.full(start[-1] * GROUP, -1, np.int32)
    planes[place] = plane
    outlines = Outlines()
    outlines.first = wp.array(start, dtype=wp.int32, device=device)
    outlines.boxes = _rows(bounds, device)
    outlines.blocks = _rows(np.stack([around[0].min(axis=1), around[1].max(axis=1)]), device)
    outlines.plane = wp.array(planes, dtype=wp.int32, device=device)
    outlines.normal = wp.array(normal, dtype=wp.vec3d, device=device)
    outlines.slab = wp.array(slab, dtype=wp.vec3d, device=device)
    return outlines


def _rows(bounds: NDArray[np.float32], device: str) -> Any:
    """Boxes, shape [2, N, 3], as six rows of eight for each eight: low x, high x, low y, ..."""
    rows = bounds.reshape(2, -1, 8, 3).transpose(1, 3, 0, 2).reshape(-1, 8)
    return wp.array(np.ascontiguousarray(rows), dtype=vec8, device=device)


def upload_boxes(low: NDArray[np.float32], high: NDArray[np.float32], pad: float, device: str) -> Any:
    """Outlines of cells that may hold something anywhere in their boxes, shape [cells, 3] each."""
    count = len(low)
    none = np.zeros((0, 3), np.float64)
    return upload(
        np.arange(count + 1, dtype=np.int32), low, high, np.full(count, -1, np.int32), none, none, pad, device
    )


@wp.func
def meets_slab(normal: wp.vec3d, slab: wp.vec3d, origin: wp.vec3, direction: wp.vec3, leave: wp.float32) -> wp.bool:
    """Whether a ray comes to a slab, from its origin up to `leave`; true where it can't be told."""
    longest = wp.float64(wp.max(wp.abs(direction)))
    along = wp.dot(normal, wp.vec3d(direction))
    if wp.abs(along) < wp.float64(LEAST_COSINE) * longest or longest == wp.float64(0.0):
        return True
    at = wp.dot(normal, wp.vec3d(origin))
    a = (slab[0] - at) / along
    b = (slab[1] - at) / along
    if wp.max(wp.abs(a), wp.abs(b)) * longest > slab[2]:
        return True
    return wp.max(a, b) >= wp.float64(0.0) and wp.float32(wp.min(a, b) * wp.float64(ROUNDING)) <= leave


@wp.func(inline=False)
def meets_outline(
    outlines: wp.ref[Outlines], cell: wp.int32, origin: wp.vec3, direction: wp.vec3, inverse: wp.vec3, t_max: wp.float32
) -> wp.bool:
    """Whether a ray may hit something that a cell holds, up to t_max."""
    inverse_leave = inverse * EXIT_SCALE
    for group in range(outlines.first[cell], outlines.first[cell + 1]):
        enter = children_enter(outlines.blocks, group, origin, inverse)
        leave = children_leave(outlines.blocks, group, origin, inverse_leave, t_max)
        met = lanes_not_above(enter, leave)
        while met != 0:
            block = 8 * group + lowest_bit(met)
            met = met & (met - 1)
            enter_box = children_enter(outlines.boxes, block, origin, inverse)
            leave_box = children_leave(outlines.boxes, block, origin, inverse_leave, t_max)
            inside = lanes_not_above(enter_box, leave_box)
            while inside != 0:
                lane = lowest_bit(inside)
                inside = inside & (inside - 1)
                plane = outlines.plane[8 * block + lane]
                if plane < 0:
                    return True
                if meets_slab(outlines.normal[plane], outlines.slab[plane], origin, direction, leave_box[lane]):
                    return True
    return False
