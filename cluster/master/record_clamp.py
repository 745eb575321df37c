"""Neighbour clamping of the irradiance cache's records (Křivánek et al. 2006).

After "Making Radiance and Irradiance Caching Practical: Adaptive Caching and Neighbor Clamping" (EGSR 2006). What a
record is near to may escape its gather rays: a thin or small thing, or one just below its horizon. A neighbour
close to it will have seen it and have a short radius. As nothing can be nearer to one record than to another by more
than the way between them, R_i becomes the least R_j + |x_i - x_j| over all records j: radii then grow by at most 1 for
each unit of way, and gaps of coverage near edges, with what leaks through them, close.

The result is a function of the set of records, bit for bit: a minimum knows no order, and blocks are skipped only if
none of their records can have a say.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.kernels.irradiance.record_tree import kd_order

_BLOCK = 64
"""Records held against all others at once: enough to make numpy's calls worth while, few enough to lie together."""

_MARGIN = 1.0 - 2.0**-40
"""Bounds are lowered by this factor; a bound and what it bounds are off by a few roundings of 2^-53 each."""


def clamped(position: NDArray[np.floating], radius: NDArray[np.floating]) -> NDArray[np.float32]:
    """The least R_j + |x_i - x_j| for each record i.

    Args:
        position: [scene units], shape [N, 3].
        radius: > 0 [scene units], shape [N].

    Returns:
        Radii, none above those given, float32, shape [N].
    """
    count = len(radius)
    if not count:
        return np.zeros(0, np.float32)
    # Blocks of like radii that lie together look at few others.
    octave = np.frexp(radius)[1]
    alike = [np.flatnonzero(octave == value) for value in np.unique(octave)]
    order = np.concatenate([rows[kd_order(position[rows].astype(np.float32))] for rows in alike])
    x = position.astype(np.float64)[order]
    r = radius.astype(np.float64)[order]
    starts = np.arange(0, count, _BLOCK)
    low, high = np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)
    shortest = np.array([start + int(np.argmin(r[start : start + _BLOCK])) for start in starts])
    out = np.empty(count)
    for number, start in enumerate(starts):
        block = slice(start, start + _BLOCK)
        first = np.minimum(r[block], _least(x[block], x[shortest], r[shortest]))
        gap = np.maximum(np.maximum(low[number] - high, low - high[number]), 0.0)
        near = np.flatnonzero((r[shortest] + _length(gap)) * _MARGIN < first.max())
        others = (starts[near][:, None] + np.arange(_BLOCK)).reshape(-1)
        others = others[others < count]
        gap = np.maximum(np.maximum(low[number] - x[others], x[others] - high[number]), 0.0)
        others = others[(r[others] + _length(gap)) * _MARGIN < first.max()]
        out[block] = np.minimum(first, _least(x[block], x[others], r[others]))
    result = np.empty(count, np.float32)
    result[order] = out.astype(np.float32)
    return result


def _least(x: NDArray[np.float64], others: NDArray[np.float64], r: NDArray[np.float64]) -> NDArray[np.float64]:
    """The least r_j + |x_i - x_j| for each i; inf where there are no others."""
    return (_length(x[:, None, :] - others[None, :, :]) + r).min(axis=1, initial=np.inf)


def _length(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Euclidean lengths along the last axis, always by the same three products and two sums."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.sqrt(x * x + y * y + z * z)
