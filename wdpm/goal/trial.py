"""Measures, by three cheap renders of few samples, what settings cost and how far their images are off.

Three passes tell the two sources of noise apart: a and b have the same photons and different samples, b and c the same
samples and different photons.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.convergence import ConvergenceEstimator, centred_figure, most_bias
from wdpm.goal.goal import Metric
from wdpm.goal.reference_pair import ReferencePair, coarser
from wdpm.rendering.pass_plan import PassPlan, PassResult
from wdpm.rendering.passes import PassRenderer
from wdpm.report.report import ErrorFigure

MOST_FEARED = 100.0
"""Of a pixel's relative squared error. More is feared of single pixels that one sample of two saw far brighter than all
around them, and a few passes more tell whether they are."""

MOST_LONE = 4096
"""Pixels of more than that, the largest, which are told one by one."""

Values = NDArray[np.float64]
Clock = Callable[[], float]

TRIAL_PLANS = (PassPlan(0, 0, 1), PassPlan(0, 1, 1), PassPlan(1, 1, 1))


@dataclass(frozen=True, eq=False)
class Trial:
    """What one kind of pass costs and how far it is off.

    Attributes:
        settings: of the render; passes and samples are still open.
        start: seconds before the first pass: preparing what the cluster has forgotten by then, unless it is `ready`.
        pass_cost: seconds of each pass, whatever its samples: photons, maps, irradiance records.
        sample_cost: seconds of one sample of every pixel.
        pass_noise: weighted mean square of one pass that samples do not lessen.
        sample_noise: the same that is divided by the number of samples.
        record_cost: of pass_cost, the irradiance records of a pass of one sample.
        rare: by how much the noise of all passes of the trial, at most (convergence.py), lies above what samples leave
            on average, for fear of rare bright ones.
        lone: what is feared of each pixel of more than MOST_FEARED, the largest first, none of it in `rare`.
        bias: the squared bias of a pass of the first radius, at most: the upper end of its interval.
        likely_bias: the same, as estimated, at least 0. Far below `bias` where the noise of so few samples hides it.
        compile_seconds: that went by for compiling, in none of the above.
        results: the passes that may be part of the image, if it has one sample a pass.
        measured: whether errors are known: there was time for more than one pass.
        ready: whether its renderer is still there: passes of one sample need not start anew.
    """

    settings: RenderSettings
    start: float
    pass_cost: float
    sample_cost: float
    pass_noise: float
    sample_noise: float
    bias: float
    rare: float = 0.0
    lone: tuple[float, ...] = ()
    compile_seconds: float = 0.0
    record_cost: float = 0.0
    likely_bias: float = 0.0
    results: dict[PassPlan, PassResult] = field(default_factory=dict)
    measured: bool = True
    ready: bool = False

    @property
    def cost(self) -> float:
        """Seconds of another trial of these settings."""
        return self.start + len(TRIAL_PLANS) * (self.pass_cost + self.sample_cost)


def try_out(
    make: Callable[[], PassRenderer],
    settings: RenderSettings,
    metric: Metric,
    reference: ReferencePair | None,
    clock: Clock = time.perf_counter,
    seconds_left: Callable[[], float] = lambda: math.inf,
) -> Trial:
    """Render the trial's passes; only the first, if there is no time for others. Then nothing is known of its error.

    Args:
        make: makes the renderer of the settings.
        reference: of the bias; None leaves it at what it is at most by experience.
        clock: seconds, growing.
        seconds_left: that the trial may take, less what it took.
    """
    began = clock()
    renderer = make()
    compile_seconds = renderer.prepared.seconds.get("compile", 0.0)
    start = max(clock() - began - compile_seconds, 0.0)
    results, costs = [], []
    for plan in TRIAL_PLANS:
        began = clock()
        results.append(renderer.render(plan))
        costs.append(clock() - began)
        if len(results) == 1 and seconds_left() < (len(TRIAL_PLANS) - 1) * costs[0]:
            found = {plan: results[0]}
            return Trial(
                settings,
                start,
                0.0,
                costs[0],
                0.0,
                0.0,
                0.0,
                compile_seconds=compile_seconds,
                results=found,
                measured=False,
                ready=True,
            )
    a, b, c = (_finite(result.layers["beauty"]) for result in results)
    weight = metric.weight((a + b + 2 * c) / 4)
    sample_cost = costs[1] * _share_of(results[1], "render")
    most = most_bias(metric) if settings.algorithm.biased else 0.0
    bias = ErrorFigure(0.0, 0.0, most) if reference is None else bias_of(a, b, c, metric, reference)
    rare, lone = rare_of(results, metric)
    return Trial(
        settings=settings,
        start=start,
        pass_cost=max(costs[2] - sample_cost, 0.0),
        sample_cost=sample_cost,
        pass_noise=_finite_mean((b - c) ** 2 * weight) / 2,
        sample_noise=_finite_mean((a - b) ** 2 * weight) / 2,
        bias=bias.high,
        likely_bias=min(max(bias.value, 0.0), bias.high),
        rare=rare,
        lone=lone,
        compile_seconds=compile_seconds,
        record_cost=costs[2] * _share_of(results[2], "records"),
        results={TRIAL_PLANS[0]: results[0], TRIAL_PLANS[2]: results[2]},
        ready=True,
    )


def bias_of(a: Values, b: Values, c: Values, metric: Metric, reference: ReferencePair) -> ErrorFigure:
    """Squared bias of a trial's passes, at the pixels of the reference."""
    a, b, c = (coarser(each, reference.factor) for each in (a, b, c))
    mean = (a + c) / 2  # other samples and other photons: the two are independent
    squared = (mean - reference.a) * (mean - reference.b) - (a - c) ** 2 / 4
    # Where so few samples missed an edge of a lamp, the reference knows how bright it is.
    bright = np.maximum(np.abs(mean), mean_around((reference.a + reference.b) / 2))
    return centred_figure(np.nan_to_num(squared * metric.weight(bright)))


def mean_around(image: Values) -> Values:
    """Mean of each pixel and the eight around it, shape [height, width, 3]."""
    height, width = image.shape[:2]
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    total: Values = np.sum([padded[y : y + height, x : x + width] for y in range(3) for x in range(3)], axis=0)
    return total / 9.0


def rare_of(results: Sequence[PassResult], metric: Metric) -> tuple[float, tuple[float, ...]]:
    """What fear of rare samples adds to the noise of the passes of a trial together: Trial.rare and Trial.lone."""
    estimator = ConvergenceEstimator(results[0].layers["beauty"].shape, metric, biased=False)
    for result in results:
        estimator.add(result.layers, 1, 1.0)
    variance, _ = estimator.variance()
    plain = variance * metric.weight(estimator.mean())
    feared = (variance * estimator.most_weight()).mean(axis=2).ravel()
    lone = np.sort(feared[feared > MOST_FEARED])[::-1] if metric.is_relative else np.zeros(0)
    rest = float(feared.sum() - lone.sum()) / feared.size
    return max(rest - float(plain.mean()), 0.0), tuple((lone[:MOST_LONE] / feared.size).tolist())


def _share_of(result: PassResult, phase: str) -> float:
    """Of a pass's time, what went to a phase."""
    whole = sum(result.seconds.values())
    return result.seconds.get(phase, 0.0) / whole if whole > 0 else float(phase == "render")


def _finite(image: NDArray[np.float32]) -> Values:
    """In double, with 0 for what is no number."""
    return np.where(np.isfinite(image), image, 0.0).astype(np.float64)


def _finite_mean(values: Values) -> float:
    return float(np.where(np.isfinite(values), values, 0.0).mean())
