"""Rays through grids: how much they pass on a stretch, and where they have passed a given amount. Without noise.

What a ray passes is the integral of the grid's values along it, its *optical length*: the distance in a homogeneous
medium of density 1 that takes as much light. In a cell of trilinear values it is that of a cubic polynomial, which
Simpson's rule gives exactly. So walks step from cell to cell (Amanatides & Woo 1987) and add exact integrals in
float64: regular tracking (Sutton et al. 1999), not delta or ratio tracking (Woodcock et al. 1965; Novák et al. 2014),
which cross a grid in tentative steps of a majorant's length. Those need fewer look-ups where a grid is fine and thin,
but no bound holds for their number where values range over orders of magnitude, and their transmittance is noisy.

* A walk is a function of the ray and the grid alone; it begins where it is told to, not at a border of a part of the
  scene, and takes no random number.
* It has at most one step for each plane of the lattice: sums of a grid's sides, whatever its values.
* Whole blocks that are empty, or of one value, are one step.
"""

from __future__ import annotations

import math

import warp as wp

from wdpm.kernels.materials.grids import BLOCK, Corners, Grids, cell_at, corners_of, value_of, within

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_SIDE = wp.constant(BLOCK)
_SIDE_LENGTH = wp.constant(wp.float64(BLOCK))
_INF = wp.constant(wp.float64(math.inf))
_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_HALF = wp.constant(wp.float64(0.5))
_FOUR = wp.constant(wp.float64(4.0))
_SIXTH = wp.constant(wp.float64(1.0 / 6.0))
_LEAST = wp.constant(wp.float64(1e-300))
"""Least optical length that is looked for: of none at all the first place with a density is meant."""

_ROUNDS = wp.constant(64)
"""Steps of the search for a place in a cell, at most: bisection alone would tell it to a rounding in 53."""
_CLOSE = wp.constant(wp.float64(2.0**-40))
"""Share of a cell to which a place is told: far below a float32's rounding."""


@wp.struct
class LatticeRay:
    """A ray in the coordinates of a lattice; t is the distance along it in the scene.

    Attributes:
        direction: change of coordinates per unit of t.
        inverse: of each component of it, 0 where that is 0.
        enter, leave: where the ray is in the grid's box; enter >= leave if nowhere.
    """

    grid: wp.int32
    origin: wp.vec3d
    direction: wp.vec3d
    inverse: wp.vec3d
    enter: wp.float64
    leave: wp.float64


@wp.struct
class Walk:
    """How far a walk came.

    Attributes:
        t: where it ended.
        passed: optical length up to there.
        arrived: 1 if it has passed what it was to pass.
    """

    t: wp.float64
    passed: wp.float64
    arrived: wp.int32


@wp.struct
class _Plane:
    """The next plane of cells or blocks that a ray meets, and the axis that it lies across."""

    t: wp.float64
    axis: wp.int32


@wp.func
def lattice_ray(grids: wp.ref[Grids], grid: wp.int32, origin: wp.vec3, direction: wp.vec3) -> LatticeRay:
    """A ray as a grid sees it.

    Args:
        direction: unit.
    """
    ray = LatticeRay()
    ray.grid = grid
    rotation = grids.rotation[grid]
    point = wp.vec3d(wp.float64(origin[0]), wp.float64(origin[1]), wp.float64(origin[2]))
    ray.origin = rotation * point + grids.shift[grid]
    ray.direction = rotation * wp.vec3d(wp.float64(direction[0]), wp.float64(direction[1]), wp.float64(direction[2]))
    low = grids.low[grid]
    high = grids.high[grid]
    ray.enter = _ZERO
    ray.leave = _INF
    for axis in range(3):
        if ray.direction[axis] == _ZERO:
            if ray.origin[axis] < low[axis] or ray.origin[axis] > high[axis]:
                ray.leave = _ZERO
        else:
            ray.inverse[axis] = _ONE / ray.direction[axis]
            one = (low[axis] - ray.origin[axis]) * ray.inverse[axis]
            other = (high[axis] - ray.origin[axis]) * ray.inverse[axis]
            ray.enter = wp.max(ray.enter, wp.min(one, other))
            ray.leave = wp.min(ray.leave, wp.max(one, other))
    return ray


@wp.func
def _next_plane(ray: LatticeRay, cell: wp.vec3i, side: wp.int32) -> _Plane:
    """Where a ray leaves a cell of so many lattice cells a side."""
    nearest = _Plane()
    nearest.t = _INF
    for axis in range(3):
        if ray.direction[axis] != _ZERO:
            face = cell[axis]
            if ray.direction[axis] > _ZERO:
                face += 1
            t = (wp.float64(face * side) - ray.origin[axis]) * ray.inverse[axis]
            if t < nearest.t:
                nearest.t = t
                nearest.axis = axis
    return nearest


@wp.func
def _beyond(ray: LatticeRay, cell: wp.vec3i, axis: wp.int32) -> wp.vec3i:
    """The neighbour that a ray enters across a plane."""
    step = wp.where(ray.direction[axis] > _ZERO, 1, -1)
    return cell + wp.vec3i(wp.where(axis == 0, step, 0), wp.where(axis == 1, step, 0), wp.where(axis == 2, step, 0))


@wp.func
def _outside(cell: wp.vec3i, least: wp.vec3i, most: wp.vec3i) -> bool:
    outside = wp.bool(False)
    for axis in range(3):
        outside = outside or cell[axis] < least[axis] or cell[axis] > most[axis]
    return outside


@wp.func
def _integral(c: Corners, start: wp.vec3d, way: wp.vec3d, length: wp.float64, share: wp.float64) -> wp.float64:
    """What is passed on the first `share` of a way of some length through a cell: Simpson's rule."""
    middle = value_of(c, start + (_HALF * share) * way)
    return share * length * (value_of(c, start) + _FOUR * middle + value_of(c, start + share * way)) * _SIXTH


@wp.func
def _share_for(c: Corners, start: wp.vec3d, way: wp.vec3d, length: wp.float64, wanted: wp.float64) -> wp.float64:
    """The share of a way after which `wanted` is passed, no more than all of it has: Newton's method between bounds."""
    least = wp.float64(0.0)
    most = wp.float64(1.0)
    share = wp.float64(0.5)
    step = wp.float64(1.0)
    rounds = wp.int32(0)
    while rounds < _ROUNDS and wp.abs(step) > _CLOSE:
        excess = _integral(c, start, way, length, share) - wanted
        if excess < _ZERO:
            least = share
        else:
            most = share
        slope = length * value_of(c, start + share * way)
        onward = _HALF * (least + most)
        if slope > _ZERO:
            by_slope = share - excess / slope
            if by_slope > least and by_slope < most:
                onward = by_slope
        step = onward - share
        share = onward
        rounds += 1
    return share


@wp.func
def _walk_cells(
    grids: wp.ref[Grids],
    ray: LatticeRay,
    block: wp.vec3i,
    start: wp.float64,
    end: wp.float64,
    wanted: wp.float64,
) -> Walk:
    """A walk within one block, from start to end, or to where `wanted` > 0 is passed."""
    least = _SIDE * block
    most = wp.min(least + wp.vec3i(_SIDE - 1, _SIDE - 1, _SIDE - 1), grids.last[ray.grid])
    cell = cell_at(ray.origin + start * ray.direction, least, most)
    w = Walk()
    w.t = start
    while w.t < end and w.arrived == 0:
        plane = _next_plane(ray, cell, 1)
        t = wp.clamp(plane.t, w.t, end)
        length = t - w.t
        if length > _ZERO:
            c = corners_of(grids, ray.grid, cell, 0)
            begin = within(ray.origin + w.t * ray.direction, cell)
            way = within(ray.origin + t * ray.direction, cell) - begin
            piece = _integral(c, begin, way, length, _ONE)
            if w.passed + piece >= wanted:
                t = w.t + length * _share_for(c, begin, way, length, wanted - w.passed)
                w.arrived = 1
                w.passed = wanted
            else:
                w.passed += piece
        w.t = t
        cell = _beyond(ray, cell, plane.axis)
        if _outside(cell, least, most) and w.arrived == 0:
            w.t = end  # but for a rounding, that is where the ray is
    return w


@wp.func
def walk(grids: wp.ref[Grids], ray: LatticeRay, start: wp.float64, end: wp.float64, wanted: wp.float64) -> Walk:
    """A walk along a ray from start to end, or to where it has passed `wanted`.

    Args:
        start, end: distances; end may be infinite.
        wanted: optical length; may be infinite.
    """
    first = wp.max(start, ray.enter)
    last = wp.min(end, ray.leave)
    w = Walk()
    w.t = first
    if first < last:
        most = grids.blocks[ray.grid] - wp.vec3i(1, 1, 1)
        none = wp.vec3i(0, 0, 0)
        block = cell_at((ray.origin + first * ray.direction) / _SIDE_LENGTH, none, most)
        while w.t < last and w.arrived == 0:
            plane = _next_plane(ray, block, _SIDE)
            t = wp.clamp(plane.t, w.t, last)
            sides = grids.blocks[ray.grid]
            number = grids.block_start[ray.grid] + (block[2] * sides[1] + block[1]) * sides[0] + block[0]
            value = wp.float64(grids.most[number])
            rest = wp.max(wanted - w.passed, _LEAST)
            if value > _ZERO and t > w.t:
                if grids.least[number] == grids.most[number]:
                    if value * (t - w.t) >= rest:
                        t = wp.min(w.t + rest / value, t)
                        w.arrived = 1
                    else:
                        w.passed += value * (t - w.t)
                else:
                    inner = _walk_cells(grids, ray, block, w.t, t, rest)
                    t = inner.t
                    w.arrived = inner.arrived
                    w.passed += inner.passed
            w.t = t
            block = _beyond(ray, block, plane.axis)
            if _outside(block, none, most) and w.arrived == 0:
                w.t = last
    return w


@wp.func
def passed_up_to(grids: wp.ref[Grids], ray: LatticeRay, start: wp.float64, end: wp.float64) -> wp.float64:
    """Optical length of a stretch of a ray."""
    w = walk(grids, ray, start, end, _INF)
    return w.passed
