"""Gathers: the k nearest photons of a point, and the irradiance they tell.

What is returned is a function of the set of photons within reach, bit for bit: neither the tree's shape nor the order
of the photons nor the guess of the radius nor what lies further away has a say. This is so because

* a photon passes the filters, or does not, by itself, before it counts towards k;
* photons are ordered by (distance², id), which has no ties, and the distance is computed by one function;
* boxes prune by the same float operations in the same order, which are monotonic, so that the rounded distance of a box
  is never above that of a photon in it: no tolerance is needed;
* contributions are added exactly (exact_sum.py).

The estimate. With k + 1 photons or more within r_max, r is the distance of the (k + 1)-th and the k nearer ones are
summed over pi r². For a Poisson process of density D, the area to the (k + 1)-th point has a gamma distribution of
shape k + 1, so E[k / area] = D: unbiased. With k photons or fewer the estimate is that of a fixed radius, r_max, and
the gather is called truncated. Where k + 1 photons lie within a least radius, r_least, it is that of this radius: of
smaller discs it cannot be told how much is surface (surface_points.py).

Photons that came from below the query's plane count, if they landed on the same side where the surface bends away: left
out, even light would be too dark on curved surfaces, by (1 - cos) / 2 of the angle by which normals turn in the disc.

Coincident photons. With the (k + 1)-th nearer than 2^-40 r_max (constants.py), the k nearest are summed over all of it.

The search. Consecutive queries of a run lie close together, so the radius of one is a good guess for the next: visit,
in any order, what its ball touches, append what is in it, and select at the end. Too small a guess is grown.
"""

from __future__ import annotations

import math

import warp as wp

from wdpm.kernels.constants import (
    ADJOINT_BOUND,
    COINCIDENT_SHARE2,
    FLATTENING,
    LEAST_SQUARE,
    MIN_ARRIVAL_COS,
    NORMAL_COS,
)
from wdpm.kernels.limits import MAX_K
from wdpm.kernels.maths.exact_sum import dequantise, exponent, magnitude_bits, quantise
from wdpm.kernels.photons.gather_guess import follow
from wdpm.kernels.photons.photon_map import LEAF_ROWS, NODE_ROWS, PhotonMap, first_child, vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

CANDIDATE_CAPACITY = wp.constant(1024)  # at least 2 * (MAX_K + 1) + 8, so that a full buffer halves at least
STACK_CAPACITY = wp.constant(128)  # 7 siblings a level and 8 children; levels <= 10 for 2^31 photons
LEAF_CAPACITY = wp.constant(128)  # leaves found and not searched yet
BIN_COUNT = wp.constant(64)  # of the histogram of the selection
KEY_SCRATCH = wp.constant(2048)  # candidates, and as much again for the selection
INT_SCRATCH = wp.constant(512)  # stack, leaves, histogram

# Tell the compiler that an index is not negative: Warp counts those from the end, which costs two instructions.
_KEY_MASK = wp.constant(2047)
_INT_MASK = wp.constant(511)

_NORMAL_COS = wp.constant(wp.float32(NORMAL_COS))
_FLATTENING = wp.constant(wp.float32(FLATTENING * FLATTENING - 1.0))
_COINCIDENT_SHARE2 = wp.constant(wp.float32(COINCIDENT_SHARE2))
_LEAST_SQUARE = wp.constant(wp.float32(LEAST_SQUARE))
_MIN_ARRIVAL_COS = wp.constant(wp.float32(MIN_ARRIVAL_COS))
_PI = wp.constant(wp.float64(math.pi))

# How tight the first radius of a search is; has a say in time only.
_SPREAD = wp.constant(2.0)  # standard deviations of a Poisson count, on top of the density's k + 1


@wp.struct
class Gathered:
    """What a gather found."""

    irradiance: wp.vec3  # sum of flux * weight / (pi r²): not divided by the number of paths
    count: wp.int32  # photons in the sum
    radius: wp.float32  # r [scene units]
    truncated: wp.bool  # fewer than k + 1 photons within r_max


@wp.struct
class Nearest:
    """The photons that a gather uses: the first `count` candidates."""

    count: wp.int32
    radius: wp.float32  # r [scene units]
    area_radius2: wp.float32  # square of the radius of the disc that they stand for
    truncated: wp.bool  # fewer than k + 1 photons within r_max


@wp.func
def dot8(ax: vec8, ay: vec8, az: vec8, b: wp.vec3) -> vec8:
    return ax * b[0] + ay * b[1] + az * b[2]


@wp.func
def distance2_to(px: vec8, py: vec8, pz: vec8, x: wp.vec3, n: wp.vec3) -> vec8:
    """Squared distances of eight photons, flattened along the normal: the one place where they are computed."""
    dx = px - vec8(x[0])
    dy = py - vec8(x[1])
    dz = pz - vec8(x[2])
    height = dot8(dx, dy, dz, n)
    euclid2 = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)
    return euclid2 + _FLATTENING * wp.cw_mul(height, height)


@wp.func
def box_distance2(nodes: wp.array[vec8], row: wp.int32, x: wp.vec3) -> vec8:
    """Squared Euclidean distances of a node's children, inf for empty ones: never above `_distance2` of a photon."""
    zero = vec8(0.0)
    x8 = vec8(x[0])
    y8 = vec8(x[1])
    z8 = vec8(x[2])
    dx = wp.max(wp.max(nodes[row + 0] - x8, x8 - nodes[row + 3]), zero)
    dy = wp.max(wp.max(nodes[row + 1] - y8, y8 - nodes[row + 4]), zero)
    dz = wp.max(wp.max(nodes[row + 2] - z8, z8 - nodes[row + 5]), zero)
    return wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)


@wp.func
def _key(distance2: wp.float32, place: wp.int32) -> wp.uint64:
    """Sorts like the distance: bits of floats >= 0 sort like integers."""
    return (wp.uint64(wp.cast(distance2, wp.uint32)) << wp.uint64(32)) | wp.uint64(place)


@wp.func
def key_distance2(key: wp.uint64) -> wp.float32:
    return wp.cast(wp.uint32(key >> wp.uint64(32)), wp.float32)


@wp.func
def key_place(key: wp.uint64) -> wp.int32:
    return wp.int32(key & wp.uint64(0x7FFFFFFF))


@wp.func
def _key_before(a: wp.uint64, b: wp.uint64, rank: wp.array[wp.int32]) -> wp.bool:
    """Order by (distance², id)."""
    before = a < b
    if (a >> wp.uint64(32)) == (b >> wp.uint64(32)):
        before = rank[key_place(a)] < rank[key_place(b)]
    return before


@wp.func
def _quickselect(
    keys: wp.array[wp.uint64], begin: wp.int32, end: wp.int32, nth: wp.int32, rank: wp.array[wp.int32]
) -> None:
    """Moves the keys so that keys[nth] is in its sorted place, with smaller ones before and larger ones behind it."""
    low = int(begin)
    high = int(end)
    while high - low > 1:
        pivot = keys[(low + high) >> 1]
        keys[(low + high) >> 1] = keys[high - 1]
        keys[high - 1] = pivot
        split = int(low)
        for i in range(low, high - 1):
            key = keys[i]
            keys[i] = keys[split]
            keys[split] = key
            split += wp.int32(_key_before(key, pivot, rank))
        keys[high - 1] = keys[split]
        keys[split] = pivot
        if nth <= split:
            high = split
        if nth > split:
            low = split + 1
        if nth == split:
            low = high


@wp.func
def select(
    candidates: wp.array[wp.uint64],
    count: wp.int32,
    nth: wp.int32,
    radius2: wp.float32,
    rank: wp.array[wp.int32],
    ints: wp.array[wp.int32],
) -> None:
    """Moves the nth + 1 nearest candidates, 0 <= nth < count, to the front, the farthest of them to candidates[nth].

    A histogram of distance² finds the bin that holds the nth; on a surface its bins fill evenly, so that hardly more
    than one candidate is left to be selected by comparisons. The bin is monotonic in the distance, rounding or not.

    Args:
        candidates: keys; the second half of the array is scratch.
        radius2: no candidate's distance² is above it.
    """
    bins = STACK_CAPACITY + LEAF_CAPACITY
    scale = (wp.float32(BIN_COUNT) - 0.5) / wp.max(radius2, _LEAST_SQUARE)
    for b in range(64):
        ints[bins + b] = 0
    for i in range(count):
        b = (bins + wp.min(wp.int32(key_distance2(candidates[i]) * scale), BIN_COUNT - 1)) & _INT_MASK
        ints[b] = ints[b] + 1
    bin = wp.int32(0)
    below = wp.int32(0)
    while below + ints[bins + bin] <= nth:
        below += ints[bins + bin]
        bin += 1
    kept = wp.int32(0)
    within = int(CANDIDATE_CAPACITY)
    for i in range(count):
        key = candidates[i]
        b = wp.min(wp.int32(key_distance2(key) * scale), BIN_COUNT - 1)
        candidates[kept & _KEY_MASK] = key
        candidates[within & _KEY_MASK] = key
        kept += wp.int32(b < bin)
        within += wp.int32(b == bin)
    _quickselect(candidates, CANDIDATE_CAPACITY, within, CANDIDATE_CAPACITY + nth - below, rank)
    for i in range(below, nth + 1):
        candidates[i] = candidates[CANDIDATE_CAPACITY + i - below]


@wp.func
def next_above(value: wp.float32) -> wp.float32:
    """Least float above a positive one: a <= b is a < next_above(b)."""
    return wp.cast(wp.cast(value, wp.uint32) + wp.uint32(1), wp.float32)


@wp.func
def _search_leaf(
    photons: wp.ref[PhotonMap],
    leaf: wp.int32,
    x: wp.vec3,
    n: wp.vec3,
    radius2_above: wp.float32,
    count: wp.int32,
    candidates: wp.array[wp.uint64],
) -> wp.int32:
    """Appends the leaf's photons that pass the filters and lie below the radius²; returns the new count."""
    row = LEAF_ROWS * leaf
    distance2 = distance2_to(photons.leaves[row + 0], photons.leaves[row + 1], photons.leaves[row + 2], x, n)
    facing = dot8(photons.leaves[row + 3], photons.leaves[row + 4], photons.leaves[row + 5], n)
    # Both strict, so that one comparison of eight values tells who passes; the sign of a difference is exact.
    passes = wp.min(vec8(radius2_above) - distance2, facing - vec8(_NORMAL_COS))
    found = int(count)
    for c in range(8):
        # Stored always, kept if counted: a branch would be mispredicted too often.
        candidates[found & _KEY_MASK] = _key(distance2[c], 8 * leaf + c)
        found += wp.int32(passes[c] > wp.float32(0.0))
    return found


@wp.func
def _search(
    photons: wp.ref[PhotonMap],
    x: wp.vec3,
    n: wp.vec3,
    k: wp.int32,
    radius: wp.float32,
    candidates: wp.array[wp.uint64],
    ints: wp.array[wp.int32],
) -> tuple[wp.int32, wp.float32]:
    """All photons that pass the filters within the radius, or at least the k + 1 nearest of them if they are many.

    Returns:
        count of candidates, and the square of the radius that holds them all.
    """
    radius2 = float(radius * radius)
    count = wp.int32(0)
    stacked = wp.int32(1)
    ints[0] = 0
    while stacked > 0:
        leaf_count = wp.int32(0)
        while stacked > 0 and leaf_count <= LEAF_CAPACITY - 8:
            stacked -= 1
            node = ints[stacked]
            child = first_child(node, photons.fan_out)
            distance2 = box_distance2(photons.nodes, NODE_ROWS * node, x)
            if child < photons.inner_count:
                for c in range(8):
                    ints[stacked & _INT_MASK] = child + c
                    stacked += wp.int32(distance2[c] <= radius2)
            else:
                for c in range(8):
                    ints[(STACK_CAPACITY + leaf_count) & _INT_MASK] = child + c - photons.inner_count
                    leaf_count += wp.int32(distance2[c] <= radius2)
        for i in range(leaf_count):
            count = _search_leaf(photons, ints[STACK_CAPACITY + i], x, n, next_above(radius2), count, candidates)
            if count > CANDIDATE_CAPACITY - 8:
                select(candidates, count, k, radius2, photons.rank, ints)
                count = k + 1
                radius2 = key_distance2(candidates[k])
    return count, radius2


@wp.func
def _guess_from_density(photons: wp.ref[PhotonMap], x: wp.vec3, k: wp.int32) -> wp.float32:
    """Radius of a disc for k + 1 photons, if those of a node near x, 2 k or more, are even on its largest face."""
    node = wp.int32(0)
    share = wp.float32(photons.count)
    area = wp.float32(0.0)
    enough = 2.0 * wp.float32(k) + 2.0
    descend = wp.bool(True)
    while descend:
        row = NODE_ROWS * node
        distance2 = box_distance2(photons.nodes, row, x)
        nearest = wp.int32(wp.argmin(distance2))
        ex = photons.nodes[row + 3][nearest] - photons.nodes[row + 0][nearest]
        ey = photons.nodes[row + 4][nearest] - photons.nodes[row + 1][nearest]
        ez = photons.nodes[row + 5][nearest] - photons.nodes[row + 2][nearest]
        area = wp.max(ex * ey, wp.max(ey * ez, ez * ex))
        if node == 0:
            share = share / wp.float32(photons.fan_out)
        else:
            share = share / 8.0
        node = first_child(node, photons.fan_out) + nearest
        descend = share > enough and node < photons.inner_count
    wanted = wp.float32(k) + 1.0
    return wp.sqrt((wanted + _SPREAD * wp.sqrt(wanted)) * area / (share * wp.float32(_PI)))


@wp.func
def _weight(lean: wp.vec3, m: wp.vec3, d: wp.vec3) -> wp.float32:
    """Turns flux about a photon's normal m into irradiance about m + lean (Veach 1997, section 5.3), bounded."""
    arriving = wp.dot(m, d)
    return wp.min(wp.max(arriving + wp.dot(lean, d), 0.0) / wp.max(arriving, _MIN_ARRIVAL_COS), ADJOINT_BOUND)


@wp.func
def contribution(photons: wp.ref[PhotonMap], place: wp.int32, n: wp.vec3, s: wp.vec3, smooth: wp.bool) -> wp.vec3:
    flux = photons.flux[place]
    if smooth:
        row = LEAF_ROWS * (place >> 3)
        c = place & 7
        m = wp.vec3(photons.leaves[row + 3][c], photons.leaves[row + 4][c], photons.leaves[row + 5][c])
        d = wp.vec3(photons.leaves[row + 6][c], photons.leaves[row + 7][c], photons.leaves[row + 8][c])
        flux = flux * _weight(s - n, m, d)
    return flux


@wp.func
def estimate(
    photons: wp.ref[PhotonMap],
    candidates: wp.array[wp.uint64],
    count: wp.int32,
    n: wp.vec3,
    s: wp.vec3,
    radius2: wp.float32,
) -> wp.vec3:
    """Sum of the contributions of the first `count` candidates over the area of the disc."""
    smooth = s[0] != n[0] or s[1] != n[1] or s[2] != n[2]
    largest = wp.int32(0)
    for i in range(count):
        term = contribution(photons, key_place(candidates[i]), n, s, smooth)
        largest = wp.max(largest, wp.max(magnitude_bits(term[0]), magnitude_bits(term[1])))
        largest = wp.max(largest, magnitude_bits(term[2]))
    e = exponent(largest)
    red = wp.int64(0)
    green = wp.int64(0)
    blue = wp.int64(0)
    for i in range(count):
        term = contribution(photons, key_place(candidates[i]), n, s, smooth)
        red += quantise(term[0], e)
        green += quantise(term[1], e)
        blue += quantise(term[2], e)
    area = _PI * wp.float64(radius2)
    return wp.vec3(
        wp.float32(dequantise(red, e) / area),
        wp.float32(dequantise(green, e) / area),
        wp.float32(dequantise(blue, e) / area),
    )


@wp.func
def nearest(
    photons: wp.ref[PhotonMap],
    x: wp.vec3,
    n: wp.vec3,
    k: wp.int32,
    r_max: wp.float32,
    guess: wp.float32,
    candidates: wp.array[wp.uint64],
    ints: wp.array[wp.int32],
) -> Nearest:
    """Moves the k nearest photons within r_max to the front of the candidates. Arguments as for `gather`."""
    radius = float(guess)
    if not radius > 0.0:
        radius = _guess_from_density(photons, x, k)
    if not radius > 0.0:
        radius = r_max
    least2 = wp.max(r_max * r_max * _COINCIDENT_SHARE2, _LEAST_SQUARE)
    radius = wp.clamp(radius, wp.sqrt(least2), r_max)
    count = wp.int32(0)
    radius2 = wp.float32(0.0)
    searching = wp.bool(True)
    while searching:
        count, radius2 = _search(photons, x, n, k, radius, candidates, ints)
        searching = count <= k and radius < r_max
        if searching:
            short = wp.sqrt((wp.float32(k) + 1.0) / wp.max(wp.float32(count), 1.0))
            radius = wp.min(radius * wp.clamp(1.1 * short, 1.2, 2.0), r_max)

    result = Nearest()
    result.truncated = count <= k
    result.count = wp.min(count, k)
    result.radius = r_max
    result.area_radius2 = r_max * r_max
    if count > k:
        select(candidates, count, k, radius2, photons.rank, ints)
        nearest2 = key_distance2(candidates[k])
        if nearest2 >= least2:
            result.area_radius2 = nearest2
            result.radius = wp.sqrt(nearest2)
    return result


@wp.func
def nearest_or_within(
    photons: wp.ref[PhotonMap],
    x: wp.vec3,
    n: wp.vec3,
    k: wp.int32,
    r_max: wp.float32,
    r_least: wp.float32,
    guess: wp.float32,
    candidates: wp.array[wp.uint64],
    ints: wp.array[wp.int32],
) -> Nearest:
    """As `nearest`; but where the (k + 1)-th lies within r_least, all photons there, or MAX_K. See `gather`."""
    found = nearest(photons, x, n, k, r_max, guess, candidates, ints)
    if found.radius < r_least:
        found = nearest(photons, x, n, MAX_K, r_least, r_least, candidates, ints)
        found.truncated = False
    return found


@wp.func
def gather(
    photons: wp.ref[PhotonMap],
    x: wp.vec3,
    n: wp.vec3,
    s: wp.vec3,
    k: wp.int32,
    r_max: wp.float32,
    r_least: wp.float32,
    guess: wp.float32,
    candidates: wp.array[wp.uint64],
    ints: wp.array[wp.int32],
) -> Gathered:
    """Irradiance at x from the k nearest photons within r_max.

    Args:
        photons: the map.
        x: position of the query [scene units].
        n: unit geometric normal, on the viewer's side.
        s: unit shading normal; equal to n where the surface has none.
        k: most photons to use, 1 .. MAX_K (`check_settings`).
        r_max: most distant photon to use [scene units] (`check_settings`).
        r_least: where k + 1 photons lie nearer, all within it are used, or the nearest MAX_K [scene units].
        guess: radius that holds slightly more than k photons, or 0; has no effect on the result.
        candidates: scratch, wp.zeros(shape=(KEY_SCRATCH,), dtype=wp.uint64) of the kernel.
        ints: scratch, wp.zeros(shape=(INT_SCRATCH,), dtype=wp.int32) of the kernel.
    """
    found = nearest_or_within(photons, x, n, k, r_max, r_least, guess, candidates, ints)
    result = Gathered()
    result.truncated = found.truncated
    result.count = found.count
    result.radius = found.radius
    result.irradiance = estimate(photons, candidates, found.count, n, s, found.area_radius2)
    return result


@wp.kernel
def gather_kernel(
    photons: PhotonMap,
    position: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    shading_normal: wp.array[wp.vec3],
    k: wp.int32,
    r_max: wp.float32,
    r_least: wp.float32,
    offset: wp.int32,
    run: wp.int32,
    irradiance_out: wp.array[wp.vec3],
    count_out: wp.array[wp.int32],
    radius_out: wp.array[wp.float32],
    truncated_out: wp.array[wp.bool],
) -> None:
    """Thread t gathers at queries (offset + t) * run .. + run - 1, one after another, as far as there are any."""
    candidates = wp.zeros(shape=(KEY_SCRATCH,), dtype=wp.uint64)
    ints = wp.zeros(shape=(INT_SCRATCH,), dtype=wp.int32)
    begin = (offset + wp.tid()) * run
    end = wp.min(begin + run, position.shape[0])
    guess = wp.float32(0.0)
    before = wp.vec3(0.0)
    for q in range(begin, end):
        x = position[q]
        if q > begin:
            guess = follow(guess, wp.length(x - before))
        found = gather(photons, x, normal[q], shading_normal[q], k, r_max, r_least, guess, candidates, ints)
        irradiance_out[q] = found.irradiance
        count_out[q] = found.count
        radius_out[q] = found.radius
        truncated_out[q] = found.truncated
        guess = found.radius
        before = x
