"""An image whose error is small enough: what a render by default chooses, in as few passes as tell that it is.

Two passes of equally many samples tell what the error of their mean is (convergence.py). As many as the plan's trial
expects to do are rendered first. Where they do not, the estimate says how many more are needed, and so on until it is
within what was asked for: three or four passes in all, each of which makes its photons and its records but once.

What photon maps blur is no more than LEFT_BY_DEFAULT with the photons, and by the ways, that a render by default takes.
Where that is much beside the error asked for, or somebody has chosen photons, path-traced images measure it
(reference_pair.py). Where it is too large, other settings are searched for (trial_pilot.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from wdpm.goal.convergence import MOST_BIAS, Estimate
from wdpm.goal.default_passes import MOST_OF_FIRST, MOST_SAMPLES, DefaultPasses
from wdpm.goal.goal import Goal
from wdpm.goal.outcome import Ending
from wdpm.goal.reference_pair import REFERENCE_SHARE, ReferencePair, has_reference, make_reference_pair
from wdpm.goal.samples_needed import BIAS_SHARE, samples_by_estimate, samples_by_trial
from wdpm.goal.trial_pilot import PHOTON_FIELDS
from wdpm.scenes.errors import ClusterError

LEFT_BY_DEFAULT = 0.0005
"""relMSE of bias alone, by the settings that a render by default chooses: on twelve scenes 0.0004 at most, the noise of
their references included (the product of two images' errors, in squares of 4 x 4 pixels)."""

REFERENCE_BELOW = 4.0
"""Times LEFT_BY_DEFAULT: smaller errors are worth a measurement of the bias."""

CHOSEN_AGAIN = 1.5
"""A plan is made anew if a first pass is to have as many times the samples that it was made for, or as many fewer."""

FIRST_SHARE = 0.25
"""Of a time budget, what the first pass is to take at most."""

REFERENCE_OF_TIME = 0.05
"""Of a time budget, what a reference may take."""

SPLIT = 4
"""A pass of more than so many times the samples of each pass before is made two, whose difference tells the noise of
what is most of the image then."""

CHANGE_BIAS = PHOTON_FIELDS | {"k", "radius", "caustic_k", "caustic_radius", "volume_radius", "indirect"}
"""Settings by which the bias is not that of a render by default."""

PATIENCE = 4
LEAST_FOR_PATIENCE = 32
"""As many times the samples that were expected are rendered, and as many at least, before an error counts as out of
reach."""

MOST_IN_ALL = 1 << 16
"""Samples a pixel. Errors that are expected to take more are out of reach: some are rendered, and that is told."""


@dataclass(eq=False)
class RenderToError:
    """A render that is over when its error is small enough.

    Args:
        passes: that it has.
        fixed: names of settings that somebody has chosen.

    Attributes:
        reference: of the bias, where it is measured.
        planned: seconds that all passes were expected to take once the first two had told; their own, if these do.
        estimate: of the error of the mean.
        ending, error: what ended it; the error is None if nothing went wrong.
    """

    passes: DefaultPasses
    goal: Goal
    fixed: frozenset[str]
    reference: ReferencePair | None = None
    planned: float = 0.0
    estimate: Estimate | None = None
    ending: Ending = Ending.DONE
    error: BaseException | None = None
    _first: int = 1  # samples of each of the first two passes

    def begin(self) -> None:
        """Choose settings, and how many samples the first two passes have; measure bias, if that is called for."""
        passes, mean_square = self.passes, self.goal.mean_square
        guess = self._of_first(samples_by_trial(None, mean_square))
        passes.choose(guess, guess)
        prepared = passes.renderer.prepared
        noise = prepared.noise if self.goal.metric.is_relative else None
        self._first = self._of_first(samples_by_trial(noise, mean_square))
        is_measured = self._needs_a_reference()
        if is_measured:
            self._measure_bias()
        if is_measured or max(self._first, guess) > CHOSEN_AGAIN * min(self._first, guess):
            passes.choose(self._first, self._first)
        else:
            self._first = guess
        passes.begin(self.reference, MOST_BIAS if is_measured else LEFT_BY_DEFAULT)

    def render(self) -> None:
        """Render passes until the error is small enough, or out of reach, or the time is up, or someone has enough, or
        presses Ctrl-C, or the cluster is lost.

        Raises:
            KeyboardInterrupt, ClusterError: before the first pass was done.
        """
        passes = self.passes
        try:
            for samples in self._samples():
                passes.render(samples)
                if passes.renderer.enough:
                    break
        except (KeyboardInterrupt, ClusterError) as error:
            if not passes.pass_samples:
                raise
            self.ending, self.error = Ending.of(error), error
        self.estimate = passes.estimator.estimate()
        passes.close()

    @property
    def reached(self) -> bool:
        """Whether the error is known to be small enough."""
        return self.estimate is not None and self.estimate.total.high <= self.goal.mean_square

    @property
    def is_too_biased(self) -> bool:
        """Whether no number of samples will do, as far as is known."""
        return self.is_too_biased_for(self.goal)

    def is_too_biased_for(self, goal: Goal) -> bool:
        """The same, of another error."""
        most = BIAS_SHARE * goal.mean_square
        return self.reference is not None and self.estimate is not None and self.estimate.bias.low > most

    def foretell(self, goal: Goal) -> tuple[tuple[int, ...], float]:
        """Samples of each pass that another error is likely to take, and seconds of these, once two passes are done."""
        passes, estimate = self.passes, self.estimate
        assert estimate is not None, "two passes tell it"
        done, costs = passes.average.spp, passes.costs
        share = estimate.total.high / goal.mean_square
        if share <= 1.0:
            each = max(math.ceil(share * self._first), 1)
            return (each, each), 2 * costs.seconds(each)
        needed = samples_by_estimate(estimate, done, goal.mean_square, math.inf)
        more = self._split(needed - done)
        return (*passes.pass_samples, *more), sum(map(costs.seconds, (*passes.pass_samples, *more)))

    def render_pair(self) -> None:
        """Render no more than the first two passes."""
        for _ in range(2):
            self.passes.render(self._first)
        self.estimate = self.passes.estimator.estimate()

    def _of_first(self, wanted: float) -> int:
        """Samples of each of the first two passes, where so many are likely to do."""
        most = MOST_OF_FIRST
        if math.isfinite(self.passes.seconds_left()):
            most = self.passes.samples_of_first(FIRST_SHARE)
        return max(min(round(wanted / 2.0), most), 1)

    def _needs_a_reference(self) -> bool:
        """Whether to measure bias: where there is any, and it is not known to be small beside the error asked for."""
        settings = self.passes.renderer.prepared.settings
        if not settings.algorithm.biased or not has_reference(settings):
            return False
        is_known = self.goal.metric.is_relative and not self.fixed & CHANGE_BIAS
        return not is_known or self.goal.mean_square < REFERENCE_BELOW * LEFT_BY_DEFAULT

    def _measure_bias(self) -> None:
        """Render what tells it."""
        passes, goal = self.passes, self.goal
        settings, began = passes.renderer.prepared.settings, passes.work.clock()
        passes.let_go()
        wanted, most = REFERENCE_SHARE * goal.mean_square, REFERENCE_OF_TIME * passes.seconds_left()
        make = passes.work.renderer
        self.reference = make_reference_pair(passes.scene, settings, goal.metric, wanted, make, most)
        passes.pilot_seconds += passes.work.clock() - began

    def _samples(self) -> Iterator[int]:
        """Of pass after pass."""
        passes, began = self.passes, self.passes.work.clock()
        yield self._first
        passes.show_passes(1)
        yield from self._fitting([self._first])
        most = math.inf
        while self.ending is Ending.DONE:
            self.estimate = passes.estimator.estimate()
            done = passes.average.spp
            if self.planned == 0.0:
                self.planned = passes.work.clock() - began
            if self.estimate is None or self.reached or self.is_too_biased or done >= most:
                return
            needed = samples_by_estimate(self.estimate, done, self.goal.mean_square)
            following = self._split(max(needed - done, 1))
            if most == math.inf:
                expected = samples_by_estimate(self.estimate, done, self.goal.mean_square, math.inf)
                is_expected = expected <= MOST_IN_ALL
                most = max(PATIENCE * expected, LEAST_FOR_PATIENCE) if is_expected else needed
                self._promise(self._split(expected - done) if is_expected else following, is_expected)
            passes.show_passes(len(following))
            yield from self._fitting(following)

    def _split(self, samples: int) -> list[int]:
        """Passes of so many samples together."""
        if samples > SPLIT * max(self.passes.pass_samples):
            samples = min(-(-samples // 2), MOST_SAMPLES)
            return [samples, samples]
        return [samples]

    def _fitting(self, following: list[int]) -> Iterator[int]:
        """The same, as far as there is time."""
        for samples in following:
            fits = self.passes.samples_that_fit()
            if fits < samples:
                self.ending = Ending.OUT_OF_TIME
                if self.passes.is_worth_a_pass(fits):
                    yield fits
                return
            yield samples

    def _promise(self, following: list[int], is_expected: bool) -> None:
        """Say what is about to be rendered, to the person who waits for it."""
        passes = self.passes
        self.planned += sum(map(passes.costs.seconds, following))
        samples = sum((*passes.pass_samples, *following))
        words = f"{passes.why}: some {samples:,} samples a pixel, about {self.planned:.1f} s"
        hope = "chose" if is_expected else f"an error of {self.goal.error:g} is not expected to be reached; chose"
        passes.work.progress.note(f"{hope} {words}")
