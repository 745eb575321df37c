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
smallest s), and at lower cosines, planes are not asked. A hit's t is then in the slab's interval in double; it is
rounded to float, and what is rounded to a float of a box's interval is not beyond it (lanes.slabs_met).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.rays.lanes import children_enter, children_leave, lanes_not_above, lowest_bit, slabs_met, vec8
from wdpm.kernels.rays.triangle import EXIT_SCALE

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SLAB_SHARE = 2.0**-28
"""Growth of a slab, as a share of the longest edge of its triangles."""

REACH_SHARE = 2.0**12
"""How far a plane is asked, in longest edges of its smallest triangle."""

GROUP = 64
"""Boxes of a group: eight blocks of eight."""


@wp.struct
class Outlines:
    """The boxes of all cells, eight a block, and eight blocks a group, with boxes around each block (lanes.py).

    Attributes:
        first: of the groups of each cell, and the end of the last.
        around: boxes around all that each cell holds: six rows for eight cells after another.
        blocks: boxes around blocks: six rows a group, as Bvh.bounds.
        boxes: six rows a block; blocks 8 g to 8 g + 7 are those of group g.
        full: which boxes of a block have no plane: bit k for box k.
        slabs: of each box that of its plane, grown, and from how far it is asked: as lanes.slabs_met takes them.
        flat: of each cell, 1 where all its boxes have planes, so that they are nearly what it holds.
    """

    first: wp.array[wp.int32]
    around: wp.array[vec8]
    blocks: wp.array[vec8]
    boxes: wp.array[vec8]
    full: wp.array[wp.int32]
    slabs: wp.array[wp.float64]
    flat: wp.array[wp.int32]


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
    blocks = bounds.reshape(2, -1, 8, 3)
    around = np.full((2, len(groups), 3), np.inf, np.float32)
    around[1] = -np.inf
    np.minimum.at(around[0], cell, bounds[0, place])
    np.maximum.at(around[1], cell, bounds[1, place])
    slabs = np.zeros((start[-1] * GROUP, 6))
    flat = plane >= 0
    full = np.ones(len(slabs), np.bool_)
    full[place[flat]] = False
    slabs[place[flat], :3], slabs[place[flat], 3:] = normal[plane[flat]], slab[plane[flat]]
    outlines = Outlines()
    outlines.first = wp.array(start, dtype=wp.int32, device=device)
    outlines.around = rows_of_boxes(around[0], around[1], device)
    outlines.boxes = rows_of_boxes(bounds[0], bounds[1], device)
    outlines.blocks = rows_of_boxes(blocks[0].min(axis=1), blocks[1].max(axis=1), device)
    outlines.full = wp.array(np.packbits(full, bitorder="little"), dtype=wp.int32, device=device)
    by_block = np.ascontiguousarray(slabs.reshape(-1, 8, 6).transpose(0, 2, 1))
    outlines.slabs = wp.array(by_block.reshape(-1), dtype=wp.float64, device=device)
    curved = np.bincount(cell, weights=plane < 0, minlength=len(groups))
    outlines.flat = wp.array(curved == 0, dtype=wp.int32, device=device)
    return outlines


def rows_of_boxes(low: NDArray[np.float32], high: NDArray[np.float32], device: str) -> Any:
    """Boxes, shape [N, 3], as six rows for each eight, low x, high x, low y, ...; empty ones behind the last."""
    eights = np.full((2, -(-len(low) // 8) * 8, 3), np.inf, np.float32)
    eights[1] = -np.inf
    eights[0, : len(low)], eights[1, : len(high)] = low, high
    rows = eights.reshape(2, -1, 8, 3).transpose(1, 3, 0, 2).reshape(-1, 8)
    return wp.array(np.ascontiguousarray(rows), dtype=vec8, device=device)


def upload_boxes(low: NDArray[np.float32], high: NDArray[np.float32], pad: float, device: str) -> Any:
    """Outlines of cells that may hold something anywhere in their boxes, shape [cells, 3] each."""
    count = len(low)
    none = np.zeros((0, 3), np.float64)
    return upload(
        np.arange(count + 1, dtype=np.int32), low, high, np.full(count, -1, np.int32), none, none, pad, device
    )


@wp.func
def outlines_near(
    outlines: wp.ref[Outlines], eight: wp.int32, origin: wp.vec3, inverse: wp.vec3, t_max: wp.float32
) -> wp.int32:
    """Of which cells from 8 * eight on a ray meets the box around all that they hold, up to t_max: one bit each."""
    enter = children_enter(outlines.around, eight, origin, inverse)
    return lanes_not_above(enter, children_leave(outlines.around, eight, origin, inverse * EXIT_SCALE, t_max))


@wp.func(inline=False)
def meets_outline(
    outlines: wp.ref[Outlines], cell: wp.int32, origin: wp.vec3, direction: wp.vec3, inverse: wp.vec3, t_max: wp.float32
) -> wp.bool:
    """Whether a ray may hit something that a cell holds, up to t_max."""
    inverse_leave = inverse * EXIT_SCALE
    longest = wp.max(wp.abs(direction))
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
            if (inside & outlines.full[block]) != 0:
                return True
            if inside != 0:
                inside = inside & slabs_met(outlines.slabs, block, origin, direction, longest, enter_box, leave_box)
                if inside != 0:
                    return True
    return False
