"""Irradiance at photons beside walls: by the photons, and by the surface, that nothing stands before.

A gather takes in photons of all surface about it that lies and faces alike. Where a floor goes on beneath a wall those
of the room beyond are among them: without thickness, or thinner than a gather is wide, such a wall lets light through.
So photons that carry irradiance have felt for walls (walls.py), and those that meet one within their gather estimate
anew: from photons, and with points that measure surface, that lie before the walls.

What is hidden goes by directions: of the photons between two feelers those are that lie behind the plane of what either
of them has met. Beside a door or a pole that is too much, and costs some photons; since points are left out
by the same rule, it costs no light.
"""

from __future__ import annotations

import math

import warp as wp

from wdpm.kernels.constants import INV_PI
from wdpm.kernels.limits import MAX_K
from wdpm.kernels.maths.directions import around
from wdpm.kernels.photons.gather import (
    INT_SCRATCH,
    KEY_SCRATCH,
    Nearest,
    box_distance2,
    contribution,
    estimate,
    key_distance2,
    key_place,
    nearest_or_within,
    select,
)
from wdpm.kernels.photons.gather_at_photons import excess_of_self, grazing, self_last
from wdpm.kernels.photons.photon_map import LEAF_ROWS, NODE_ROWS, POINT_ROWS, PhotonMap, first_child
from wdpm.kernels.photons.surface_points import counted_radius, larger_than, passing, share_of_disc
from wdpm.kernels.photons.walls import FEELERS

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FEELERS = wp.constant(FEELERS)
_PI = wp.constant(wp.float32(math.pi))


@wp.struct
class View:
    """What a place knows of the walls about it.

    Attributes:
        x: the place.
        across, along: unit vectors of the surface there, towards feelers 0 and 2.
        room2: square of the distance within which nothing is hidden.
        first: of its walls.
    """

    x: wp.vec3
    across: wp.vec3
    along: wp.vec3
    room2: wp.float32
    first: wp.int32


@wp.func
def _view(x: wp.vec3, n: wp.vec3, room: wp.float32, site: wp.int32) -> View:
    view = View()
    view.x = x
    view.across = around(n, wp.vec3(1.0, 0.0, 0.0))
    view.along = around(n, wp.vec3(0.0, 1.0, 0.0))
    view.room2 = room * room
    view.first = _FEELERS * site
    return view


@wp.func
def _feeler_before(a: wp.float32, b: wp.float32) -> wp.int32:
    """The last of the eight feelers that comes before a direction (a, b), counterclockwise from (1, 0)."""
    half = wp.int32(0)
    if b < 0.0 or (b == 0.0 and a < 0.0):
        half = 4
        a = -a
        b = -b
    quarter = wp.int32(0)
    if a <= 0.0:
        quarter = 2
        turned = a
        a = b
        b = -turned
    return half + quarter + wp.int32(b >= a)


@wp.func
def _is_seen(walls: wp.array[wp.vec3], view: View, p: wp.vec3) -> wp.bool:
    """Whether a place of the surface lies before all walls."""
    way = p - view.x
    seen = wp.dot(way, way) <= view.room2
    if not seen:
        a = wp.dot(way, view.across)
        b = wp.dot(way, view.along)
        feeler = _feeler_before(a, b)
        one = walls[view.first + feeler]
        other = walls[view.first + (feeler + 1) % _FEELERS]
        seen = one[0] * a + one[1] * b <= one[2] and other[0] * a + other[1] * b <= other[2]
    return seen


@wp.func
def _seen_first(
    photons: wp.ref[PhotonMap],
    walls: wp.array[wp.vec3],
    view: View,
    count: wp.int32,
    candidates: wp.array[wp.uint64],
) -> wp.int32:
    """Moves the photons that the place sees to the front of the candidates; returns how many these are."""
    seen = wp.int32(0)
    for i in range(count):
        key = candidates[i]
        place = key_place(key)
        row = LEAF_ROWS * (place >> 3)
        c = place & 7
        p = wp.vec3(photons.leaves[row + 0][c], photons.leaves[row + 1][c], photons.leaves[row + 2][c])
        if _is_seen(walls, view, p):
            candidates[i] = candidates[seen]
            candidates[seen] = key
            seen += 1
    return seen


@wp.func
def _within(radius2: wp.float32, count: wp.int32, candidates: wp.array[wp.uint64]) -> wp.int32:
    """Moves the photons that lie nearer than a radius to the front of the candidates; returns how many these are."""
    within = wp.int32(0)
    for i in range(count):
        key = candidates[i]
        if key_distance2(key) < radius2:
            candidates[i] = candidates[within]
            candidates[within] = key
            within += 1
    return within


@wp.func
def _nearest_in_sight(
    photons: wp.ref[PhotonMap],
    walls: wp.array[wp.vec3],
    view: View,
    n: wp.vec3,
    k: wp.int32,
    r_max: wp.float32,
    r_least: wp.float32,
    candidates: wp.array[wp.uint64],
    ints: wp.array[wp.int32],
) -> Nearest:
    """As gather.nearest_or_within, of the photons that the place sees.

    The nearest of all are asked for, in growing numbers, until more than k are in sight; or MAX_K.
    """
    wanted = wp.int32(k)
    seen = wp.int32(0)
    found = Nearest()
    searching = wp.bool(True)
    while searching:
        found = nearest_or_within(photons, view.x, n, wanted, r_max, r_least, 0.0, candidates, ints)
        seen = _seen_first(photons, walls, view, found.count, candidates)
        all_there_are = found.truncated or found.radius <= r_least or wanted == MAX_K
        searching = seen < found.count and seen <= k and not all_there_are
        wanted = wp.min(2 * wanted, MAX_K)
    if seen > k and found.radius > r_least:  # all of them within r_least if they are many, else the nearest k
        near = _within(r_least * r_least, seen, candidates)
        if near > k:
            found.area_radius2 = r_least * r_least
            found.radius = r_least
            seen = near
        else:
            select(candidates, seen, k, found.area_radius2, photons.rank, ints)
            found.area_radius2 = key_distance2(candidates[k])
            found.radius = wp.sqrt(found.area_radius2)
            seen = k
    found.count = seen
    return found


@wp.func
def _count_in_sight(
    points: wp.ref[PhotonMap],
    walls: wp.array[wp.vec3],
    view: View,
    front: wp.vec3,
    radius2: wp.float32,
    larger2: wp.float32,
    stack: wp.array[wp.int32],
) -> wp.vec2i:
    """As surface_points.count_within; and how many of the points the place sees.

    Args:
        front: unit normal of the surface's front.
    """
    found = wp.int32(0)
    seen = wp.int32(0)
    stacked = wp.int32(1)
    stack[0] = 0
    while stacked > 0:
        stacked -= 1
        node = stack[stacked]
        child = first_child(node, points.fan_out)
        distance2 = box_distance2(points.nodes, NODE_ROWS * node, view.x)
        for c in range(8):
            if distance2[c] <= radius2:
                if child < points.inner_count:
                    stack[stacked] = child + c
                    stacked += 1
                else:
                    row = POINT_ROWS * (child + c - points.inner_count)
                    passes = passing(points, row, view.x, front, radius2, larger2)
                    for lane in range(8):
                        if passes[lane] > 0.0:
                            p = wp.vec3(
                                points.leaves[row + 0][lane],
                                points.leaves[row + 1][lane],
                                points.leaves[row + 2][lane],
                            )
                            found += 1
                            seen += wp.int32(_is_seen(walls, view, p))
    return wp.vec2i(found, seen)


@wp.kernel
def gather_in_sight(
    walls: wp.array[wp.vec3],
    photons: PhotonMap,
    points: PhotonMap,
    site: wp.array[wp.int32],
    rank: wp.array[wp.int32],
    position: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    front_normal: wp.array[wp.vec3],
    room: wp.array[wp.float32],
    radius: wp.array[wp.float32],
    k: wp.int32,
    r_max: wp.float32,
    r_least: wp.float32,
    point_area: wp.float32,
    share: wp.float32,
    reach: wp.float32,
    scale: wp.float32,
    offset: wp.int32,
    radiance_out: wp.array[wp.vec3],
    radius_out: wp.array[wp.float32],
    hidden_out: wp.array[wp.bool],
    grazing_out: wp.array[wp.float32],
) -> None:
    """Radiance that a white surface reflects at some photons of what they see, one thread each.

    As gather_at_photons and surface_points.reflect_gathered; but k photons in sight are looked for, among MAX_K.

    Args:
        walls: as feel_for_walls tells them of all of them.
        site: which of the photons, shape [S].
        rank, position, normal, room: of all of them.
        front_normal: unit normal of the surface's front, of all of them.
        radius: of the gathers that knew of no walls, of all of them.
        radiance_out, radius_out: where some surface is hidden, shape [S].
        hidden_out: whether it is; elsewhere what was gathered without knowing of walls is right, shape [S].
        grazing_out: as of gather_at_photons, shape [S]; empty where nobody asks.
    """
    i = offset + wp.tid()
    candidates = wp.zeros(shape=(KEY_SCRATCH,), dtype=wp.uint64)
    ints = wp.zeros(shape=(INT_SCRATCH,), dtype=wp.int32)
    q = site[i]
    x = position[q]
    n = normal[q]
    view = _view(x, n, room[q], q)
    r = counted_radius(radius[q], point_area, r_max)
    counted = _count_in_sight(points, walls, view, front_normal[q], r * r, larger_than(r, radius[q]), ints)
    hidden_out[i] = counted[1] < counted[0]
    if counted[1] < counted[0]:
        found = _nearest_in_sight(photons, walls, view, n, k, r_max, r_least, candidates, ints)
        others = self_last(photons, rank[q], found.count, candidates)
        irradiance = estimate(photons, candidates, others, n, n, found.area_radius2)
        if others < found.count:
            sites = share * wp.float32(others) * (reach * reach / found.area_radius2)
            own = contribution(photons, key_place(candidates[others]), n, n, False)
            irradiance += own * ((1.0 - excess_of_self(sites)) / (_PI * found.area_radius2))
        r = counted_radius(found.radius, point_area, r_max)
        counted = _count_in_sight(points, walls, view, front_normal[q], r * r, larger_than(r, found.radius), ints)
        radiance_out[i] = irradiance * (INV_PI * scale * share_of_disc(counted[1], r, point_area))
        radius_out[i] = found.radius
        if i < grazing_out.shape[0]:
            grazing_out[i] = grazing(photons, candidates, found.count, n)
