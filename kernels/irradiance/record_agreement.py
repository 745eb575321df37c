"""Records of the irradiance cache reach no further than they agree with their neighbours.

A record knows the light where it lies and how it changes there, and its first derivatives do not foresee bends: the
edge of a penumbra, where the derivative ends at once, or the foot of a wall that a lamp is about to shine on. What
lies beyond is too dark or too bright by as much as the derivative is wrong, as wide as the record reaches. Another
record that lies there knows better. So wherever record i reaches record j, what i extrapolates to x_j is compared with
what j was measured to have, and where they differ by more than both may err, i's reach becomes shorter (Křivánek et al.
2006, "Making Radiance and Irradiance Caching Practical: Adaptive Caching and Neighbor Clamping", shorten it where the
step would be seen). What an expansion of first order leaves out grows as the square of the way, so a record whose
relative error is e after a way d errs by the tolerance t after d sqrt(t / e).

Rounds that follow find what is uncovered then, and have records made there.

The result is a function of the set of records, bit for bit: the least of some numbers knows no order, and which records
reach a place is told by the one function that interpolation uses.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.irradiance.cache import CAPACITY, STACK_CAPACITY, extrapolated, find, key_rank
from wdpm.kernels.irradiance.record_tree import Arrays, IrradianceCache, build
from wdpm.kernels.launch import ONE_THREAD, Launcher

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

GRAIN = 256
"""Records that are worth a chunk of a launch of their own: a microsecond each."""

LEAST_SHARE = wp.constant(wp.float32(0.25))
"""Of a record's reach, that it keeps at least: it may be the neighbour that is wrong, and rounds are few."""


@wp.func
def _sum(v: wp.vec3) -> wp.float32:
    return v[0] + v[1] + v[2]


@wp.kernel
def shorten(
    cache: IrradianceCache,
    radius: wp.array[wp.float32],
    tolerance: wp.float32,
    offset: wp.int32,
    radius_out: wp.array[wp.float32],
) -> None:
    """Shorten the reach of all records that contradict record j, one thread each j.

    Args:
        radius: of each record [scene units] [N].
        tolerance: difference that is let pass, as a share of the larger of the two irradiances.
        radius_out: the same as `radius` at first [N].
    """
    j = offset + wp.tid()
    stack = wp.zeros(shape=(STACK_CAPACITY,), dtype=wp.int32)
    found = wp.zeros(shape=(CAPACITY,), dtype=wp.uint64)
    x = cache.position[j]
    n = cache.normal[j]
    measured = _sum(cache.irradiance[j])
    count = find(cache, x, n, stack, found)
    for k in range(count):
        i = key_rank(found[k])
        expected = _sum(extrapolated(cache, i, x, n))
        difference = wp.abs(expected - measured) - tolerance * wp.max(expected, measured)
        if difference > 0.0:
            error = wp.abs(expected - measured) / wp.max(expected, measured)
            way = wp.length(x - cache.position[i])
            wp.atomic_min(radius_out, i, wp.max(way * wp.sqrt(tolerance / error), LEAST_SHARE * radius[i]))


def agreeing(records: Arrays, tolerance: float, launcher: Launcher = ONE_THREAD) -> NDArray[np.float32]:
    """How far records reach without contradicting each other.

    Args:
        records: N >= 0 of them, as record_tree.build takes them, by ascending number.
        tolerance: relative difference that both may err by, > 0.
        launcher: on the CPU.

    Returns:
        Radii, none above those given and none below a quarter of them [scene units], float32, shape [N].
    """
    radius = np.ascontiguousarray(records["radius"], np.float32)
    if not len(radius):
        return radius
    given, cache = wp.array(radius, dtype=wp.float32, device="cpu", copy=False), build(records)
    # What Warp calls atomic is not, on the CPU: each chunk shortens radii of its own, and the least of all counts.
    chunks = launcher.chunks(len(radius), GRAIN)
    shortened = np.tile(radius, (len(chunks), 1))
    outs = [wp.array(row, dtype=wp.float32, device="cpu", copy=False) for row in shortened]
    inputs = [(size, [cache, given, tolerance, start, out]) for (start, size), out in zip(chunks, outs, strict=True)]
    launcher.run(shorten, inputs)
    shorter: NDArray[np.float32] = np.minimum.reduce(shortened)
    return shorter
