"""The pilot of a search for an error: trials of a few kinds of passes, until the best of them is one that was tried.

What was not tried yet is guessed from what was. Trials that would cost more than they can save are not made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.goal.convergence import ConvergenceEstimator
from wdpm.goal.goal import Goal
from wdpm.goal.reference_pair import REFERENCE_SHARE, ReferencePair, has_reference, make_reference_pair
from wdpm.goal.schedule import FACTORS, Schedule, nearest, schedule_of, soonest, with_photons
from wdpm.goal.trial import Trial, try_out
from wdpm.goal.workplace import Workplace
from wdpm.rendering.pass_plan import plans_for
from wdpm.rendering.passes import PassRenderer
from wdpm.scenes.model.scene import Scene

FIRST_PHOTONS = 1 / 8
"""Of the first trial, as a share of the photons that a render has by default."""

PHOTON_FIELDS = frozenset({"photons", "caustic_photons", "volume_photons"})

MOST_TRIALS = 5

WORTH = 0.25
"""A trial may cost this share of what the render is expected to cost without it."""

GUESSED_SAMPLES = 40
"""What a trial of a kind that was not tried yet costs, in samples of the kind that was."""

PILOT_SHARE = 0.1
"""Of a time budget, at most; but for the first pass, which there has to be, and what goes before it."""

ERROR_BEYOND_BIAS = 0.03
"""relMSE asked for, from which on bias is not measured: by the photons of the first trial it is 0.01 at most, on twelve
scenes, and to measure it takes as long as such a render does. The estimate counts it as MOST_BIAS."""

LONG_S = 45.0
"""Of a time budget, from which on kernels of other kinds of passes may be compiled."""


@dataclass(eq=False)
class TrialPilot:
    """What is known of a scene before it is rendered.

    Attributes:
        settings: with what was chosen; fixed: names of these.
        reference: of bias; None where nothing is biased, or there was no time.
        trials: that were made.
        seconds: that all took, of the workplace's clock, without compiling.
        compile_seconds: that went by for compiling.
    """

    scene: Scene
    settings: RenderSettings
    fixed: frozenset[str]
    work: Workplace
    reference: ReferencePair | None = None
    trials: list[Trial] = field(default_factory=list)
    seconds: float = 0.0
    compile_seconds: float = 0.0
    _ready: PassRenderer | None = None  # of the last trial, as is the next
    _estimator: ConvergenceEstimator | None = None

    def renderer_for(self, schedule: Schedule) -> PassRenderer:
        """What renders a schedule: the renderer of its trial, if that was the last one and has passes as short."""
        settings = schedule.settings
        ready, self._ready = self._ready, None
        if ready is None or not schedule.ready:
            return self.work.renderer(self.scene, settings)
        ready.will_have(self.scene, [plan.spp for plan in plans_for(settings)])
        return ready

    def estimator_for(self, schedule: Schedule, goal: Goal) -> ConvergenceEstimator:
        """What estimates the error of a schedule's passes: that of the last trial, if all that it knows is of these."""
        tried, self._estimator = self._estimator, None
        if tried is not None and schedule.ready and schedule.passes >= tried.passes:
            return tried
        return self._new_estimator(schedule.settings, goal)

    def _new_estimator(self, settings: RenderSettings, goal: Goal) -> ConvergenceEstimator:
        camera = self.scene.camera
        return ConvergenceEstimator(
            (camera.height, camera.width, 3), goal.metric, settings.algorithm.biased, self.reference
        )

    def best(self, goal: Goal, seconds_left: float = math.inf) -> tuple[Schedule, bool]:
        """The schedule for a goal, and whether it is expected to reach the error.

        Args:
            seconds_left: for the passes.
        """
        last = self.trials[-1]
        if last.at_once is not None and last.ready:
            return schedule_of(last, 1, 1), True
        candidates = self._candidates()
        reaching = soonest(candidates, goal.mean_square)
        if reaching is not None and reaching.seconds <= seconds_left:
            return reaching, True
        if math.isfinite(seconds_left):
            return nearest(candidates, seconds_left), False
        # What the noise of a trial hides may be no bias at all, and more photons would not lessen it: passes tell.
        hopeful = soonest(candidates, goal.mean_square, likely=True)
        if hopeful is not None:
            return hopeful, True
        # Nothing reaches it: what has the least bias, until noise is small beside it.
        least = min(candidates, key=lambda trial: trial.likely_bias)
        fallback = soonest([replace(least, bias=0.0)], max(0.5 * least.likely_bias, goal.mean_square))
        return fallback or nearest([least], 100 * (least.pass_cost + least.sample_cost)), False

    def run(self, goal: Goal, seconds_left: Callable[[], float] = lambda: math.inf) -> None:
        """Make the reference and the trials that are worth it.

        Args:
            seconds_left: until a time budget is used up.
        """
        began = self.work.clock()
        allowed = seconds_left() * PILOT_SHARE
        until = seconds_left() - allowed if math.isfinite(allowed) else 0.0
        self._settle()
        if self._wants_a_reference(goal, seconds_left()):
            wanted = REFERENCE_SHARE * goal.mean_square
            self.reference = make_reference_pair(
                self.scene, self.settings, goal.metric, wanted, self.work.renderer, 0.5 * allowed
            )
        self._try(self._first(), goal, lambda: seconds_left() - until)
        for _ in range(MOST_TRIALS - 1):
            schedule, reached = self.best(goal, seconds_left())
            following = self._next(schedule, reached, goal, seconds_left(), seconds_left() - until)
            if following is None:
                break
            self._try(following, goal, lambda: seconds_left() - until)
        self.seconds = max(self.work.clock() - began - self.compile_seconds, 0.0)

    def _wants_a_reference(self, goal: Goal, seconds_left: float) -> bool:
        """Whether to render images without bias, to tell how large it is."""
        settings = self.settings
        by_photons = settings.algorithm.shoots_photons and settings.photons > 0
        large = goal.metric.is_relative and goal.mean_square >= ERROR_BEYOND_BIAS
        if large and not PHOTON_FIELDS & self.fixed:
            return False
        return self.reference is None and by_photons and has_reference(settings) and seconds_left > LONG_S

    def _settle(self) -> None:
        """Have a trial of its own decide which integrator it is, where that is open, for a render by default."""
        if not self.settings.algorithm.stands_for_others:
            return
        if "integrator" not in self.fixed:
            # Where nobody said, the search is among the ways to map photons: what they take and leave is known to it.
            self.settings = replace(self.settings, integrator=Integrator.PHOTONS)
            return
        prepared = self.work.renderer(self.scene, self.settings).prepared
        self.compile_seconds += prepared.seconds["compile"]
        self.work.progress.note(prepared.chose[0])
        found = prepared.settings
        self.settings = replace(self.settings, integrator=found.integrator, light_samples=found.light_samples)

    def _first(self) -> RenderSettings:
        algorithm = self.settings.algorithm
        if not algorithm.shoots_photons:
            return self.settings  # as they were given: a warning names what has no effect
        settings = replace(self.settings, indirect=algorithm.kinds_to_try(self.settings)[0])
        if PHOTON_FIELDS & self.fixed:
            return settings
        fewer: dict[str, Any] = {name: int(getattr(settings, name) * FIRST_PHOTONS) for name in sorted(PHOTON_FIELDS)}
        return replace(settings, **fewer)

    def _next(
        self, schedule: Schedule, reached: bool, goal: Goal, seconds_left: float, allowed: float
    ) -> RenderSettings | None:
        """Settings to try next; None if the schedule is good enough to go, or there is no time.

        Args:
            allowed: seconds that are left for the pilot.
        """
        mine = schedule.trial
        untried = all(mine is not trial for trial in self.trials)
        if untried and mine.cost < allowed and (not reached or self._is_worth_a_trial(schedule, goal)):
            return mine.settings
        kinds = self._kinds_left() if seconds_left > LONG_S else ()
        guess = mine.start + GUESSED_SAMPLES * mine.sample_cost
        if kinds and guess < allowed and (not reached or guess < WORTH * schedule.seconds):
            return replace(mine.settings, indirect=kinds[0])
        return None

    def _is_worth_a_trial(self, schedule: Schedule, goal: Goal) -> bool:
        """Whether a trial costs little beside the render, and less than it promises to save."""
        cost = schedule.trial.cost
        tried = soonest(self.trials, goal.mean_square)
        return cost < WORTH * schedule.seconds and (tried is None or cost < tried.seconds - schedule.seconds)

    def _kinds_left(self) -> Sequence[Indirect]:
        if not self.settings.algorithm.shoots_photons:
            return ()
        tried = {trial.settings.indirect for trial in self.trials}
        return [kind for kind in self.settings.algorithm.kinds_to_try(self.settings) if kind not in tried]

    def _candidates(self) -> list[Trial]:
        """All trials, and what they let expect of other numbers of photons."""
        # Nothing but a reference tells what fewer photons would spoil.
        free = not (PHOTON_FIELDS & self.fixed) and self.reference is not None
        found = {trial.settings: trial for trial in self.trials}
        for trial in self.trials:
            for factor in FACTORS if free else ():
                other = with_photons(trial, factor)
                found.setdefault(other.settings, other)
        return list(found.values())

    def _try(self, settings: RenderSettings, goal: Goal, seconds_left: Callable[[], float]) -> None:
        self._ready = None  # one scene in memory is enough
        self.trials[:] = [replace(trial, ready=False) for trial in self.trials]
        self._estimator = self._new_estimator(settings, goal)
        trial = try_out(
            self._renderer_of_a_trial(settings),
            settings,
            self._estimator,
            self.reference,
            self.work.clock,
            seconds_left,
            goal.mean_square,
        )
        self.compile_seconds += trial.compile_seconds
        self.trials.append(trial)

    def _renderer_of_a_trial(self, settings: RenderSettings) -> Callable[[], PassRenderer]:
        """Makes a renderer of short passes, and keeps it for the passes that may follow."""

        def make() -> PassRenderer:
            self._ready = self.work.renderer(self.scene, replace(settings, spp=1, passes=1))
            return self._ready

        return make
