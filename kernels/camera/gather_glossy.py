"""Gathers at surfaces that do not reflect photons like a Lambertian one, or that long camera paths see.

The photons that count, and the radius, are those of `gather`; only what each contributes differs. A Lambertian surface
at the end of any path gets the very bits that `gather` gives.
"""

from __future__ import annotations

import functools
import math

import warp as wp

from wdpm.kernels.camera.vertices import Coats, Queries
from wdpm.kernels.features import Features
from wdpm.kernels.made_for import made_for
from wdpm.kernels.materials.bsdf import make_bsdf
from wdpm.kernels.materials.frames import bump_shadowing
from wdpm.kernels.materials.types import DIFFUSE
from wdpm.kernels.maths.exact_sum import dequantise, exponent, magnitude_bits, quantise
from wdpm.kernels.photons.gather import (
    INT_SCRATCH,
    KEY_SCRATCH,
    Gathered,
    contribution,
    key_place,
    nearest_or_within,
)
from wdpm.kernels.photons.gather_guess import follow
from wdpm.kernels.photons.photon_map import LEAF_ROWS, PhotonMap

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_PI = wp.constant(wp.float64(math.pi))
_PI_SINGLE = wp.constant(wp.float32(math.pi))


@functools.cache
def make_gather_at(features: Features) -> wp.Function:
    """The function `gather_at` for surfaces with the given features: (photons, photon_edges, ...) -> Gathered."""
    eval_diffuse = make_bsdf(features).eval_diffuse

    @wp.func
    def arrival(photons: wp.ref[PhotonMap], place: wp.int32) -> wp.vec3:
        """Where a photon came from."""
        row = LEAF_ROWS * (place >> 3)
        c = place & 7
        return wp.vec3(photons.leaves[row + 6][c], photons.leaves[row + 7][c], photons.leaves[row + 8][c])

    @wp.func
    def term(
        photons: wp.ref[PhotonMap],
        photon_edges: wp.array[wp.int32],
        queries: wp.ref[Queries],
        coats: wp.ref[Coats],
        q: wp.int32,
        place: wp.int32,
        max_depth: wp.int32,
    ) -> wp.vec3:
        """What a photon contributes: flux, times pi and the scattering function where that is not constant."""
        n = queries.normal[q]
        s = queries.shading_normal[q]
        flux = contribution(photons, place, n, s, s[0] != n[0] or s[1] != n[1] or s[2] != n[2])
        if wp.static(features.bent):
            if coats.bumps2[q] > 0.0:
                flux = flux * bump_shadowing(coats.bumps2[q], wp.dot(coats.unbent[q], arrival(photons, place)))
        if wp.static(features.coated):
            if coats.bsdf[q].kind != DIFFUSE:
                d = arrival(photons, place)
                local = wp.vec3(wp.dot(d, coats.s[q]), wp.dot(d, coats.t[q]), wp.dot(d, coats.n[q]))
                flux = wp.cw_mul(flux, eval_diffuse(coats.bsdf[q], coats.w_from[q], local) * _PI_SINGLE)
        if max_depth > 0:
            if photon_edges[photons.rank[place]] + queries.edges[q] > max_depth:
                flux = wp.vec3(0.0)
        return flux

    @wp.func
    def gather_at(
        photons: wp.ref[PhotonMap],
        photon_edges: wp.array[wp.int32],
        queries: wp.ref[Queries],
        coats: wp.ref[Coats],
        q: wp.int32,
        k: wp.int32,
        r_max: wp.float32,
        r_least: wp.float32,
        max_depth: wp.int32,
        guess: wp.float32,
        candidates: wp.array[wp.uint64],
        ints: wp.array[wp.int32],
    ) -> Gathered:
        """As `gather`, for query q; the irradiance is pi times the scattered radiance where that is not Lambertian.

        Args:
            photon_edges: edges of each photon's path from its light, in the order of the photons' numbers.
            max_depth: longest path in edges; 0 for no limit.
        """
        found = nearest_or_within(
            photons, queries.position[q], queries.normal[q], k, r_max, r_least, guess, candidates, ints
        )
        largest = wp.int32(0)
        for i in range(found.count):
            flux = term(photons, photon_edges, queries, coats, q, key_place(candidates[i]), max_depth)
            largest = wp.max(largest, wp.max(magnitude_bits(flux[0]), magnitude_bits(flux[1])))
            largest = wp.max(largest, magnitude_bits(flux[2]))
        e = exponent(largest)
        red = wp.int64(0)
        green = wp.int64(0)
        blue = wp.int64(0)
        for i in range(found.count):
            flux = term(photons, photon_edges, queries, coats, q, key_place(candidates[i]), max_depth)
            red += quantise(flux[0], e)
            green += quantise(flux[1], e)
            blue += quantise(flux[2], e)
        area = _PI * wp.float64(found.area_radius2)
        result = Gathered()
        result.truncated = found.truncated
        result.count = found.count
        result.radius = found.radius
        result.irradiance = wp.vec3(
            wp.float32(dequantise(red, e) / area),
            wp.float32(dequantise(green, e) / area),
            wp.float32(dequantise(blue, e) / area),
        )
        return result

    return gather_at


@functools.cache
def make_gather(features: Features) -> wp.Kernel:
    """The kernel, for surfaces with the given features."""
    gather_at = make_gather_at(features)

    @made_for(features)
    def gather_glossy(
        photons: PhotonMap,
        photon_edges: wp.array[wp.int32],
        queries: Queries,
        coats: Coats,
        k: wp.int32,
        r_max: wp.float32,
        r_least: wp.float32,
        max_depth: wp.int32,
        offset: wp.int32,
        run: wp.int32,
        irradiance_out: wp.array[wp.vec3],
        count_out: wp.array[wp.int32],
        radius_out: wp.array[wp.float32],
        truncated_out: wp.array[wp.bool],
    ) -> None:
        """As gather_kernel. Arguments as for `gather_at`."""
        candidates = wp.zeros(shape=(KEY_SCRATCH,), dtype=wp.uint64)
        ints = wp.zeros(shape=(INT_SCRATCH,), dtype=wp.int32)
        begin = (offset + wp.tid()) * run
        end = wp.min(begin + run, queries.position.shape[0])
        guess = wp.float32(0.0)
        before = wp.vec3(0.0)
        for q in range(begin, end):
            x = queries.position[q]
            if q > begin:
                guess = follow(guess, wp.length(x - before))
            found = gather_at(
                photons, photon_edges, queries, coats, q, k, r_max, r_least, max_depth, guess, candidates, ints
            )
            irradiance_out[q] = found.irradiance
            count_out[q] = found.count
            radius_out[q] = found.radius
            truncated_out[q] = found.truncated
            guess = found.radius
            before = x

    return gather_glossy
