"""The way of a ray through the cells: which cell comes next, and which one owns a point.

A ray visits the cells whose boxes it meets in the order of (entry, cell number), but for those that hold nothing where
it goes (outlines.py), and stops before a cell whose entry lies beyond its best hit. The order is a function of the ray
and of tables that every process has, so a ray needs no memory of where it has been but the cell it is in, and every
process computes the same next step.

Nothing is missed: cell boxes are grown by `pad`, as are the triangles' when they are assigned to cells. A triangle's
hit point is known to a few roundings, far less than `pad`; the cell that contains it holds the triangle, the ray's
interval in that cell's grown box contains t, so its entry is not beyond t; and so does the interval in one of the boxes
of the cell's outline.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.rays.lanes import children_enter, children_leave, lanes_not_above, lowest_bit, vec8
from wdpm.kernels.rays.outlines import Outlines, meets_outline, outlines_near, rows_of_boxes, upload_boxes
from wdpm.kernels.rays.outlines import upload as upload_outlines
from wdpm.kernels.rays.triangle import EXIT_SCALE, inverse_component

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FAR_AWAY = 3.0e37
"""Stands for the infinite faces of outermost cells: finite, so that slab arithmetic stays free of NaN."""


@wp.struct
class Cells:
    """The top tree on a device, in heap order, boxes of its leaves grown by `pad`, and what they hold in outline.

    Attributes:
        boxes: of eight cells after another, as Bvh.bounds; empty where there are no more.
    """

    count: wp.int32
    axis: wp.array[wp.int32]
    split: wp.array[wp.float32]
    boxes: wp.array[vec8]
    outlines: Outlines


def cell_boxes(axis: NDArray[np.int32], split: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Lower and upper corners of the cells, float32, shape [cells, 3] each; outermost faces at +-FAR_AWAY."""
    nodes = 2 * len(axis) + 1
    low = np.full((nodes, 3), -FAR_AWAY, np.float32)
    high = np.full((nodes, 3), FAR_AWAY, np.float32)
    for node in range(len(axis)):
        for child, bound, tighter in ((2 * node + 1, high, np.minimum), (2 * node + 2, low, np.maximum)):
            low[child], high[child] = low[node], high[node]
            # A plane outside of its node leaves one child all of it and the other nothing.
            bound[child, axis[node]] = tighter(bound[child, axis[node]], split[node])
    return low[len(axis) :], high[len(axis) :]


def upload(
    axis: NDArray[np.int32],
    split: NDArray[np.float32],
    pad: float,
    device: str,
    outlines: Mapping[str, NDArray[Any]] | None = None,
) -> Cells:
    """The top tree on a device.

    Args:
        outlines: of all cells, as outlines.upload takes them; None: each cell may hold something anywhere.
    """
    low, high = cell_boxes(axis, split)
    cells = Cells()
    cells.count = len(low)
    cells.axis = wp.array(axis, dtype=wp.int32, device=device)
    cells.split = wp.array(split, dtype=wp.float32, device=device)
    cells.boxes = rows_of_boxes(low - np.float32(pad), high + np.float32(pad), device)
    if outlines is None:
        cells.outlines = upload_boxes(low, high, pad, device)
    else:
        cells.outlines = upload_outlines(**outlines, pad=pad, device=device)
    return cells


@wp.func
def inverse_direction(direction: wp.vec3) -> wp.vec3:
    """1 / direction for slab arithmetic, as in the triangles' tree."""
    return wp.vec3(inverse_component(direction[0]), inverse_component(direction[1]), inverse_component(direction[2]))


@wp.func
def cell_of(cells: wp.ref[Cells], point: wp.vec3) -> wp.int32:
    """The cell that contains a point."""
    inner = cells.count - 1
    node = wp.int32(0)
    while node < inner:
        if point[cells.axis[node]] < cells.split[node]:
            node = 2 * node + 1
        else:
            node = 2 * node + 2
    return node - inner


@wp.func
def entry_of(cells: wp.ref[Cells], cell: wp.int32, origin: wp.vec3, inverse: wp.vec3, t_max: wp.float32) -> wp.float32:
    """Where a ray enters a cell's grown box, at least 0; -1 if it doesn't before t_max."""
    enter = children_enter(cells.boxes, cell / 8, origin, inverse)
    leave = children_leave(cells.boxes, cell / 8, origin, inverse * EXIT_SCALE, t_max)
    entry = enter[cell % 8]
    if entry > leave[cell % 8]:
        entry = -1.0
    return entry


@wp.func
def behind(enter: vec8, after: wp.float32, current: wp.int32) -> wp.int32:
    """Which lanes come after (after, current) in the order of (entry, lane): one bit each."""
    earlier = lanes_not_above(enter, vec8(after))
    equal = earlier & lanes_not_above(vec8(after), enter)
    above = wp.int32(255)
    if current >= 0:
        above = ~(2 * (1 << wp.min(current, 7)) - 1)
    return (~earlier) | (equal & above)


@wp.func(inline=False)
def cell_on_way(
    cells: wp.ref[Cells],
    origin: wp.vec3,
    direction: wp.vec3,
    t_max: wp.float32,
    current: wp.int32,
    known: wp.int32,
    outlined: wp.bool,
) -> wp.int32:
    """The cell that a ray comes to after `current` (-1: before the first), or -1 when none is left.

    Args:
        known: a cell that it need not come to; -1 for none.
        outlined: whether it passes by cells in which it meets nothing of the outline.
    """
    if cells.count == 1:
        return wp.where(known == 0, -1, -1 - current)  # the only cell, once: 0 after -1, -1 after 0
    inverse = inverse_direction(direction)
    after = wp.float32(-1.0)
    if current >= 0:
        after = wp.max(entry_of(cells, current, origin, inverse, 3.4e38), 0.0)
    found = wp.int32(-1)
    entry = wp.float32(3.4e38)
    for eight in range((cells.count + 7) / 8):
        enter = children_enter(cells.boxes, eight, origin, inverse)
        met = lanes_not_above(enter, children_leave(cells.boxes, eight, origin, inverse * EXIT_SCALE, t_max))
        met = met & behind(enter, after, current - 8 * eight) & ~lanes_not_above(vec8(entry), enter)
        if known >= 0 and known / 8 == eight:
            met = met & ~(1 << (known % 8))
        if outlined:
            met = met & outlines_near(cells.outlines, eight, origin, inverse, t_max)
        while met != 0:
            lane = lowest_bit(met)
            met = met & (met - 1)
            cell = 8 * eight + lane
            there = wp.bool(True)
            if outlined:
                there = meets_outline(cells.outlines, cell, origin, direction, inverse, t_max)
            if there:
                entry = enter[lane]
                found = cell
                met = met & ~lanes_not_above(vec8(entry), enter)
    return found


@wp.func
def next_cell(
    cells: wp.ref[Cells], origin: wp.vec3, direction: wp.vec3, t_max: wp.float32, current: wp.int32
) -> wp.int32:
    """The cell that a ray visits after `current` (-1: before the first), or -1 when none is left.

    A ray that meets no cell's outline visits the one that it starts in, so that it is seen to its end somewhere.
    """
    if cells.count == 1:
        return -1 - current  # as there, without a call
    cell = cell_on_way(cells, origin, direction, t_max, current, -1, True)
    if cell < 0 and current < 0:
        cell = cell_of(cells, origin)
    return cell


@wp.func
def cell_beside(
    cells: wp.ref[Cells], origin: wp.vec3, direction: wp.vec3, t_max: wp.float32, own: wp.int32
) -> wp.int32:
    """The first cell but `own` that a ray may meet something in, or -1.

    A ray that sets out in a cell and meets that first need not know when it comes there. Should another cell be before
    it, then its way goes on from there, and may lead here once more: to the same hit.
    """
    return cell_on_way(cells, origin, direction, t_max, -1, own, True)


@wp.func
def may_meet(cells: wp.ref[Cells], cell: wp.int32, origin: wp.vec3, direction: wp.vec3, t_max: wp.float32) -> wp.bool:
    """Whether a ray may meet something in a cell, as far as that is found out in less time than by the cell's tree.

    That is where all that it holds are some faces: many a shadow ray meets none of them, but comes near those of the
    surface and of the lamp that it goes from and to.
    """
    if cells.outlines.flat[cell] == 0:
        return True
    return meets_outline(cells.outlines, cell, origin, direction, inverse_direction(direction), t_max)


@wp.func
def next_cell_of(
    cells: wp.ref[Cells],
    origin: wp.vec3,
    direction: wp.vec3,
    t_max: wp.float32,
    end: wp.int32,
    own: wp.int32,
    fresh: wp.int32,
) -> wp.int32:
    """The cell that a ray visits once `own` has been asked about it, or -1.

    Cells are convex. What begins and ends in one has met nothing that this does not hold: no other need be looked at,
    and no outline. Nor what comes from others and ends here, since those before it have been asked.

    Args:
        end: the cell that the point at t_max lies in; -1 where the ray has no end.
        fresh: 1 where that was the first to be asked, whether or not it is first on the way: see cell_beside. Else 0.
    """
    cell = wp.int32(-1)
    if fresh != 0:
        if end != own or cell_of(cells, origin) != own:
            cell = cell_beside(cells, origin, direction, t_max, own)
    elif end != own:
        cell = next_cell(cells, origin, direction, t_max, own)
    return cell
