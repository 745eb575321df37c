"""Neighbour clamping of the irradiance cache's records (Křivánek et al. 2006).

After "Making Radiance and Irradiance Caching Practical: Adaptive Caching and Neighbor Clamping" (EGSR 2006). What a
record is near to may escape its gather rays: a thin or small thing, or one just below its horizon. A neighbour
close to it will have seen it and have a short radius. As nothing can be nearer to one record than to another by more
than the way between them, R_i becomes the least R_j + |x_i - x_j| over all records j: radii then grow by at most 1 for
each unit of way, and gaps of coverage near edges, with what leaks through them, close.

The result is a function of the set of records, bit for bit: a minimum knows no order, and groups are skipped only if
none of their records can have a say.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.launch import ONE_THREAD, Launcher
from wdpm.kernels.photons.kd_order import sort

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

GRAIN = 256
"""Records that are worth a chunk of a launch of their own: a third of a microsecond each, and more at worst."""

BLOCK = wp.constant(16)
"""Records that share a box, and blocks that share one in turn."""

MARGIN = wp.constant(wp.float64(1.0 - 2.0**-40))
"""Bounds are lowered by this factor; a bound and what it bounds are off by a few roundings of 2^-53 each."""


@wp.struct
class Groups:
    """Boxes of records that follow one another, and the least radius among them."""

    low: wp.array[wp.vec3d]
    high: wp.array[wp.vec3d]
    radius: wp.array[wp.float64]


@wp.func
def _length(v: wp.vec3d) -> wp.float64:
    return wp.sqrt((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2])


@wp.func
def _least_possible(groups: Groups, group: wp.int32, x: wp.vec3d) -> wp.float64:
    """A bound of R_j + |x - x_j| for the records j of a group."""
    zero = wp.float64(0.0)
    low = groups.low[group] - x
    high = x - groups.high[group]
    gap = wp.vec3d(
        wp.max(wp.max(low[0], high[0]), zero),
        wp.max(wp.max(low[1], high[1]), zero),
        wp.max(wp.max(low[2], high[2]), zero),
    )
    return (groups.radius[group] + _length(gap)) * MARGIN


@wp.func
def _least_in(
    position: wp.array[wp.vec3d], radius: wp.array[wp.float64], block: wp.int32, x: wp.vec3d, least: wp.float64
) -> wp.float64:
    """The least of `least` and R_j + |x - x_j| for the records j of a block."""
    found = least
    for j in range(block * BLOCK, wp.min((block + 1) * BLOCK, position.shape[0])):
        found = wp.min(found, radius[j] + _length(x - position[j]))
    return found


@wp.kernel
def clamp_records(
    position: wp.array[wp.vec3d],
    radius: wp.array[wp.float64],
    blocks: Groups,
    groups: Groups,
    offset: wp.int32,
    radius_out: wp.array[wp.float64],
) -> None:
    """The least R_j + |x_i - x_j| for each record i. Those of its own block go first: most others have no say then."""
    i = offset + wp.tid()
    x = position[i]
    own = i // BLOCK
    least = _least_in(position, radius, own, x, radius[i])
    for group in range(groups.radius.shape[0]):
        if _least_possible(groups, group, x) < least:
            for block in range(group * BLOCK, wp.min((group + 1) * BLOCK, blocks.radius.shape[0])):
                if block != own and _least_possible(blocks, block, x) < least:
                    least = _least_in(position, radius, block, x, least)
    radius_out[i] = least


def clamped(
    position: NDArray[np.floating], radius: NDArray[np.floating], launcher: Launcher = ONE_THREAD
) -> NDArray[np.float32]:
    """The least R_j + |x_i - x_j| for each record i.

    Args:
        position: [scene units], shape [N, 3].
        radius: > 0 [scene units], shape [N].
        launcher: on the CPU.

    Returns:
        Radii, none above those given, float32, shape [N].
    """
    count = len(radius)
    if not count:
        return np.zeros(0, np.float32)
    # Blocks of records that lie together look at few others: their radii are alike, too.
    order = sort(position.astype(np.float32), 0, count)
    x, r = position.astype(np.float64)[order], radius.astype(np.float64)[order]
    blocks = _grouped(x, x, r)
    out = wp.empty(count, dtype=wp.float64, device="cpu")
    places, radii = (wp.array(x, dtype=wp.vec3d, device="cpu"), wp.array(r, dtype=wp.float64, device="cpu"))
    groups = _uploaded(blocks), _uploaded(_grouped(*blocks))
    launcher(
        clamp_records,
        count,
        grain=GRAIN,
        position=places,
        radius=radii,
        blocks=groups[0],
        groups=groups[1],
        radius_out=out,
    )
    result = np.empty(count, np.float32)
    result[order] = out.numpy().astype(np.float32)
    return result


Bounds = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Low and high corners, shape [N, 3], and least radii, shape [N]."""


def _grouped(low: NDArray[np.float64], high: NDArray[np.float64], radius: NDArray[np.float64]) -> Bounds:
    """The bounds of every BLOCK of some bounds."""
    starts = np.arange(0, len(radius), int(BLOCK))
    return (
        np.minimum.reduceat(low, starts),
        np.maximum.reduceat(high, starts),
        np.minimum.reduceat(radius, starts),
    )


def _uploaded(bounds: Bounds) -> Groups:
    groups = Groups()
    groups.low, groups.high = (wp.array(corner, dtype=wp.vec3d, device="cpu") for corner in bounds[:2])
    groups.radius = wp.array(bounds[2], dtype=wp.float64, device="cpu")
    return groups
