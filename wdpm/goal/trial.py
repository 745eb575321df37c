"""Measures, by two or three cheap renders of few samples, what settings cost and how far their images are off.

Where a large error is asked for, the first pass may be good enough: a look at part of a second tells (first_look.py).
Two passes, a and b, have other photons and other samples: they are the first two of an image. Where they are good
enough, that is all. Else a third, c, tells the two sources of noise apart: it has b's photons and a's samples.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.convergence import ConvergenceEstimator, Estimate, centred_figure, most_bias
from wdpm.goal.first_look import is_worth_a_look, look
from wdpm.goal.goal import Metric
from wdpm.goal.reference_pair import ReferencePair, coarser
from wdpm.rendering.pass_plan import PassPlan, PassResult, shrink
from wdpm.rendering.passes import PassRenderer
from wdpm.report.report import ErrorFigure

MOST_FEARED = 100.0
"""Of a pixel's relative squared error. More is feared of single pixels that one sample of two saw far brighter than all
around them, and a few passes more tell whether they are."""

MOST_LONE = 4096
"""Pixels of more than that, the largest, which are told one by one."""

STRATIFIED, STRATIFIED_POWER = 0.8, -0.05
"""Of half the squared difference of two successive samples, what each adds to the noise of a mean of n, as the estimate
has it: the first times n to the second. Samples share out pixel and lamps evenly, so noise falls faster than with
their number; but of what is bright in few of them, the more is seen the more there are. Measured on eleven scenes: 0.62
to 0.9 for n = 2, and 0.46 (the sky alone) to 1.07 (daylight through blinds) for n = 16."""

MARGIN = 1.1
"""Upper end of an estimate over the estimate."""

TRIED = 2
"""Passes of a trial that may be part of the image: of other samples and of other photons."""

UNKNOWN_SHARE = 0.6
"""Of a bias that nothing tells, what it adds to the upper end of an estimate, beside the noise's own interval."""

Values = NDArray[np.float64]
Clock = Callable[[], float]

IMAGE_PLANS = (PassPlan(0, 0, 1), PassPlan(1, 1, 1))
APART_PLAN = PassPlan(1, 0, 1)
PASSES = len(IMAGE_PLANS) + 1


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
        rare: by how much the noise of the mean of a and b, at most (convergence.py), lies above what samples leave on
            average, for fear of rare bright ones.
        lone: what is feared of each pixel of more than MOST_FEARED, the largest first, none of it in `rare`.
        bias: the squared bias of a pass of the first radius, at most: the upper end of its interval.
        likely_bias: the same, as estimated, at least 0. Far below `bias` where the noise of so few samples hides it.
        compile_seconds: that went by for compiling, in none of the above.
        results: the passes that may be part of the image, if it has one sample a pass.
        measured: whether errors are known: there was time for more than one pass.
        ready: whether its renderer is still there: passes of one sample need not start anew.
        at_once: of the error of the first pass, where that is good enough by itself.
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
    at_once: Estimate | None = None

    @property
    def cost(self) -> float:
        """Seconds of another trial of these settings."""
        return self.start + PASSES * (self.pass_cost + self.sample_cost)


def try_out(
    make: Callable[[], PassRenderer],
    settings: RenderSettings,
    estimator: ConvergenceEstimator,
    reference: ReferencePair | None,
    clock: Clock = time.perf_counter,
    seconds_left: Callable[[], float] = lambda: math.inf,
    mean_square: float = 0.0,
) -> Trial:
    """Render the trial's passes; only the first, if there is no time for others. Then nothing is known of its error.

    Args:
        make: makes the renderer of the settings.
        estimator: takes in the passes that may be part of the image.
        reference: of the bias; None leaves it at what it is at most by experience.
        clock: seconds, growing.
        seconds_left: that the trial may take, less what it took.
        mean_square: error asked for: where the first two passes reach it, by the estimate that ends renders, there is
            no third.
    """
    began = clock()
    renderer = make()
    taken = clock() - began
    compile_seconds = min(renderer.prepared.seconds.get("compile", 0.0), taken)  # the clock may be that of the CPU
    start = taken - compile_seconds
    known: dict[str, Any] = {"settings": settings, "start": start, "compile_seconds": compile_seconds, "ready": True}

    def timed(plan: PassPlan) -> tuple[PassResult, float]:
        began = clock()
        return renderer.render(plan), clock() - began

    first, cost = timed(IMAGE_PLANS[0])
    known |= {"pass_cost": 0.0, "pass_noise": 0.0, "sample_noise": 0.0, "bias": 0.0}
    if seconds_left() < (PASSES - 1) * cost:
        known["pass_cost"] = cost * (1.0 - _share_of(first, "render"))
        return Trial(
            sample_cost=cost - known["pass_cost"],
            record_cost=cost * _share_of(first, "records"),
            results={IMAGE_PLANS[0]: first},
            measured=False,
            **known,
        )
    if reference is None and is_worth_a_look(_beauty(first), estimator.metric, mean_square):
        one = look(first, IMAGE_PLANS[1], renderer.render, estimator.metric, settings.algorithm.biased)
        if one is not None and one.total.high <= mean_square:
            known |= {"sample_noise": one.noise.value, "bias": one.bias.high}
            return Trial(sample_cost=cost, results={IMAGE_PLANS[0]: first}, at_once=one, **known)
    second, cost = timed(IMAGE_PLANS[1])
    image = (first, second)
    metric = estimator.metric
    for number, result in enumerate(image):
        estimator.add(result.layers, 1, shrink(number))
    estimate = estimator.estimate()
    is_enough = estimate is not None and estimate.total.high <= mean_square
    apart = None if is_enough else timed(APART_PLAN)
    noise = _noise(image, None if apart is None else apart[0], estimator, settings.algorithm.biased)
    of_samples, of_one = (second, cost) if apart is None else apart
    sample_cost = of_one * _share_of(of_samples, "render")
    most = UNKNOWN_SHARE * most_bias(metric) if settings.algorithm.biased else 0.0
    a, b = map(_beauty, image)
    bias = ErrorFigure(0.0, 0.0, most) if reference is None else bias_of(a, b, metric, reference)
    return Trial(
        sample_cost=sample_cost,
        likely_bias=min(max(bias.value, 0.0), bias.high),
        record_cost=cost * _share_of(second, "records"),
        results=dict(zip(IMAGE_PLANS, image, strict=True)),
        **(known | noise | {"pass_cost": max(cost - sample_cost, 0.0), "bias": bias.high}),
    )


def _noise(
    image: tuple[PassResult, PassResult], apart: PassResult | None, estimator: ConvergenceEstimator, biased: bool
) -> dict[str, Any]:
    """What a trial says of noise, by name. Without a pass that tells photons and samples apart, samples make it all."""
    metric = estimator.metric
    a, b = map(_beauty, image)
    if apart is None:
        weight = metric.weight((a + b) / 2)
        pass_noise, sample_noise = 0.0, _finite_mean((a - b) ** 2 * weight) / 2 / stratified(TRIED)
    else:
        c = _beauty(apart)
        weight = metric.weight((2 * a + b + c) / 4)
        pass_noise, sample_noise = (_finite_mean(each**2 * weight) / 2 for each in (c - a, b - c))
    upper, lone = upper_end(estimator)
    # What the estimate says of the two passes, and what samples leave on average: fear of rare ones, or less than that.
    average = noise_of_two(pass_noise, sample_noise, biased)
    held = min(upper / (MARGIN * average), 1.0) if average > 0 else 1.0
    return {
        "pass_noise": held * pass_noise,
        "sample_noise": held * sample_noise,
        "rare": max(upper / MARGIN - average, 0.0),
        "lone": lone,
    }


def _beauty(result: PassResult) -> Values:
    return _finite(result.layers["beauty"])


def bias_of(a: Values, b: Values, metric: Metric, reference: ReferencePair) -> ErrorFigure:
    """Squared bias of a trial's two passes, at the pixels of the reference."""
    a, b = (coarser(each, reference.factor) for each in (a, b))
    mean = (a + b) / 2  # other samples and other photons: the two are independent
    squared = (mean - reference.a) * (mean - reference.b) - (a - b) ** 2 / 4
    # Where so few samples missed an edge of a lamp, the reference knows how bright it is.
    bright = np.maximum(np.abs(mean), mean_around((reference.a + reference.b) / 2))
    return centred_figure(np.nan_to_num(squared * metric.weight(bright)))


def mean_around(image: Values) -> Values:
    """Mean of each pixel and the eight around it, shape [height, width, 3]."""
    height, width = image.shape[:2]
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    total: Values = np.sum([padded[y : y + height, x : x + width] for y in range(3) for x in range(3)], axis=0)
    return total / 9.0


def upper_end(estimator: ConvergenceEstimator) -> tuple[float, tuple[float, ...]]:
    """Upper end of the estimated noise of the mean of some passes, and what is in none of it: Trial.lone."""
    variance, freedom = estimator.variance()
    weight, most_weight = estimator.weights()
    each = (variance * most_weight).mean(axis=2)
    is_lone = (each > MOST_FEARED) & estimator.metric.is_relative
    lone = np.sort(each[is_lone])[::-1][:MOST_LONE] / each.size
    rest = np.where(is_lone[..., np.newaxis], 0.0, variance)
    return estimator.noise_of(rest, freedom, weight, most_weight).high, tuple(lone.tolist())


def noise_of_two(pass_noise: float, sample_noise: float, biased: bool) -> float:
    """Of the mean of two passes of one sample each, by the model of schedule.py."""
    narrower = (1.0 + 1.0 / shrink(1)) / 2.0 if biased else 1.0
    return (pass_noise * narrower + stratified(TRIED) * sample_noise) / TRIED


def stratified(samples: int) -> float:
    """What each of so many samples of a pixel adds to the noise of their mean: see STRATIFIED."""
    return STRATIFIED * samples**STRATIFIED_POWER


def _share_of(result: PassResult, phase: str) -> float:
    """Of a pass's time, what went to a phase."""
    whole = sum(result.seconds.values())
    return result.seconds.get(phase, 0.0) / whole if whole > 0 else float(phase == "render")


def _finite(image: NDArray[np.float32]) -> Values:
    """In double, with 0 for what is no number."""
    return np.where(np.isfinite(image), image, 0.0).astype(np.float64)


def _finite_mean(values: Values) -> float:
    return float(np.where(np.isfinite(values), values, 0.0).mean())
