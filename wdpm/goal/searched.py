"""Renders what a search for an error found: pass after pass, until the estimate of their error is small enough.

The image is that of `--passes N` with the settings that were chosen and with as many passes as it took, to the bit.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

from wdpm.goal.clock import Budget
from wdpm.goal.convergence import LEAST_PASSES, ConvergenceEstimator, Estimate
from wdpm.goal.goal import Goal
from wdpm.goal.outcome import Ending, Found, Times, reasons
from wdpm.goal.schedule import Schedule
from wdpm.goal.trial_pilot import TrialPilot
from wdpm.rendering.adaptive import weight_of
from wdpm.rendering.pass_average import PassAverage
from wdpm.rendering.pass_plan import PassPlan, passes_in_words, shrink
from wdpm.rendering.pass_progress import PassProgress
from wdpm.rendering.passes import PassRenderer
from wdpm.scenes.errors import ClusterError

PATIENCE = 4
LEAST_FOR_PATIENCE = 32
"""As many times the passes that were expected are rendered, and as many at least, before an error that the pilot held
for possible counts as out of reach."""

FIRST_CHECKS = 1.05
"""The estimate is made after so many times the passes as the last time: it costs as much as a cheap pass does."""

SLOWER = 1.1
"""As many times the slowest pass so far, the next may take."""


class Searched(NamedTuple):
    """What came of a search: the mean of the passes, what is to be said of it, and what ended it early."""

    average: PassAverage
    found: Found
    times: Times
    error: BaseException | None


def render_found(pilot: TrialPilot, goal: Goal, budget: Budget) -> Searched:
    """Render what the pilot chose."""
    progress = pilot.work.progress
    schedule, expected = pilot.best(goal, budget.left())
    progress.note(promise(schedule, goal, expected))
    began = pilot.work.clock()
    estimator = pilot.estimator_for(schedule, goal)
    renderer = pilot.renderer_for(schedule)
    renderer.progress = progress
    done = _passes(renderer, schedule, goal, estimator, budget, _most(schedule, goal, expected))
    times = Times(pilot.work.clock() - began, schedule.seconds, pilot.seconds, pilot.compile_seconds)
    samples = tuple(plan.spp for plan in done.average.plans)
    found = Found(done.estimate, samples, done.ending, reasons(schedule), goal.metric.figure(schedule.error))
    return Searched(done.average, found, times, done.error)


class _Done(NamedTuple):
    """What came of the passes.

    Attributes:
        average: their mean.
        estimate: of its error.
        ending, error: what ended them; None for an error if they are complete.
    """

    average: PassAverage
    estimate: Estimate | None
    ending: Ending
    error: BaseException | None = None


def _passes(
    renderer: PassRenderer, schedule: Schedule, goal: Goal, estimator: ConvergenceEstimator, budget: Budget, most: float
) -> _Done:
    """Render until the goal is reached, or `most` passes are done, or someone has enough, or presses Ctrl-C
    after the first, or the cluster is lost after that.

    Args:
        estimator: may have taken in passes of the schedule's trial already; these are in the image in any case.
    """
    average = PassAverage(renderer.prepared)
    camera, bucket = renderer.prepared.session.view.camera, renderer.prepared.session.view.bucket
    buckets = -(-camera.width // bucket) * -(-camera.height // bucket)
    renderer.progress = PassProgress(renderer.progress, buckets, schedule.passes)
    samples, estimate, next_check, slowest = schedule.samples, None, LEAST_PASSES, 0.0
    number = 0
    while True:
        began = time.perf_counter()
        plan = PassPlan(number, number * samples, samples)
        try:
            result = schedule.trial.results.get(plan) or renderer.render(plan, average.allotment(plan))
        except (KeyboardInterrupt, ClusterError) as error:
            if not number:
                raise
            ending = Ending.LOST if isinstance(error, ClusterError) else Ending.INTERRUPTED
            return _Done(average, estimator.estimate(), ending, error)
        average.add(result)
        if schedule.ends_at_once:
            renderer.show(average)
            return _Done(average, schedule.trial.at_once, Ending.DONE)
        if number == estimator.passes:
            weight = weight_of(plan, result.allotment, camera.width, camera.height)
            estimator.add(result.layers, weight, shrink(number))
        number += 1
        renderer.show(average)
        if number < estimator.passes:
            continue
        if number >= next_check:
            estimate = estimator.estimate()
            next_check = max(number + 1, math.ceil(number * FIRST_CHECKS))
            if estimate is not None and estimate.total.high <= goal.mean_square:
                return _Done(average, estimate, Ending.DONE)
        if plan not in schedule.trial.results:
            slowest = max(time.perf_counter() - began, 0.9 * slowest)
        out_of_time = budget.left() < SLOWER * slowest
        if number >= most or out_of_time or renderer.enough:
            return _Done(average, estimator.estimate(), Ending.OUT_OF_TIME if out_of_time else Ending.DONE)


def _most(schedule: Schedule, goal: Goal, expected: bool) -> float:
    """Passes after which the error counts as out of reach."""
    if goal.seconds is not None and not expected:
        return math.inf  # the time ends it
    return max(PATIENCE * schedule.passes, LEAST_FOR_PATIENCE) if expected else schedule.passes


def promise(schedule: Schedule, goal: Goal, expected: bool) -> str:
    """What is about to be rendered, for the person who waits for it."""
    error = _error_in_words(schedule, goal)
    what = f"{passes_in_words((schedule.samples,) * schedule.passes)}, about {schedule.seconds:.1f} s, {error}"
    if expected:
        return f"chose {what}"
    return f"an error of {goal.error:g} is not expected to be reached; the best found: {what}"


def _error_in_words(schedule: Schedule, goal: Goal) -> str:
    """What a schedule is expected to come to."""
    if not schedule.trial.measured:
        return "error not foretold by so short a pilot"
    figure = goal.metric.figure(schedule.error)
    return f"error about {figure:.2g}" if figure > 0 else "error not foretold: the pilot saw no noise"
