"""Which photons gathers ask: for each place, the k nearest of a map, by their rank."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.photons.gather import INT_SCRATCH, KEY_SCRATCH, key_place, nearest
from wdpm.kernels.photons.gather_guess import follow
from wdpm.kernels.photons.photon_map import PhotonMap

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def find_neighbours(
    photons: PhotonMap,
    position: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    k: wp.int32,
    r_max: wp.float32,
    offset: wp.int32,
    run: wp.int32,
    rank_out: wp.array2d[wp.int32],
) -> None:
    """Thread t looks about places (offset + t) * run .. + run - 1, one after another, as far as there are any.

    Args:
        rank_out: of the photons that a gather of k asks, in no order; -1 where there are fewer; shape [places, k].
    """
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
        found = nearest(photons, x, normal[q], k, r_max, guess, candidates, ints)
        for i in range(k):
            rank_out[q, i] = -1
            if i < found.count:
                rank_out[q, i] = photons.rank[key_place(candidates[i])]
        guess = found.radius
        before = x
