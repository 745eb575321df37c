"""Gather rays that a record gets on top of one a stratum, where its radiance changes from stratum to stratum.

What a record gets wrong shows as a blotch as wide as the record reaches, which no number of camera samples lessens. How
wrong it is, its own rays tell: a stratum's radiance is that of one ray, and spreads about as much as its neighbours'
rays differ from each other. Rays are shared out in proportion to that spread (Neyman 1934), as many as bring the
record's relative error down to what is asked for. The ray of a stratum itself has no say in how many more it gets: a
chance hit of a small lamp that draws others, or keeps them away, is diluted more than a chance miss, or less, and the
mean of all records would be off.

What is smaller than a stratum escapes the rays around it as well: the inside of a lamp's cup, a patch of sun far away.
One record in ten meets it, counts it ten times over, and is a bright blotch among dark ones. Where lights shine first
is known, though (cluster.plan.lit_places), and with it what comes from there through each stratum if nothing stands in
between: what of that the rays around have not met adds to the spread that they tell.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
Counts = NDArray[np.int64]

GOLDEN = (5.0**0.5 - 1.0) / 2.0
"""Its multiples, less what is whole of them, are even between 0 and 1: numbers that are rounded by them keep their
sum."""


PEAK = 2.0
"""Standard deviation of what one ray brings through a stratum, over its mean, if all comes from a fifth of it."""


def extra_rays(
    radiance: Values, unoccluded: NDArray[np.float32], shot: NDArray[np.bool_], tolerance: float, most: int
) -> Counts:
    """How many rays each stratum of some records gets more.

    Args:
        radiance: of each stratum's ray, mean of RGB, shape [N, rows, columns].
        unoccluded: radiance that lit places would send if nothing stood in between, mean of RGB, the same shape.
        shot: strata whose rays were shot, the same shape; others get none.
        tolerance: relative standard error of the irradiance that is aimed at.
        most: extra rays of a record, about.

    Returns:
        shape [N, rows, columns].
    """
    near, beside = around(radiance)
    promised = np.minimum(unoccluded.astype(np.float64), np.finfo(np.float32).max)  # of lamps as bright as can be: inf
    unseen = np.maximum(_smoothed(promised) - near / beside, 0.0)
    spread = np.sqrt(neighbours_spread(radiance) ** 2 + (PEAK * unseen) ** 2)
    near_spread, _ = around(spread)
    # Both sums as they would be if the stratum were like what is around it: its own ray has no part in them.
    total = _total(radiance) - radiance + near / beside
    spreads = _total(spread) - near_spread + beside * spread
    # With n rays in proportion to the spreads s of all strata, the error of the sum is (sum of s) / sqrt(n).
    with np.errstate(divide="ignore", invalid="ignore"):
        wanted = np.where(total > 0, spreads / (tolerance * total), 0.0) ** 2
        share = np.where(spreads > 0, spread / spreads, 0.0)
    strata = radiance[0].size
    asked = np.minimum(wanted, float(most + strata)) * share - 1.0  # each has one ray already
    rounding = (np.arange(1, strata + 1) * GOLDEN % 1.0).reshape(radiance.shape[1:])
    return np.where(shot, np.floor(np.maximum(asked, 0.0) + rounding), 0.0).astype(np.int64)


def standard_errors(radiance: Values, counts: Counts) -> Values:
    """Of the irradiance of records, as the spread of their strata tells it, shape [N].

    It is an upper bound, about: neighbours differ by how light changes from stratum to stratum, too. A stratum spreads
    as those around it do, or as it differs from these: one ray that by chance meets the inside of a lamp, and has drawn
    no others to it, is the error of the whole record. (Rays are shared out without it; errors only tell who is to be
    averaged with whom.)

    Args:
        radiance: mean of each stratum's rays, mean of RGB, shape [N, rows, columns].
        counts: extra rays of each, the same shape.
    """
    near, beside = around(radiance)
    spread2 = np.maximum(neighbours_spread(radiance) ** 2, (radiance - near / beside) ** 2)
    variance = (spread2 / (counts + 1.0)).reshape(len(radiance), -1).cumsum(axis=1)[:, -1]
    errors: Values = np.sqrt(variance) * (math.pi / radiance[0].size)
    return errors


def _smoothed(values: Values) -> Values:
    """Half of what each stratum has, and half of the mean of what is around it: few places tell of each."""
    total, count = around(values)
    smooth: Values = 0.5 * values + 0.5 * total / count
    return smooth


def _total(values: Values) -> Values:
    """Of each record, one after another, whatever else is in the array, shape [N, 1, 1]."""
    return values.reshape(len(values), -1).cumsum(axis=1)[:, -1][:, None, None]


def neighbours_spread(values: Values) -> Values:
    """Standard deviation of what is around each stratum, without the stratum itself, shape [N, rows, columns]."""
    total, count = around(values)
    squares, _ = around(values**2)
    variance = (squares - total**2 / count) / np.maximum(count - 1, 1)
    return np.sqrt(np.maximum(variance, 0.0))


def around(values: Values) -> tuple[Values, Values]:
    """The sum of what is around each stratum, without the stratum itself, and how many these are, shape [rows, 1].

    Columns go round; the first and the last row have no neighbours beyond.
    """
    rows = values.shape[1]
    count, total = np.zeros((rows, 1)), np.zeros_like(values)
    turned = {across: np.roll(values, -across, axis=2) if across else values for across in (-1, 0, 1)}
    for down in (-1, 0, 1):
        to = slice(max(0, -down), rows - max(0, down))
        of = slice(max(0, down), rows - max(0, -down))
        for across, beside in turned.items():
            if down or across:
                total[:, to] += beside[:, of]
                count[to] += 1
    return total, count


def means(radiance: Values, counts: Counts, extra: Values) -> Values:
    """Mean radiance of each stratum, of its first ray and the others, shape [strata, 3].

    Args:
        radiance: of the first rays, shape [strata, 3].
        counts: extra rays of each stratum, shape [strata].
        extra: their radiance, those of the first stratum first, shape [counts.sum(), 3].
    """
    stratum = np.repeat(np.arange(len(counts)), counts)
    added = np.stack([np.bincount(stratum, extra[:, c], len(counts)) for c in range(3)], axis=1)
    together: Values = (radiance + added) / (counts[:, None] + 1.0)
    return together
