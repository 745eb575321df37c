"""The irradiance cache: interpolation between the records that reach a point.

Record i reaches the point x with the normal n if t_i > 0, and then weighs w_i = t_i²:

    t_i = 1 - (|x - x_i|² + (W² - 1) h²) / R_i² - (1 - n · n_i) / (1 - cos 10°),  h = (x - x_i) · (n + n_i) / 2.

This is the error of Tabellion & Lamorlette 2004 ("An Approximate Global Illumination System for Computer Generated
Films") with its two terms added as squares instead of the larger one taken, and without their kappa, which is in R_i
already. So weight and slope both fade to 0 where a record ends, and no line shows there. The term in h takes
the place of the test of Ward, Rubinstein & Clear 1988 whether a record lies in front of x, which is all or nothing: a
record is left out as it leaves the tangent plane to either side. On a sphere h is 0 however far the record, so curved
surfaces lose nothing; and W is that of gathers (constants.FLATTENING).

With the derivatives of records.py, D_i = (rotation_i, translation_i) by y = (n, x), and with means <.> by the weights,

    E(y) = 1/2 <max(0, E_i + D_i (y - y_i))> + 1/2 max(0, <E_i> + <D_i> (y - <y_i>)).

The first half, Ward & Heckbert's, is the mean of the records' tangents: where light bends, as it does towards a corner,
they lie on one side of it, and it is off by -1/2 f'' <(y - y_i)²>. The second is the plane of mean slope through the
records' mean, which is off by as much to the other side where records lie all around. What the two leave is
-1/2 f'' (y - <y_i>)², of third order there; from one record alone both are the same.

What is returned is a function of the set of records that reach (x, n), bit for bit: t_i is computed by one function,
boxes are never smaller than what t_i > 0 reaches, and the records found are summed in the order of their numbers. Of
more than CAPACITY of them, as where records are so noisy that they seem to disagree and ever more are made between
them, it is the heaviest CAPACITY; of equals, the first.
"""

from __future__ import annotations

import math

import warp as wp

from wdpm.kernels.constants import FLATTENING
from wdpm.kernels.irradiance.record_tree import LEAF_ROWS, IrradianceCache
from wdpm.kernels.photons.photon_map import vec8
from wdpm.kernels.rays.lanes import children_distance2, lanes_not_above, lowest_bit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

CAPACITY = wp.constant(64)
"""Records that count at a point, at most."""

STACK_CAPACITY = wp.constant(64)  # 7 siblings a level and 8 children, 7 levels of inner nodes
_MASK = wp.constant(63)  # tells the compiler that an index is not negative, as in gather.py

TURN = wp.constant(wp.float32(0.5 / (1.0 - math.cos(math.radians(10.0)))))
_FLATTENING = wp.constant(wp.float32(FLATTENING * FLATTENING - 1.0))
_ZERO8 = wp.constant(vec8(0.0))


@wp.func
def _reach(leaves: wp.array[vec8], row: wp.int32, x: wp.vec3, n: wp.vec3) -> vec8:
    """t of the eight records of a leaf: the one place where it is computed."""
    dx = vec8(x[0]) - leaves[row + 0]
    dy = vec8(x[1]) - leaves[row + 1]
    dz = vec8(x[2]) - leaves[row + 2]
    nx = leaves[row + 3]
    ny = leaves[row + 4]
    nz = leaves[row + 5]
    sx = vec8(n[0]) + nx
    sy = vec8(n[1]) + ny
    sz = vec8(n[2]) + nz
    tx = vec8(n[0]) - nx
    ty = vec8(n[1]) - ny
    tz = vec8(n[2]) - nz
    distance2 = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)
    height2 = wp.cw_mul(dx, sx) + wp.cw_mul(dy, sy) + wp.cw_mul(dz, sz)
    height2 = wp.cw_mul(height2, height2)
    turn2 = wp.cw_mul(tx, tx) + wp.cw_mul(ty, ty) + wp.cw_mul(tz, tz)
    share = wp.cw_mul(distance2 + (0.25 * _FLATTENING) * height2, leaves[row + 6])
    return vec8(1.0) - share - TURN * turn2


@wp.func
def _key(rank: wp.int32, t: wp.float32) -> wp.uint64:
    """Sorts by rank."""
    return (wp.uint64(rank) << wp.uint64(32)) | wp.uint64(wp.cast(t, wp.uint32))


@wp.func
def key_rank(key: wp.uint64) -> wp.int32:
    return wp.int32(key >> wp.uint64(32))


@wp.func
def _key_t(key: wp.uint64) -> wp.float32:
    return wp.cast(wp.uint32(key & wp.uint64(0xFFFFFFFF)), wp.float32)


@wp.func
def _lighter(a: wp.uint64, b: wp.uint64) -> wp.bool:
    """Whether record a gives way to record b where there is no room for both."""
    return _key_t(a) < _key_t(b) or (_key_t(a) == _key_t(b) and a > b)


@wp.func
def _sift_down(start: wp.int32, found: wp.array[wp.uint64]) -> None:
    """Put the record at a place of a heap of CAPACITY below those that are lighter."""
    key = found[start & _MASK]
    hole = wp.int32(start)
    child = 2 * hole + 1
    while child < CAPACITY:
        if child + 1 < CAPACITY and _lighter(found[(child + 1) & _MASK], found[child & _MASK]):
            child += 1
        if _lighter(found[child & _MASK], key):
            found[hole & _MASK] = found[child & _MASK]
            hole = child
            child = 2 * hole + 1
        else:
            child = CAPACITY
    found[hole & _MASK] = key


@wp.func
def _keep(key: wp.uint64, count: wp.int32, found: wp.array[wp.uint64]) -> wp.int32:
    """Put a record among the `count` found, in no order; the new count.

    Once there are CAPACITY they are a heap, the lightest first: those that have to give way are found at once.
    """
    if count < CAPACITY:
        found[count & _MASK] = key
        if count + 1 == CAPACITY:
            for k in range(CAPACITY // 2):
                _sift_down(CAPACITY // 2 - 1 - k, found)
        return count + 1
    if _lighter(found[0], key):
        found[0] = key
        _sift_down(wp.int32(0), found)
    return count


@wp.func
def _sort_by_rank(count: wp.int32, found: wp.array[wp.uint64]) -> None:
    for k in range(1, count):
        key = found[k & _MASK]
        place = wp.int32(k)
        while place > 0 and found[(place - 1) & _MASK] > key:
            found[place & _MASK] = found[(place - 1) & _MASK]
            place -= 1
        found[place & _MASK] = key


@wp.func
def find(
    cache: wp.ref[IrradianceCache], x: wp.vec3, n: wp.vec3, stack: wp.array[wp.int32], found: wp.array[wp.uint64]
) -> wp.int32:
    """Keys of the records that reach a point, in the order of ranks; how many."""
    count = wp.int32(0)
    stacked = wp.int32(1)
    stack[0] = wp.int32(0)
    while stacked > 0:
        stacked -= 1
        node = stack[stacked & _MASK]
        if node < cache.inner_count:
            mask = lanes_not_above(children_distance2(cache.nodes, node, x), _ZERO8)
            while mask != 0:
                stack[stacked & _MASK] = 8 * node + 1 + lowest_bit(mask)
                mask = mask & (mask - 1)
                stacked += 1
        else:
            leaf = node - cache.inner_count
            t = _reach(cache.leaves, LEAF_ROWS * leaf, x, n)
            mask = (lanes_not_above(t, _ZERO8) & 255) ^ 255
            while mask != 0:
                lane = lowest_bit(mask)
                mask = mask & (mask - 1)
                count = _keep(_key(cache.rank[8 * leaf + lane], t[lane]), count, found)
    _sort_by_rank(count, found)
    return count


@wp.func
def extrapolated(cache: wp.ref[IrradianceCache], rank: wp.int32, x: wp.vec3, n: wp.vec3) -> wp.vec3:
    """What one record, by its rank, says of a point."""
    turned = cache.rotation[rank] * (n - cache.normal[rank])
    moved = cache.translation[rank] * (x - cache.position[rank])
    return wp.max(cache.irradiance[rank] + turned + moved, wp.vec3(0.0))


@wp.struct
class Interpolated:
    """What the records that reach a point tell of it.

    Attributes:
        irradiance: >= 0; 0 where none reaches.
        grazing: how much that light grazes the surface (kernels.maths.schlick): their mean.
        weight: sum of their weights: 1 for each record right here, 0 where none reaches.
        count: of them, at most CAPACITY.
    """

    irradiance: wp.vec3
    grazing: wp.float32
    weight: wp.float32
    count: wp.int32


@wp.func
def interpolated(
    cache: wp.ref[IrradianceCache], x: wp.vec3, n: wp.vec3, stack: wp.array[wp.int32], found: wp.array[wp.uint64]
) -> Interpolated:
    """Irradiance at a point between records.

    Args:
        x: the point [scene units].
        n: unit shading normal, on the seen side.
        stack, found: scratch, at least STACK_CAPACITY and CAPACITY.
    """
    count = find(cache, x, n, stack, found)
    tangents = wp.vec3(0.0)
    values = wp.vec3(0.0)
    moved = wp.vec3(0.0)
    turned = wp.vec3(0.0)
    translation = wp.mat33(0.0)
    rotation = wp.mat33(0.0)
    grazing = wp.float32(0.0)
    weight = wp.float32(0.0)
    for k in range(count):
        key = found[k & _MASK]
        rank = key_rank(key)
        w = _key_t(key) * _key_t(key)
        tangents += w * extrapolated(cache, rank, x, n)
        values += w * cache.irradiance[rank]
        moved += w * (x - cache.position[rank])
        turned += w * (n - cache.normal[rank])
        translation += w * cache.translation[rank]
        rotation += w * cache.rotation[rank]
        grazing += w * cache.grazing[rank]
        weight += w
    result = Interpolated()
    result.weight = weight
    result.count = count
    if weight > 0.0:
        plane = values + (translation * moved + rotation * turned) / weight
        result.grazing = grazing / weight
        result.irradiance = 0.5 * (tangents + wp.max(plane, wp.vec3(0.0))) / weight
    return result


@wp.kernel
def interpolate(
    cache: IrradianceCache,
    position: wp.array[wp.vec3],
    shading_normal: wp.array[wp.vec3],
    offset: wp.int32,
    irradiance_out: wp.array[wp.vec3],
    grazing_out: wp.array[wp.float32],
    weight_out: wp.array[wp.float32],
    count_out: wp.array[wp.int32],
) -> None:
    """Irradiance at points between records, one thread a point.

    Args:
        position: [scene units] [N].
        shading_normal: unit, on the seen side [N].
        irradiance_out: >= 0; 0 where no record reaches [N].
        grazing_out: how much it grazes the surface [N].
        weight_out: sum of the weights: 1 for each record right here, 0 where none reaches [N].
        count_out: records that reach, at most CAPACITY [N].
    """
    i = offset + wp.tid()
    stack = wp.zeros(shape=(STACK_CAPACITY,), dtype=wp.int32)
    found = wp.zeros(shape=(CAPACITY,), dtype=wp.uint64)
    told = interpolated(cache, position[i], shading_normal[i], stack, found)
    irradiance_out[i] = told.irradiance
    grazing_out[i] = told.grazing
    weight_out[i] = told.weight
    count_out[i] = told.count
