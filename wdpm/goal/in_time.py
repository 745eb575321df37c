"""As good an image as a render by default has, in a time: what that chooses, and as many samples as fit.

One pass of all samples would do, if anyone knew how many fit. So the first pass has as many as are likely to take a
part of the time, and tells what passes take. What is left is shared by a few more, so few that photons of their own,
which each of them traces, take little of it; each has as many samples as its share of the time has room for, by what
those before took, and the last takes what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.clock import idle_share
from wdpm.goal.convergence import ConvergenceEstimator, Estimate
from wdpm.goal.goal import Metric
from wdpm.goal.outcome import Ending
from wdpm.goal.pass_costs import PassCosts
from wdpm.goal.workplace import Workplace
from wdpm.rendering.adaptive import weight_of
from wdpm.rendering.pass_plan import PassPlan, shrink
from wdpm.rendering.pass_progress import PassProgress
from wdpm.rendering.passes import PassAverage, PassRenderer
from wdpm.scenes.errors import ClusterError
from wdpm.scenes.model.scene import Scene

FIRST_SHARE = 0.25
"""Of the time, what the first pass is to take."""

SAMPLE_S = 1e-5
"""What a sample takes of a core, with its part of photons and records: on eleven scenes a third to four fifths of that.
Where a machine is four times as slow, or as busy, the first pass still is done before the time is up."""

TRIANGLE_S = 6e-6
"""What a triangle takes before the first pass, most of it on one core: to be cut, and put into trees."""

MOST_OF_FIRST = 64
"""Samples of the first pass, at most: an image is to be seen soon."""

BESIDE_SHARE = 0.1
"""Of the time, what passes may take for anything but their samples: photons, maps, and places of records."""

USUAL_PASSES, LONGEST_PASS_S = 3, 30.0
"""After the first, at most. More would have records of fewer rays, whose noise samples do not lessen; but each shows
how far the image has come, and Ctrl-C loses no more than one of them."""

SURE = 0.93
"""Of the time that is left, what the last pass is planned to take: it may take longer than those before it."""

LEAST_GAIN = 0.05
"""Of the samples so far, how many more are worth another pass."""

MOST_SAMPLES = 4096
"""A pixel, of a pass."""


@dataclass(eq=False)
class TimedRender:
    """A render that is over when its time is.

    Args:
        settings: passes and samples are open; and the integrator, if that chooses itself.
        seconds_left: until its time is up, at any moment; of a clock that goes on while it renders.

    Attributes:
        renderer: of its passes.
        average: of those that are done.
        costs: of the last of them.
        why: what was chosen, in words.
        planned: seconds that all passes are to take, from the first on.
        pilot_seconds: that went by before the first, to choose settings; compile_seconds: for compiling besides.
        ending, error: what ended it; the error is None if nothing went wrong.
    """

    scene: Scene
    settings: RenderSettings
    work: Workplace
    metric: Metric
    seconds_left: Callable[[], float]
    renderer: PassRenderer = field(init=False)
    average: PassAverage = field(init=False)
    costs: PassCosts = field(init=False)
    why: str = ""
    planned: float = 0.0
    pilot_seconds: float = 0.0
    compile_seconds: float = 0.0
    ending: Ending = Ending.DONE
    error: BaseException | None = None
    _estimator: ConvergenceEstimator = field(init=False)

    def begin(self) -> None:
        """Choose settings as for a pass of so many samples as the first is to have, and render it."""
        began, samples = self.work.clock(), self._samples_of_first()
        settings = replace(self.settings, spp=samples, passes=1, pass_samples=(samples,))
        self.renderer = self.work.renderer(self.scene, settings)
        prepared = self.renderer.prepared
        self.compile_seconds = prepared.seconds["compile"]
        self.pilot_seconds = max(self.work.clock() - began - self.compile_seconds, 0.0)
        self.planned = max(self.seconds_left(), 0.0)
        self.why = prepared.chose[0] if prepared.chose else prepared.settings.algorithm.in_words(prepared.settings)
        self.average = PassAverage(prepared)
        camera = self.scene.camera
        shape, biased = (camera.height, camera.width, 3), prepared.settings.algorithm.biased
        self._estimator = ConvergenceEstimator(shape, self.metric, biased)
        self._render(samples)
        self.work.progress.note(f"chose {self.why}")

    def finish(self) -> Estimate | None:
        """Render passes until the time is up, or someone has enough, or presses Ctrl-C, or the cluster is lost.

        Returns:
            What is known of the error of their mean.
        """
        to_go = self._passes_to_go()
        camera, bucket = self.scene.camera, self.renderer.prepared.session.view.bucket
        buckets = -(-camera.width // bucket) * -(-camera.height // bucket)
        self.renderer.progress = PassProgress(self.work.progress, buckets, to_go)
        try:
            for samples in self._samples(to_go):
                self._render(samples)
                if self.renderer.enough:
                    break
            else:
                self.ending = Ending.OUT_OF_TIME
        except (KeyboardInterrupt, ClusterError) as error:
            self.ending = Ending.LOST if isinstance(error, ClusterError) else Ending.INTERRUPTED
            self.error = error
        self.renderer.will_have(self.scene, self.pass_samples)
        return self._estimator.estimate()

    @property
    def pass_samples(self) -> tuple[int, ...]:
        """Of a pixel, in each pass that is done."""
        return tuple(plan.spp for plan in self.average.plans)

    def _samples_of_first(self) -> int:
        """That are likely to take FIRST_SHARE of the time, whatever the scene."""
        pixels = self.scene.camera.width * self.scene.camera.height
        backend, triangles = self.work.backend, sum(len(mesh.faces) for mesh in self.scene.meshes)
        elsewhere = backend.slaves > 0 and not backend.processes
        cores = backend.slaves if elsewhere else (backend.slaves or backend.threads) * idle_share()
        seconds = FIRST_SHARE * max(self.seconds_left() - TRIANGLE_S * triangles, 0.0)
        return min(max(int(seconds * cores / (SAMPLE_S * pixels)), 1), MOST_OF_FIRST)

    def _render(self, samples: int) -> None:
        """Render the next pass, and add it to the image."""
        before, plans = self.seconds_left(), self.average.plans
        first = plans[-1].first_sample + plans[-1].spp if plans else 0
        plan = PassPlan(len(plans), first, samples)
        result = self.renderer.render(plan, self.average.allotment(plan))
        self.average.add(result)
        camera = self.scene.camera
        weight = weight_of(plan, result.allotment, camera.width, camera.height)
        self._estimator.add(result.layers, weight, shrink(plan.number))
        self.renderer.show(self.average)
        known = self.costs if plans else None
        self.costs = PassCosts.measured(samples, before - self.seconds_left(), result.seconds, known)

    def _passes_to_go(self) -> int:
        """After the first, how many share the time that is left."""
        left = max(self.seconds_left(), 0.0)
        beside = self.costs.fixed + self.costs.records
        cheap = int(BESIDE_SHARE * left / beside) if beside > 0 else USUAL_PASSES
        return max(min(cheap, USUAL_PASSES), int(left / LONGEST_PASS_S), 1)

    def _samples_of_next(self, to_go: int) -> int:
        """That have room in the share of the next of so many passes."""
        left = self.seconds_left()
        return self.costs.samples_in(left / to_go if to_go > 1 else SURE * left, MOST_SAMPLES)

    def _samples(self, to_go: int) -> Iterator[int]:
        """Of pass after pass, as long as one is worth it."""
        while True:
            samples = self._samples_of_next(to_go) or self._samples_of_next(1)
            if samples < max(LEAST_GAIN * self.average.spp, 1):
                return
            yield samples
            to_go = max(to_go - 1, 1)
