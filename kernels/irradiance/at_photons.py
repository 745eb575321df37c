"""Irradiance that was computed at some of the photons, read by the nearest of them.

A gather ray that lands on a surface needs no gather of its own: irradiance varies slowly and final gathering averages
over many rays. So it is estimated once at a share of the photons, which lie where light falls, and a ray reads the one
nearest to where it lands (Christensen 1999, "Faster Photon Map Global Illumination", Journal of Graphics Tools 4(3)).

The point that is found is a function of the set of points within reach, bit for bit: the normal's filter and the
metric are those of gathers (gather.py), points are ordered by (distance², id), which has no ties, and a box is passed
over only if its distance, which rounding never lifts above that of a point in it, is above that of the best so far.
Which photons carry a value is a function of their ids alone, so that every cell that holds a photon knows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from wdpm.kernels.constants import NORMAL_COS
from wdpm.kernels.photons.gather import distance2_to, dot8
from wdpm.kernels.photons.kd_order import Launch
from wdpm.kernels.photons.photon_map import LEAF_ROWS, PhotonMap, first_child, vec8
from wdpm.kernels.photons.photon_map import build as build_tree
from wdpm.kernels.rays.lanes import children_distance2, lanes_not_above, lowest_bit
from wdpm.scenes.errors import SettingsError, WdpmError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SEARCH_STACK = wp.constant(128)  # 7 siblings a level and 8 children; levels <= 10 for 2^31 points

# Tells the compiler that an index is not negative: Warp counts those from the end, which costs two instructions.
_STACK_MASK = wp.constant(127)
_NODE_MASK = wp.constant(wp.uint64(0x7FFFFFFF))
_NORMAL_COS = wp.constant(wp.float32(NORMAL_COS))
_RADIUS_ROW = wp.constant(6)  # of a leaf: the x of what photons have as their direction
_ROOM_ROW = wp.constant(7)
_GRAZING_ROW = wp.constant(8)


@wp.struct
class Found:
    """The nearest point."""

    place: wp.int32  # in the leaves; -1: none within reach
    distance2: wp.float32  # flattened along the query's normal, see gather.py; reach² if there is none


def chosen(ids: npt.NDArray[np.int64], share: float) -> npt.NDArray[np.bool_]:
    """Which photons carry a value: a share of them on average, picked by their ids alone.

    Ids are hashed, so that the picked ones are spread like all, whatever ids have in common; a smaller share picks some
    of those that a larger one does. The hash is the finaliser of SplitMix64 (Steele, Lea & Flood 2014, "Fast Splittable
    Pseudorandom Number Generators", figure 14, with the constants of its "mix variant 13").

    Args:
        ids: of photons, shape [N].
        share: above 0, up to 1.

    Returns:
        shape [N].

    Raises:
        SettingsError: the share is out of range.
    """
    if not 0 < share <= 1:
        raise SettingsError(f"the share of photons that carry irradiance is {share}, expected above 0 and at most 1")
    h = ids.astype(np.int64).view(np.uint64) + np.uint64(0x9E3779B97F4A7C15)  # without it id 0 hashes to 0
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    h = h ^ (h >> np.uint64(31))
    picked: npt.NDArray[np.bool_] = (h >> np.uint64(11)) < np.uint64(share * 2.0**53)
    return picked


def build(
    position: npt.ArrayLike,
    value: npt.ArrayLike,
    grazing: npt.ArrayLike,
    normal: npt.ArrayLike,
    radius: npt.ArrayLike,
    room: npt.ArrayLike,
    id: npt.ArrayLike,
    device: Any = "cpu",
    launch: Launch | None = None,
) -> Any:
    """The tree of N >= 0 points.

    Args:
        position: [scene units], shape [N, 3].
        value: what is read there, red, green, blue; finite, shape [N, 3].
        grazing: how much that light grazes the surface (kernels.maths.schlick), shape [N].
        normal: unit geometric normal, on the side that the light arrives at, shape [N, 3].
        radius: how far the photons lie that the value is estimated from [scene units], shape [N].
        room: how far off it may be read, as no wall is so near (photons.in_sight) [scene units], shape [N].
        id: integers, unique among all points, in this tree or not, shape [N].
        device, launch: see `photon_map.build`.

    Returns:
        PhotonMap, whose flux is the value and whose direction is (radius, room, grazing).

    Raises:
        WdpmError: shapes differ, a number is not finite or too large, or an id comes twice.
    """
    radii = np.asarray(radius, dtype=np.float32)
    direction = np.zeros((*radii.shape, 3), np.float32)
    direction[..., 0] = radii
    for axis, (name, column) in enumerate({"room": room, "grazing": grazing}.items(), start=1):
        of_each = np.asarray(column, dtype=np.float32)
        if of_each.shape != radii.shape:
            raise WdpmError(
                f"irradiance at photons: {name} of shape {of_each.shape} beside radii of shape {radii.shape}"
            )
        direction[..., axis] = of_each
    return build_tree(position, value, normal, direction, id, device, launch)


@wp.func
def _entry(distance2: wp.float32, node: wp.int32) -> wp.uint64:
    """Of the stack; sorts like the distance: bits of floats >= 0 sort like integers."""
    return (wp.uint64(wp.cast(distance2, wp.uint32)) << wp.uint64(32)) | wp.uint64(node)


@wp.func
def _entry_distance2(entry: wp.uint64) -> wp.float32:
    return wp.cast(wp.uint32(entry >> wp.uint64(32)), wp.float32)


@wp.func
def _push_children(
    points: wp.ref[PhotonMap],
    node: wp.int32,
    x: wp.vec3,
    radius2: wp.float32,
    stacked: wp.int32,
    stack: wp.array[wp.uint64],
) -> wp.int32:
    """Puts the children that the ball touches on the stack, the nearest on top; returns the stack's new height."""
    child = first_child(node, points.fan_out)
    distance2 = children_distance2(points.nodes, node, x)
    mask = lanes_not_above(distance2, vec8(radius2))
    height = wp.int32(stacked)
    if mask != 0:
        c = lowest_bit(mask)
        nearest = _entry(distance2[c], child + c)
        mask = mask & (mask - 1)
        while mask != 0:
            c = lowest_bit(mask)
            entry = _entry(distance2[c], child + c)
            stack[height & _STACK_MASK] = wp.max(entry, nearest)
            nearest = wp.min(entry, nearest)
            height += 1
            mask = mask & (mask - 1)
        stack[height & _STACK_MASK] = nearest
        height += 1
    return height


@wp.func
def _search_leaf(points: wp.ref[PhotonMap], leaf: wp.int32, x: wp.vec3, n: wp.vec3, best: Found) -> Found:
    """The better of the best so far and the leaf's points that pass the filter."""
    row = LEAF_ROWS * leaf
    distance2 = distance2_to(points.leaves[row + 0], points.leaves[row + 1], points.leaves[row + 2], x, n)
    facing = dot8(points.leaves[row + 3], points.leaves[row + 4], points.leaves[row + 5], n)
    mask = lanes_not_above(distance2, vec8(best.distance2)) & ~lanes_not_above(facing, vec8(_NORMAL_COS))
    found = Found()
    found.place = best.place
    found.distance2 = best.distance2
    while mask != 0:
        c = lowest_bit(mask)
        place = 8 * leaf + c
        closer = distance2[c] < found.distance2
        if distance2[c] == found.distance2:
            closer = found.place < 0
            if found.place >= 0:
                closer = points.rank[place] < points.rank[found.place]
        if closer:
            found.place = place
            found.distance2 = distance2[c]
        mask = mask & (mask - 1)
    return found


@wp.func
def nearest_point(
    points: wp.ref[PhotonMap], x: wp.vec3, n: wp.vec3, reach: wp.float32, stack: wp.array[wp.uint64]
) -> Found:
    """The nearest point whose normal is like that of the query; none, if a wall may stand between.

    The search goes down to the leaf nearest to x first, whose best point rules out nearly all of the tree.

    Args:
        points: the tree.
        x: position of the query [scene units].
        n: its unit geometric normal, on the viewer's side.
        reach: most distant point to find [scene units], MIN_GATHER_RADIUS .. MAX_GATHER_RADIUS.
        stack: scratch, wp.zeros(shape=(SEARCH_STACK,), dtype=wp.uint64) of the kernel.
    """
    found = Found()
    found.place = wp.int32(-1)
    found.distance2 = reach * reach
    stack[0] = wp.uint64(0)
    stacked = wp.int32(1)
    while stacked > 0:
        stacked -= 1
        entry = stack[stacked & _STACK_MASK]
        if _entry_distance2(entry) <= found.distance2:
            node = wp.int32(entry & _NODE_MASK)
            if node < points.inner_count:
                stacked = _push_children(points, node, x, found.distance2, stacked, stack)
            else:
                found = _search_leaf(points, node - points.inner_count, x, n, found)
    if found.place >= 0:
        room = points.leaves[LEAF_ROWS * (found.place >> 3) + _ROOM_ROW][found.place & 7]
        if found.distance2 > room * room:
            found.place = wp.int32(-1)
    return found


@wp.func
def value_at(points: wp.ref[PhotonMap], place: wp.int32) -> wp.vec3:
    """What is read at a point that was found."""
    return points.flux[place]


@wp.func
def radius_at(points: wp.ref[PhotonMap], place: wp.int32) -> wp.float32:
    """Radius of the estimate at a point that was found [scene units]."""
    return points.leaves[LEAF_ROWS * (place >> 3) + _RADIUS_ROW][place & 7]


@wp.func
def grazing_at(points: wp.ref[PhotonMap], place: wp.int32) -> wp.float32:
    """How much the light of a point that was found grazes the surface."""
    return points.leaves[LEAF_ROWS * (place >> 3) + _GRAZING_ROW][place & 7]


@wp.kernel
def read_irradiance(
    points: PhotonMap,
    position: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    reach: wp.float32,
    offset: wp.int32,
    value_out: wp.array[wp.vec3],
    grazing_out: wp.array[wp.float32],
    radius_out: wp.array[wp.float32],
    found_out: wp.array[wp.bool],
) -> None:
    """What the nearest point of each query says; zeros where there is none. Arguments as for `nearest_point`.

    Args:
        value_out: the point's value.
        grazing_out: how much its light grazes the surface.
        radius_out: radius of its estimate [scene units].
        found_out: whether there is a point within reach.
    """
    i = offset + wp.tid()
    stack = wp.zeros(shape=(SEARCH_STACK,), dtype=wp.uint64)
    found = nearest_point(points, position[i], normal[i], reach, stack)
    value = wp.vec3(0.0)
    radius = wp.float32(0.0)
    grazing = wp.float32(0.0)
    if found.place >= 0:
        value = value_at(points, found.place)
        radius = radius_at(points, found.place)
        grazing = grazing_at(points, found.place)
    value_out[i] = value
    grazing_out[i] = grazing
    radius_out[i] = radius
    found_out[i] = found.place >= 0
