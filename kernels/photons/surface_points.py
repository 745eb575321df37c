"""How much surface lies within a gather: counted, not assumed to be a full disc.

The textbook divides gathered flux by the area of a disc, pi r². At an edge, in a corner, on a column or a moulding,
part of the disc is off the surface, and the estimate is too dark, the more so the smaller the features are against r
(by 11 to 18 % on average in a cathedral with a million photons). So points are spread evenly over all surfaces, and
those that pass the very filters and the metric of the gather are counted: each stands for the same area. A gather that
lies within its own triangle needs no count.

Points are places like photons, in the same kind of tree; cells hold those of their band. A count is an integer: it
does not depend on tree, order or partition.

A triangle knows its points without its neighbours: how many by the area that comes before it along a curve through its
mesh (scenes.flat.surface_order), and where by their numbers along that curve. Its own number would not do: any sequence
of such keeps pace with the rows of some mesh (a wall of 200 x 200 squares was measured up to six times too small), or
is as good as random.

A count varies, and one over a number that varies is too large on average, by its variance over its square: 1 % at 16
points, where photons lie densest and most of the light is. With a variance v, 1 / (count + v / count) is right to
second order. The variance goes as the root of the count, as the disc's rim does (COUNT_VARIANCE).

Where photons lie so densely that their disc has fewer than LEAST_POINTS, a larger one is counted, and its share of
surface is taken for the gather's. Where edges are near that is too small a share. So gathers use all photons within
that larger disc (least_radius; gather.py), but for caustics that the camera sees, which are to stay sharp.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.constants import FLATTENING, INV_PI, LEAST_POINTS, LEAST_SQUARE, NORMAL_COS
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.gather import box_distance2, dot8, next_above
from wdpm.kernels.photons.photon_map import NODE_ROWS, POINT_ROWS, PhotonMap, first_child, vec8
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.cells import Cells, cell_of
from wdpm.kernels.rays.instanced_triangles import front_of_all, position_at_all

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FLATTENING = wp.constant(wp.float32(FLATTENING * FLATTENING - 1.0))
_TURN = wp.constant(wp.float32(1.0 - NORMAL_COS))
_PI = wp.constant(wp.float32(math.pi))
_ONE = wp.constant(wp.float64(1.0))
_HALF = wp.constant(wp.float64(0.5))
_STACK = wp.constant(128)  # as in gather.py
_LEAST_SQUARE = wp.constant(wp.float32(LEAST_SQUARE))
_LARGER2_MOST = wp.constant(wp.float32(4.0))  # how much more may bend, see count_within

PLASTIC = (0.7548776662466927, 0.5698402909980532)
"""1 / p and 1 / p² of the plastic number p: the additive recurrence with them fills the unit square evenly
(Roberts 2018, "The Unreasonable Effectiveness of Quasirandom Sequences"), as 1 / phi does the unit interval."""

MOST_NUMBERS = 2.0**24
"""Points have so many different places in their triangles: with larger numbers the fractions would lose their bits."""

COUNT_VARIANCE = 0.7
"""Variance of a count over the root of its mean: what is gained or lost lies on the disc's rim. On walls, spheres and
triangles between random points, 500 to 100,000 of them, it was 0.4 to 0.7 with 8 to 64 points in the disc, 0.9 in pairs
of 512, and 1.1 to 1.7 on walls of strips as high as they are."""

_COUNT_VARIANCE = wp.constant(wp.float32(COUNT_VARIANCE))
_PLASTIC = wp.constant(wp.float64(PLASTIC[0]))
_PLASTIC_SQUARED = wp.constant(wp.float64(PLASTIC[1]))


def points_of(
    area: NDArray[np.float64], before: NDArray[np.float64], point_area: float, point_set: int = 0
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The points of each triangle: of all along the curve the number of its first, and how many it has.

    That is its area over `point_area`, rounded up where the area before it is nearly enough for one more. So all
    triangles up to any place of the curve have as many points as their area says, less than one more or less.

    Args:
        before: what area comes before each triangle, shape [T].
        point_set: which of many sets of points.
    """
    reached = before / point_area + point_set * PLASTIC[0]
    whole = np.floor(reached)
    counts = np.floor(area / point_area + (reached - whole))
    return (whole % MOST_NUMBERS).astype(np.int64), counts.astype(np.int64)


def least_radius(point_area: float, r_max: float) -> float:
    """The radius of discs that hold LEAST_POINTS points on a plane, but no more than that of the largest gather.

    Args:
        point_area: the area that each point stands for.
        r_max: radius of the largest gather [scene units].
    """
    return min(math.sqrt(LEAST_POINTS * point_area / math.pi), r_max)


def even_runs(counts: NDArray[np.int64], most: int) -> Iterator[NDArray[np.intp]]:
    """Rows that have some, in order, so many at a time that they have about `most` together."""
    some = np.flatnonzero(counts)
    before = np.cumsum(counts[some]) - counts[some]
    yield from np.split(some, np.flatnonzero(np.diff(before // most)) + 1) if len(some) else ()


@wp.kernel
def _place_points(
    surfaces: Surfaces,
    cells: Cells,
    rows: wp.array[wp.vec2i],
    begin: wp.array[wp.int64],
    triangle: wp.array[wp.int32],
    offset: wp.int32,
    position_out: wp.array[wp.vec3],
    normal_out: wp.array[wp.vec3],
    cell_out: wp.array[wp.int32],
) -> None:
    """Where points lie in their triangles goes by their numbers along the curve: neighbours lie at other spots.

    Args:
        triangle: of each point; rows: of each triangle; begin: the point whose number would be 0 there.
    """
    i = offset + wp.tid()
    t = triangle[i]
    number = wp.float64(wp.int64(i) - begin[t])
    u = number * _PLASTIC
    v = _HALF + number * _PLASTIC_SQUARED
    u = u - wp.floor(u)
    v = v - wp.floor(v)
    if u + v > _ONE:
        u = _ONE - u
        v = _ONE - v
    position = position_at_all(surfaces, rows[t], wp.float32(u), wp.float32(v))
    position_out[i] = position
    normal_out[i] = front_of_all(surfaces, rows[t])
    cell_out[i] = cell_of(cells, position)


def spread(
    surfaces: Surfaces,
    cells: Cells,
    cell: int,
    rows: NDArray[np.int32],
    first: NDArray[np.int64],
    counts: NDArray[np.int64],
    launcher: Launcher,
    point_set: int = 0,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The points of a cell on some triangles: those that lie in it.

    Args:
        rows: of the triangles, as rays.instanced_triangles has them, shape [T, 2].
        first: of the points of each the number of its first, shape [T], and ...
        counts: ... how many it has (points_of), shape [T].
        point_set: which of many sets; each goes on in a triangle where the one before ended. The error of a count is
            then another in each pass of a render, and the mean of passes has less of it.

    Returns:
        positions and unit normals of the front side, float32, shape [points, 3] each.
    """
    triangle = np.repeat(np.arange(len(rows), dtype=np.int32), counts)
    begin = np.cumsum(counts) - counts - point_set * counts - first
    device = launcher.device
    position = wp.empty(len(triangle), dtype=wp.vec3, device=device)
    normal = wp.empty(len(triangle), dtype=wp.vec3, device=device)
    owner = wp.empty(len(triangle), dtype=wp.int32, device=device)
    launcher(
        _place_points,
        len(triangle),
        surfaces=surfaces,
        cells=cells,
        rows=wp.array(rows, dtype=wp.vec2i, device=device),
        begin=wp.array(begin, dtype=wp.int64, device=device),
        triangle=wp.array(triangle, dtype=wp.int32, device=device, copy=False),
        position_out=position,
        normal_out=normal,
        cell_out=owner,
    )
    own = owner.numpy() == cell
    if own.all():
        return position.numpy(), normal.numpy()
    return position.numpy()[own], normal.numpy()[own]


@wp.func
def passing(
    points: wp.ref[PhotonMap], row: wp.int32, x: wp.vec3, n: wp.vec3, radius2: wp.float32, larger2: wp.float32
) -> vec8:
    """Above 0 for those of the eight points of a leaf that count_within counts."""
    dx = points.leaves[row + 0] - vec8(x[0])
    dy = points.leaves[row + 1] - vec8(x[1])
    dz = points.leaves[row + 2] - vec8(x[2])
    height = dot8(dx, dy, dz, n)
    # Never below the box's distance, by the order of operations, as in gather.distance2_to.
    d2 = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)
    d2 = d2 + (_FLATTENING / larger2) * wp.cw_mul(height, height)
    facing = dot8(points.leaves[row + 3], points.leaves[row + 4], points.leaves[row + 5], n)
    return wp.min(vec8(next_above(radius2)) - d2, facing - vec8(1.0 - _TURN * larger2))


@wp.func
def counted_radius(radius: wp.float32, point_area: wp.float32, r_max: wp.float32) -> wp.float32:
    """Of the disc in which points are counted: where photons lie denser than points, larger than that of the gather."""
    return wp.max(radius, wp.min(wp.sqrt(LEAST_POINTS * point_area / _PI), r_max))


@wp.func
def larger_than(r: wp.float32, radius: wp.float32) -> wp.float32:
    """The square of how many times as wide that disc is as the gather's: `larger2` of count_within."""
    return wp.min(r * r / wp.max(radius * radius, _LEAST_SQUARE), _LARGER2_MOST)


@wp.func
def share_of_disc(found: wp.int32, r: wp.float32, point_area: wp.float32) -> wp.float32:
    """A disc's area over that of the surface in it, by the points that were found there."""
    count = wp.float32(wp.max(found, 1))
    return (_PI * r * r) / ((count + _COUNT_VARIANCE / wp.sqrt(count)) * point_area)


@wp.func
def count_within(
    points: wp.ref[PhotonMap],
    x: wp.vec3,
    n: wp.vec3,
    radius2: wp.float32,
    larger2: wp.float32,
    stack: wp.array[wp.int32],
) -> wp.int32:
    """Points that pass the filters and the metric of a gather at x with the normal n.

    In a disc that is s times as wide as that of a gather, a surface that bends is s² times as far off the tangent
    plane, and its normals turn s times as far. For the same share of the disc to pass as passes the gather, heights
    count s times less there, and normals may differ s times as much. Unless they do, a bowl or a column that photons
    lie densely on is too bright. Up to s = 2, or what stands before the surface would count.

    Args:
        larger2: s², in 1 .. 4.
    """
    found = wp.int32(0)
    stacked = wp.int32(1)
    stack[0] = 0
    while stacked > 0:
        stacked -= 1
        node = stack[stacked]
        child = first_child(node, points.fan_out)
        distance2 = box_distance2(points.nodes, NODE_ROWS * node, x)
        if child < points.inner_count:
            for c in range(8):
                stack[stacked] = child + c
                stacked += wp.int32(distance2[c] <= radius2)
        else:
            for c in range(8):
                if distance2[c] <= radius2:
                    passes = passing(points, POINT_ROWS * (child + c - points.inner_count), x, n, radius2, larger2)
                    for lane in range(8):
                        found += wp.int32(passes[lane] > 0.0)
    return found


@wp.func
def of_surface(
    points: wp.ref[PhotonMap],
    position: wp.vec3,
    front_normal: wp.vec3,
    clearance: wp.float32,
    irradiance: wp.vec3,
    radius: wp.float32,
    point_area: wp.float32,
    r_max: wp.float32,
    stack: wp.array[wp.int32],
) -> wp.vec3:
    """The irradiance of a gather, corrected from a disc's area to the surface's. Arguments as of reflect_gathered.

    Args:
        stack: scratch, at least 128 numbers.
    """
    incoming = irradiance
    # Around most places that ask a map of few photons there are none: of nothing no share need be known.
    if radius > clearance and wp.max(incoming) > 0.0:
        r = counted_radius(radius, point_area, r_max)
        found = count_within(points, position, front_normal, r * r, larger_than(r, radius), stack)
        incoming = incoming * share_of_disc(found, r, point_area)
    return incoming


@wp.kernel
def reflect_gathered(
    points: PhotonMap,
    position: wp.array[wp.vec3],
    front_normal: wp.array[wp.vec3],
    clearance: wp.array[wp.float32],
    albedo: wp.array[wp.vec3],
    irradiance: wp.array[wp.vec3],
    radius: wp.array[wp.float32],
    point_area: wp.float32,
    r_max: wp.float32,
    scale: wp.float32,
    offset: wp.int32,
    radiance_out: wp.array[wp.vec3],
) -> None:
    """Radiance that diffuse surfaces reflect of gathered irradiance, corrected from a disc's area to the surface's.

    Args:
        front_normal: unit normal of the surface's front, whichever side is seen.
        clearance: distance to the nearest edge of the query's own triangle.
        irradiance, radius: of each gather.
        point_area: the area that each point stands for.
        scale: 1 / photon paths.
    """
    i = offset + wp.tid()
    stack = wp.zeros(shape=(_STACK,), dtype=wp.int32)
    corrected = of_surface(
        points, position[i], front_normal[i], clearance[i], irradiance[i], radius[i], point_area, r_max, stack
    )
    radiance_out[i] = wp.cw_mul(albedo[i], corrected) * (INV_PI * scale)
