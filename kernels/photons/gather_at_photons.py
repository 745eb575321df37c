"""The irradiance at photons of a map, for places that read it at the nearest of some of them (at_photons.py).

At a place that is no photon, k photons nearer than the (k + 1)-th are k / area (gather.py). A photon finds itself as
well, whatever the density is. How much too bright that makes what a place reads depends on how the place came to it.

Let photons be a Poisson process, sites a share of them, a place read the nearest site within reach, and m sites lie
within reach of it on average. That the nearest is at a distance d tells that none is nearer. Of the sites that the disc
of d holds on average, v, the estimate at that site misses as many, and v is distributed as exp(-v), v < m. So of the
one photon that the site is, 1 - E[v] = m / (exp(m) - 1) are in excess: nothing where sites are dense, all of it where
hardly one is within reach. That part of the photon itself is left out of the sum.
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.constants import PI
from wdpm.kernels.maths.elementary import expm1_of
from wdpm.kernels.maths.exact_sum import exponent, magnitude_bits, quantise
from wdpm.kernels.maths.schlick import EVEN_SCHLICK, schlick_weight
from wdpm.kernels.photons.gather import (
    INT_SCRATCH,
    KEY_SCRATCH,
    contribution,
    estimate,
    key_place,
    nearest_or_within,
)
from wdpm.kernels.photons.gather_guess import follow
from wdpm.kernels.photons.photon_map import LEAF_ROWS, PhotonMap

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def excess_of_self(sites: wp.float32) -> wp.float32:
    """How much of the photon at a site is too much, in [0, 1], by the number of sites expected within reach."""
    if sites < 1.0e-6:
        return 1.0
    return sites / expm1_of(sites)


@wp.func
def self_last(photons: wp.ref[PhotonMap], rank: wp.int32, count: wp.int32, candidates: wp.array[wp.uint64]) -> wp.int32:
    """Moves the photon of a rank behind the other candidates; returns how many these are."""
    others = wp.int32(count)
    for i in range(count):
        key = candidates[i]
        if photons.rank[key_place(key)] == rank:
            candidates[i] = candidates[count - 1]
            candidates[count - 1] = key
            others = count - 1
    return others


@wp.func
def _mean_of_channels(flux: wp.vec3) -> wp.float32:
    return flux[0] / 3.0 + flux[1] / 3.0 + flux[2] / 3.0


@wp.func
def grazing(photons: wp.ref[PhotonMap], candidates: wp.array[wp.uint64], count: wp.int32, n: wp.vec3) -> wp.float32:
    """How much the light of the first `count` candidates grazes a surface: see schlick.py. 0 of no light.

    Args:
        n: unit normal of the surface, on the side that light arrives at.
    """
    largest = wp.int32(0)
    for i in range(count):
        largest = wp.max(largest, magnitude_bits(_mean_of_channels(photons.flux[key_place(candidates[i])])))
    e = exponent(largest)
    whole = wp.int64(0)
    weighed = wp.int64(0)
    for i in range(count):
        place = key_place(candidates[i])
        flux = _mean_of_channels(photons.flux[place])
        row = LEAF_ROWS * (place >> 3)
        c = place & 7
        d = wp.vec3(photons.leaves[row + 6][c], photons.leaves[row + 7][c], photons.leaves[row + 8][c])
        whole += quantise(flux, e)
        weighed += quantise(flux * schlick_weight(wp.dot(n, d)), e)
    result = wp.float32(0.0)
    if whole > wp.int64(0):
        result = wp.float32(wp.float64(weighed) / wp.float64(whole)) - EVEN_SCHLICK
    return result


@wp.kernel
def gather_at_photons(
    photons: PhotonMap,
    rank: wp.array[wp.int32],
    position: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    k: wp.int32,
    r_max: wp.float32,
    r_least: wp.float32,
    share: wp.float32,
    reach: wp.float32,
    offset: wp.int32,
    run: wp.int32,
    irradiance_out: wp.array[wp.vec3],
    radius_out: wp.array[wp.float32],
    grazing_out: wp.array[wp.float32],
) -> None:
    """Thread t gathers at photons (offset + t) * run .. + run - 1, one after another, as far as there are any.

    Args:
        rank: of each photon in the map; -1 where that does not hold it, and it is but a place.
        position, normal: its own.
        k: most photons to use, 1 .. MAX_K.
        r_max: most distant photon to use [scene units].
        r_least: where k + 1 photons lie nearer, all within it are used, or the nearest MAX_K [scene units].
        share: of the map's photons, that are sites.
        reach: how far from a place the site may lie that it reads [scene units].
        irradiance_out: on the plane of the normal, not divided by the number of paths.
        radius_out: how far the photons lie that were used, see gather.Gathered.
        grazing_out: how much their light grazes the surface (schlick.py); empty where nobody asks.
    """
    candidates = wp.zeros(shape=(KEY_SCRATCH,), dtype=wp.uint64)
    ints = wp.zeros(shape=(INT_SCRATCH,), dtype=wp.int32)
    begin = (offset + wp.tid()) * run
    end = wp.min(begin + run, position.shape[0])
    guess = wp.float32(0.0)
    before = wp.vec3(0.0)
    for q in range(begin, end):
        x = position[q]
        n = normal[q]
        if q > begin:
            guess = follow(guess, wp.length(x - before))
        found = nearest_or_within(photons, x, n, k, r_max, r_least, guess, candidates, ints)
        others = found.count
        if rank[q] >= 0:
            others = self_last(photons, rank[q], found.count, candidates)
        irradiance = estimate(photons, candidates, others, n, n, found.area_radius2)
        if others < found.count:
            sites = share * wp.float32(others) * (reach * reach / found.area_radius2)
            own = contribution(photons, key_place(candidates[others]), n, n, False)
            irradiance += own * ((1.0 - excess_of_self(sites)) / (PI * found.area_radius2))
        irradiance_out[q] = irradiance
        radius_out[q] = found.radius
        if q < grazing_out.shape[0]:
            grazing_out[q] = grazing(photons, candidates, found.count, n)
        guess = found.radius
        before = x
