"""Whether one pass is good enough: told by a second one of a quarter of the image, which is no part of it.

Where a large error is asked for, one sample a pixel may have a tenth of it, and a second would only tell so. Of each
four blocks of pixels one is rendered again, with other photons and other samples: half the squared difference is the
variance of either pass there, and four times that stands for all four.

Blocks are not alike. What the three that were not looked at may have more is told by how far those that were looked at
are apart (cluster sampling: Cochran 1977, section 9): the interval is as much wider.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.allotment import Allotment, blocks_of, spread
from wdpm.goal.convergence import ConvergenceEstimator, Estimate, mean_of_neighbours
from wdpm.goal.goal import Metric
from wdpm.rendering.pass_plan import PassPlan, PassResult, shrink

Values = NDArray[np.float64]

OF_EACH = 4
"""Blocks, in squares of 2 x 2, of which one is looked at."""

LEAST_SQUARES = 64
"""Of an image that is worth a look: a second pass of a smaller one takes no time, and its blocks would be too few."""

FREEDOM = 2.0 / (2.0 / 3.0 + 1.0 - 1.0 / OF_EACH) - 2.0
"""Of the estimate, in place of the 1 of two passes. Of b, what each square of blocks is off by, the mean has a relative
variance of 2 / (freedom + 2) sum b² / (sum b)², of which two passes make 2/3; to look at one block of four adds at most
(1 - 1/4)."""


def blocks_to_look_at(width: int, height: int) -> NDArray[np.bool_]:
    """One of each 2 x 2 blocks, not always in the same place of them; shape [rows, columns]."""
    row, column = np.indices(blocks_of(width, height))
    return (row % 2) * 2 + column % 2 == (column // 2 + 2 * (row // 2)) % OF_EACH


def is_worth_a_look(image: Values, metric: Metric, mean_square: float) -> bool:
    """Whether one pass may be good enough, by how alike pixels next to each other are.

    Args:
        image: of that pass, shape [height, width, 3].
    """
    height, width = image.shape[:2]
    if not metric.is_relative or min(blocks_of(width, height)) < 2:
        return False
    rows, columns = blocks_of(width, height)
    if rows * columns < OF_EACH * LEAST_SQUARES:
        return False
    inner = image[1:-1, 1:-1]
    others = (image[:-2, 1:-1], image[2:, 1:-1], image[1:-1, :-2], image[1:-1, 2:])
    apart = np.sort([((inner - other) ** 2).mean(axis=2) for other in others], axis=0)[1]  # an edge may cross two
    bright = np.maximum(np.abs(inner), mean_of_neighbours(image)[1:-1, 1:-1])
    weight = metric.weight(bright).mean(axis=2)
    return bool((apart / 2.0 * weight).mean() <= mean_square)


def look(
    first: PassResult,
    plan: PassPlan,
    render: Callable[[PassPlan, Allotment], PassResult],
    metric: Metric,
    biased: bool,
) -> Estimate | None:
    """How far the first pass alone is from the truth.

    Args:
        plan: of the second pass.
        render: renders a pass, of some blocks.
    """
    image = _finite(first)
    height, width = image.shape[:2]
    blocks = blocks_to_look_at(width, height)
    count = blocks.astype(np.int32) * np.int32(plan.spp)
    again = render(plan, Allotment(np.full(blocks.shape, plan.first_sample, np.int32), count))
    seen = np.asarray(spread(blocks, width, height))[..., np.newaxis]
    estimator = ConvergenceEstimator(image.shape, metric, biased)
    # Where nothing was looked at both are alike, and nothing is added to the variance.
    for number, each in enumerate((image, np.where(seen, _finite(again), image))):
        estimator.add({"beauty": each.astype(np.float32)}, plan.spp, shrink(number))
    of_both, _ = estimator.variance()
    share = float(seen.mean())
    return estimator.estimate_of(of_both * (2.0 / share), FREEDOM) if share > 0 else None


def _finite(result: PassResult) -> Values:
    beauty = result.layers["beauty"]
    return np.where(np.isfinite(beauty), beauty, 0.0).astype(np.float64)
