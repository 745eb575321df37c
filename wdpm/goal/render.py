"""Renders until an error is reached or a time is up.

What a render by default chooses has as many samples as fit into a time (in_time.py), or as an error takes
(to_error.py). Where that will not do for an error, other settings are searched for (trial_pilot.py, searched.py).
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.clock import Budget
from wdpm.goal.default_passes import DefaultPasses
from wdpm.goal.goal import Goal
from wdpm.goal.in_time import TimedRender
from wdpm.goal.outcome import Found, Times, outcome_of
from wdpm.goal.searched import render_found
from wdpm.goal.stopped import Abandoned as Abandoned
from wdpm.goal.stopped import Interrupted as Interrupted
from wdpm.goal.stopped import raise_if_stopped
from wdpm.goal.to_error import RenderToError
from wdpm.goal.trial import Clock
from wdpm.goal.trial_pilot import ERROR_BEYOND_BIAS, TrialPilot
from wdpm.goal.workplace import Workplace
from wdpm.images.image import Image
from wdpm.images.view_transform import auto_exposure
from wdpm.progress import Progress, SilentProgress
from wdpm.rendering.backend import Backend
from wdpm.rendering.pass_average import PassAverage
from wdpm.rendering.prepare import Source, sound_scene_of
from wdpm.rendering.scene_settings import settings_for
from wdpm.scenes.errors import SettingsError

CHOSEN_HERE = frozenset({"passes", "spp", "pass_samples"})
"""Settings that cannot be given beside a goal."""

OUTCOME = "asked"
"""Name of the outcome in an image's metadata."""

WRITING_S = 0.3
WRITING_S_PER_PIXEL = 1.5e-6
"""Set aside of a time budget for the mean, its report and its files."""

ENDING_SHARE = 0.25
"""Of what starting took, that is set aside for the end as well: a machine that is busy is busy then, too."""


def render_until(
    source: Source,
    goal: Goal,
    backend: Backend,
    *,
    progress: Progress | None = None,
    used: float = 0.0,
    clock: Clock = time.perf_counter,
    **chosen: Any,
) -> Image:
    """Render a scene until its error is small enough, or time is up.

    Args:
        source: a scene, a file, the name of a built-in scene, or a function that gives a scene.
        used: of the goal's time before this call [s].
        clock: that costs are measured with [s]; CPU time, for one, on a machine that does other things, too.
        chosen: settings that are kept as they are, by name, see RenderSettings; all others are picked.
        Others are as of PassRenderer.

    Returns:
        The image; its metadata has what came of it as `asked` (goal.outcome.Outcome.to_dict).

    Raises:
        SceneError, SettingsError, ClusterError: see their messages.
        Interrupted: Ctrl-C, once a pass is done; it holds the image of the passes so far.
        Abandoned: a ClusterError, once a pass is done; it holds that image, too.
    """
    for name in CHOSEN_HERE & set(chosen):
        raise SettingsError(f"{name} is chosen by what until_error and time_budget ask for; leave one of them out")
    progress = progress or SilentProgress()
    budget = Budget(math.inf if goal.seconds is None else goal.seconds, used)
    scene = sound_scene_of(source)
    pixels = scene.camera.width * scene.camera.height
    budget.reserve = WRITING_S + WRITING_S_PER_PIXEL * pixels + ENDING_SHARE * used
    work, settings = Workplace(backend, progress, clock), settings_for(scene, **chosen)
    progress.start("pilot")
    passes = DefaultPasses(scene, settings, work, goal.metric, budget.left)
    if goal.error is None:
        return _render_in_time(TimedRender(passes), goal)
    pilot = TrialPilot(scene, settings, frozenset(chosen), work)
    if not is_searched_for(goal, settings):
        to_error = RenderToError(passes, goal, frozenset(chosen))
        image = _render_to_error(to_error)
        if image is not None:
            return image
        pilot.reference = to_error.reference
        progress.note("what maps of photons blur by default is too much for such an error: other settings are tried")
        passes.let_go()
    return _render_searched(pilot, goal, budget)


def is_searched_for(goal: Goal, settings: RenderSettings) -> bool:
    """Whether settings for an error are searched for, in place of what a render by default chooses.

    For a large error, which one sample of few photons may have; where somebody has chosen the integrator; and where
    sampling adapts to what many passes tell.
    """
    large = goal.metric.is_relative and goal.mean_square >= ERROR_BEYOND_BIAS
    return large or settings.adaptive or not settings.algorithm.stands_for_others


def _render_in_time(timed: TimedRender, goal: Goal) -> Image:
    """Render as by default, for as long as there is time."""
    passes, clock = timed.passes, timed.passes.work.clock
    began = clock()
    timed.begin()
    estimate = timed.finish()
    times = _times(passes, clock() - began, timed.planned)
    found = Found(estimate, passes.pass_samples, timed.ending, passes.why)
    return _with_outcome(passes.average, goal, found, times, timed.error)


def _render_to_error(to_error: RenderToError) -> Image | None:
    """Render as by default, until the error is small enough; None if no number of samples will do."""
    passes, clock = to_error.passes, to_error.passes.work.clock
    began = clock()
    to_error.begin()
    to_error.render()
    if to_error.is_too_biased and to_error.error is None and not passes.renderer.enough:
        return None
    times = _times(passes, clock() - began, to_error.planned)
    found = Found(to_error.estimate, passes.pass_samples, to_error.ending, passes.why)
    return _with_outcome(passes.average, to_error.goal, found, times, to_error.error)


def _render_searched(pilot: TrialPilot, goal: Goal, budget: Budget) -> Image:
    """Search for settings, and render with them."""
    pilot.run(goal, budget.left)
    searched = render_found(pilot, goal, budget)
    return _with_outcome(searched.average, goal, searched.found, searched.times, searched.error)


def _times(passes: DefaultPasses, seconds: float, planned: float) -> Times:
    """What things took, of a render of so many seconds."""
    before = passes.pilot_seconds + passes.compile_seconds
    return Times(max(seconds - before, 0.0), planned, passes.pilot_seconds, passes.compile_seconds)


def _with_outcome(average: PassAverage, goal: Goal, found: Found, times: Times, error: BaseException | None) -> Image:
    """The image, with what came of the goal; raised, where an error ended it."""
    image = average.image()
    outcome = outcome_of(goal, found, times, auto_exposure(image.pixels))
    image = replace(image, metadata={**image.metadata, OUTCOME: outcome.to_dict()})
    raise_if_stopped(error, image)
    return image
