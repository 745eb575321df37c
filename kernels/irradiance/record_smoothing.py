"""Noise of records averages out among neighbours: each becomes the mean of what those around it expect of it.

What a record's few hundred rays get wrong shows as a pearl or a blotch as wide as the record reaches. Its neighbours
have met other rays, and light changes between them as their derivatives tell. So record i becomes the weighted mean of

    e_j = E_j + (s_j² D_i + s_i² D_j) / (s_i² + s_j²) (y_i - y_j)

over the records j around it, with derivatives D = (rotation, translation) by y = (normal, position) and standard errors
s, and its derivatives become theirs. Of two that are as sure of themselves that is the
trapezoidal rule, which is off by a third derivative, where a mean of the E_j alone would be off by a second, and by a
first at the edge of a wall. Of one that is not, the derivatives are no better than its value: a ray that met the
inside of a lamp, a little way off, says that light changes at once. Weights are

    w_j = max(0, t_j)² max(0, 1 - (e_j - E_i)² / (APART² (s_i² + s_j²)))²

with t_j = 1 - |x_i - x_j|² / (REACH min(R_i, R_j))² less the turn of the normals, as in cache.py. The second factor is
that of bilateral filters (Tomasi & Manduchi 1998, "Bilateral Filtering for Gray and Color Images"; by measured
variances: Rousselle, Knaus & Zwicker 2012, "Adaptive Rendering with Non-Local Means Filtering"): records that differ by
more than both may err see something that really differs, such as a shadow's edge, and stay apart. Both factors are the
same for two records either way, so what one gives away the other takes, and the light of all stays what it is, about.

No light is weighted by how sure it is. A record whose rays missed a small bright thing is darker and surer than one
that hit it, and would outweigh it. For the same reason s is in weights the record's own error or the mean of those
around it, whichever is larger: one that believes itself exact by chance is taken for no better than others.

The result is a function of the set of records, bit for bit: sums are in the order of their numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.irradiance.cache import CAPACITY, STACK_CAPACITY, TURN, find, key_rank
from wdpm.kernels.irradiance.record_tree import Arrays, IrradianceCache, build
from wdpm.kernels.launch import ONE_THREAD, Launcher

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

GRAIN = 256
"""Records that are worth a chunk of a launch of their own: a microsecond each."""

REACH = 2.0
"""How far neighbours lie, at most, as a share of the reach of either. With 3, walls of uplight-room are smoother by a
tenth, and where light bends they are off by as much again as with 2."""

APART = wp.constant(wp.float64(3.0))
"""Standard deviations of the difference of two records from which on they have nothing to say to each other."""

_TINY = wp.constant(wp.float64(1e-100))
"""Variances are of twice as many digits as records: lamps in whatever unit are as many times as bright squared."""


@wp.func
def _grey(v: wp.vec3) -> wp.float32:
    return (v[0] + v[1] + v[2]) / 3.0


@wp.func
def _nearness(cache: wp.ref[IrradianceCache], reach: wp.array[wp.float32], i: wp.int32, j: wp.int32) -> wp.float32:
    """The first factor of a weight: 1 for the record itself."""
    way = cache.position[j] - cache.position[i]
    turn = cache.normal[j] - cache.normal[i]
    least = wp.min(reach[i], reach[j])
    t = wp.max(1.0 - wp.dot(way, way) / (least * least) - TURN * wp.dot(turn, turn), 0.0)
    return t * t


@wp.func
def _share(error: wp.float32, other: wp.float32) -> wp.float32:
    """What the variance of the first is of the sum of both; a half if both are exact."""
    first = wp.float64(error) * wp.float64(error) + _TINY
    second = wp.float64(other) * wp.float64(other) + _TINY
    return wp.float32(first / (first + second))


@wp.kernel
def typical_variances(
    cache: IrradianceCache,
    reach: wp.array[wp.float32],
    error: wp.array[wp.float32],
    offset: wp.int32,
    variance_out: wp.array[wp.float64],
    count_out: wp.array[wp.int32],
    near_out: wp.array2d[wp.int32],
) -> None:
    """The larger of a record's own variance and the mean of those around it, one thread a record.

    Args:
        reach: how far neighbours lie [scene units] [N].
        error: standard errors, mean of RGB [N].
        variance_out: [N].
        count_out: records that lie around it [N].
        near_out: which these are, ascending [N, CAPACITY].
    """
    i = offset + wp.tid()
    stack = wp.zeros(shape=(STACK_CAPACITY,), dtype=wp.int32)
    found = wp.zeros(shape=(CAPACITY,), dtype=wp.uint64)
    count = find(cache, cache.position[i], cache.normal[i], stack, found)
    own = wp.float64(error[i]) * wp.float64(error[i])
    total = wp.float64(0.0)
    weight = wp.float64(0.0)
    for k in range(count):
        j = key_rank(found[k])
        near_out[i, k] = j
        w = wp.float64(_nearness(cache, reach, i, j))
        total += w * (wp.float64(error[j]) * wp.float64(error[j]))
        weight += w
    count_out[i] = count
    variance_out[i] = own
    if weight > wp.float64(0.0):
        variance_out[i] = wp.max(own, total / weight)


@wp.kernel
def smooth(
    cache: IrradianceCache,
    reach: wp.array[wp.float32],
    error: wp.array[wp.float32],
    variance: wp.array[wp.float64],
    count: wp.array[wp.int32],
    near: wp.array2d[wp.int32],
    offset: wp.int32,
    irradiance_out: wp.array[wp.vec3],
    rotation_out: wp.array[wp.mat33],
    translation_out: wp.array[wp.mat33],
) -> None:
    """What each record becomes, one thread a record.

    Args:
        reach, error: see typical_variances [N].
        variance, count, near: as typical_variances gives them.
        irradiance_out: >= 0 [N].
        rotation_out, translation_out: its derivatives [N].
    """
    i = offset + wp.tid()
    x = cache.position[i]
    n = cache.normal[i]
    total = wp.vec3(0.0)
    rotation = wp.mat33(0.0)
    translation = wp.mat33(0.0)
    weight = wp.float32(0.0)
    for k in range(count[i]):
        j = near[i, k]
        w = _nearness(cache, reach, i, j)
        if w > 0.0:
            of_i = _share(error[j], error[i])
            of_j = _share(error[i], error[j])
            turned = (cache.rotation[i] * of_i + cache.rotation[j] * of_j) * (n - cache.normal[j])
            moved = (cache.translation[i] * of_i + cache.translation[j] * of_j) * (x - cache.position[j])
            expected = cache.irradiance[j] + turned + moved
            apart = wp.float64(_grey(expected - cache.irradiance[i]))
            alike = wp.float32(wp.float64(1.0) - apart * apart / (APART * APART * (variance[i] + variance[j]) + _TINY))
            if alike > 0.0:
                w = w * (alike * alike)
                total += w * expected
                rotation += w * cache.rotation[j]
                translation += w * cache.translation[j]
                weight += w
    irradiance_out[i] = cache.irradiance[i]
    rotation_out[i] = cache.rotation[i]
    translation_out[i] = cache.translation[i]
    if weight > 0.0:
        irradiance_out[i] = wp.max(total / weight, wp.vec3(0.0))
        rotation_out[i] = rotation / weight
        translation_out[i] = translation / weight


def smoothed(records: Arrays, launcher: Launcher = ONE_THREAD) -> dict[str, NDArray[Any]]:
    """Records without most of their noise.

    Args:
        records: N >= 0 of them, as record_tree.build takes them, by ascending number, with "error", the standard error
            of each irradiance, mean of RGB, shape [N].
        launcher: on the CPU.

    Returns:
        "irradiance" [N, 3], "rotation" and "translation" [N, 3, 3] of the same records, float32.
    """
    count = len(records["radius"])
    if not count:
        return {name: records[name] for name in ("irradiance", "rotation", "translation")}
    far = (records["radius"] * np.float32(REACH)).astype(np.float32)
    cache = build({**{name: records[name] for name in records if name != "error"}, "radius": far})
    reach = wp.array(far, dtype=wp.float32, device="cpu")
    error = wp.array(np.ascontiguousarray(records["error"], np.float32), dtype=wp.float32, device="cpu")
    variance = wp.empty(count, dtype=wp.float64, device="cpu")
    found = wp.empty(count, dtype=wp.int32, device="cpu")
    near = wp.empty((count, CAPACITY), dtype=wp.int32, device="cpu")
    given = {"cache": cache, "reach": reach, "error": error}
    outputs = {"variance_out": variance, "count_out": found, "near_out": near}
    launcher(typical_variances, count, grain=GRAIN, **given, **outputs)
    made = {
        "irradiance": wp.empty(count, dtype=wp.vec3, device="cpu"),
        "rotation": wp.empty(count, dtype=wp.mat33, device="cpu"),
        "translation": wp.empty(count, dtype=wp.mat33, device="cpu"),
    }
    outputs = {f"{name}_out": array for name, array in made.items()}
    launcher(smooth, count, grain=GRAIN, **given, variance=variance, count=found, near=near, **outputs)
    return {name: array.numpy() for name, array in made.items()}
