"""Passes of what a render by default chooses, as many and of as many samples as turn out to be needed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.clock import idle_share
from wdpm.goal.convergence import MOST_BIAS, ConvergenceEstimator
from wdpm.goal.goal import Metric
from wdpm.goal.pass_costs import PassCosts
from wdpm.goal.reference_pair import ReferencePair
from wdpm.goal.workplace import Workplace
from wdpm.rendering.adaptive import weight_of
from wdpm.rendering.pass_plan import PassPlan, shrink
from wdpm.rendering.pass_progress import PassProgress
from wdpm.rendering.passes import PassAverage, PassRenderer
from wdpm.scenes.model.scene import Scene

SAMPLE_S = 1e-5
"""What a sample takes of a core, with its part of photons and records: on eleven scenes a third to four fifths of that.
Where a machine is four times as slow, or as busy, the first pass still is done before the time is up."""

TRIANGLE_S = 6e-6
"""What a triangle takes before the first pass, most of it on one core: to be cut, and put into trees."""

MOST_OF_FIRST = 64
"""Samples of the first pass, at most: an image is to be seen soon."""

MOST_SAMPLES = 4096
"""A pixel, of a pass."""

SURE = 0.93
"""Of the time that is left, what the last pass is planned to take: it may take longer than those before it."""

LEAST_GAIN = 0.05
"""Of the samples so far, how many more are worth another pass."""


@dataclass(eq=False)
class DefaultPasses:
    """Passes of one render, and their mean.

    Args:
        settings: passes and samples are open; and the integrator, if that chooses itself.
        seconds_left: until its time is up, at any moment; of a clock that goes on while it renders.

    Attributes:
        renderer: of the passes.
        average: of those that are done; costs: of the last of them; estimator: of their error.
        why: what was chosen, in words.
        pilot_seconds: that went by before the first, to choose settings; compile_seconds: for compiling besides.
    """

    scene: Scene
    settings: RenderSettings
    work: Workplace
    metric: Metric
    seconds_left: Callable[[], float]
    renderer: PassRenderer = field(init=False)
    average: PassAverage = field(init=False)
    estimator: ConvergenceEstimator = field(init=False)
    costs: PassCosts = field(init=False)
    why: str = ""
    pilot_seconds: float = 0.0
    compile_seconds: float = 0.0

    def choose(self, samples: int, usual: int) -> None:
        """Choose settings for a first pass of so many samples, where passes are likely to have as many as `usual`."""
        began = self.work.clock()
        self.let_go()
        settings = replace(self.settings, spp=samples, passes=1, pass_samples=(samples,))
        if settings.plan_samples is None:
            settings = replace(settings, plan_samples=usual)
        self.renderer = self.work.renderer(self.scene, settings)
        prepared = self.renderer.prepared
        taken = self.work.clock() - began
        compiled = min(prepared.seconds["compile"], taken)  # the clock may be that of the CPU
        self.compile_seconds += compiled
        self.pilot_seconds += taken - compiled
        self.why = prepared.chose[0] if prepared.chose else prepared.settings.algorithm.in_words(prepared.settings)

    def let_go(self) -> None:
        """Of the scene, as it was chosen so far: one in memory is enough."""
        self.__dict__.pop("renderer", None)

    def begin(self, reference: ReferencePair | None = None, most_bias: float = MOST_BIAS) -> None:
        """Be ready for the first pass.

        Args:
            reference: of the bias; most_bias: what it is at most by experience, where there is none (convergence.py).
        """
        prepared = self.renderer.prepared
        self.average = PassAverage(prepared)
        camera = self.scene.camera
        shape, biased = (camera.height, camera.width, 3), prepared.settings.algorithm.biased
        self.estimator = ConvergenceEstimator(shape, self.metric, biased, reference, most_bias)

    def render(self, samples: int) -> None:
        """Render the next pass, and add it to the image."""
        before, plans = self._now(), self.average.plans
        first = plans[-1].first_sample + plans[-1].spp if plans else 0
        plan = PassPlan(len(plans), first, samples)
        result = self.renderer.render(plan, self.average.allotment(plan))
        self.average.add(result)
        camera = self.scene.camera
        weight = weight_of(plan, result.allotment, camera.width, camera.height)
        self.estimator.add(result.layers, weight, shrink(plan.number))
        self.renderer.show(self.average)
        known = self.costs if plans else None
        self.costs = PassCosts.measured(samples, self._now() - before, result.seconds, known)

    def _now(self) -> float:
        """Of the clock by which the time is up; where none is, of that which costs are measured with [s]."""
        left = self.seconds_left()
        return -left if math.isfinite(left) else self.work.clock()

    def show_passes(self, more: int) -> None:
        """Be told how many passes are still to come, which from now on show as such."""
        camera, bucket = self.scene.camera, self.renderer.prepared.session.view.bucket
        buckets = -(-camera.width // bucket) * -(-camera.height // bucket)
        self.renderer.progress = PassProgress(self.work.progress, buckets, more)

    def close(self) -> None:
        """Have the image say of itself how many samples its passes had."""
        self.renderer.will_have(self.scene, self.pass_samples)

    @property
    def pass_samples(self) -> tuple[int, ...]:
        """Of a pixel, in each pass that is done."""
        return tuple(plan.spp for plan in self.average.plans)

    def samples_of_first(self, share: float) -> int:
        """That are likely to take such a share of the time, whatever the scene."""
        pixels = self.scene.camera.width * self.scene.camera.height
        backend, triangles = self.work.backend, sum(len(mesh.faces) for mesh in self.scene.meshes)
        elsewhere = backend.slaves > 0 and not backend.processes
        cores = backend.slaves if elsewhere else (backend.slaves or backend.threads) * idle_share()
        seconds = share * max(self.seconds_left() - TRIANGLE_S * triangles, 0.0)
        return int(min(max(seconds * cores / (SAMPLE_S * pixels), 1), MOST_OF_FIRST))

    def samples_that_fit(self, passes: int = 1) -> int:
        """The most samples of a pass that has room in the time that is left, or in its share of it."""
        left = self.seconds_left()
        if not math.isfinite(left):
            return MOST_SAMPLES
        return self.costs.samples_in(left / passes if passes > 1 else SURE * left, MOST_SAMPLES)

    def is_worth_a_pass(self, samples: int) -> bool:
        """Whether so many samples would be seen beside those that are there."""
        return samples >= max(LEAST_GAIN * self.average.spp, 1)
