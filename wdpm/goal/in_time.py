"""As good an image as a render by default has, in a time: what that chooses, and as many samples as fit.

One pass of all samples would do, if anyone knew how many fit. So the first pass has as many as are likely to take a
part of the time, and tells what passes take. What is left is shared by a few more, so few that photons of their own,
which each of them traces, take little of it; each has as many samples as its share of the time has room for, by what
those before took, and the last takes what is left.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from wdpm.goal.convergence import Estimate
from wdpm.goal.default_passes import DefaultPasses
from wdpm.goal.outcome import Ending
from wdpm.scenes.errors import ClusterError

FIRST_SHARE = 0.25
"""Of the time, what the first pass is to take."""

FEW, MOST_OF_FEW = 2, 0.5
"""Samples that the first pass has at least, if they are likely to take no more than such a share of the time. What a
pass of one sample takes is to half what every pass takes, which would be taken to grow with the samples."""

BEYOND_FIRST = 2
"""So many times the samples of the first pass all is chosen for. The others have up to five times as many, since those
of the first are fewer than would fit; but each has photons of its own, and the image has those of all. Chosen for four
times as many, sponza had 1.35 times the error after 12 CPU seconds (256x256, without the worst 0.1 % of pixels), envmap
1.23, uplight-room 1.0, and materials 0.93."""

LEAST_CHOSEN_FOR = 4
"""Samples of a pass. Where the first has but one, the machine was busy, or others take much of the time."""

BESIDE_SHARE = 0.1
"""Of the time, what passes may take for anything but their samples: photons, maps, and places of records."""

USUAL_PASSES, LONGEST_PASS_S = 3, 30.0
"""After the first, at most. More would have records of fewer rays, whose noise samples do not lessen; but each shows
how far the image has come, and Ctrl-C loses no more than one of them."""


@dataclass(eq=False)
class TimedRender:
    """A render that is over when its time is.

    Attributes:
        passes: that it has.
        planned: seconds that all of them are to take, from the first on.
        ending, error: what ended it; the error is None if nothing went wrong.
    """

    passes: DefaultPasses
    planned: float = 0.0
    ending: Ending = Ending.DONE
    error: BaseException | None = None

    def begin(self) -> None:
        """Choose settings as for a pass of so many samples as the first is to have, and render it."""
        passes = self.passes
        samples = max(passes.samples_of_first(FIRST_SHARE), min(passes.samples_of_first(MOST_OF_FEW), FEW))
        passes.choose(samples, max(BEYOND_FIRST * samples, LEAST_CHOSEN_FOR))
        self.planned = max(passes.seconds_left(), 0.0)
        passes.begin()
        passes.render(samples)
        passes.work.progress.note(f"chose {passes.why}")

    def finish(self) -> Estimate | None:
        """Render passes until the time is up, or someone has enough, or presses Ctrl-C, or the cluster is lost.

        Returns:
            What is known of the error of their mean.
        """
        to_go = self._passes_to_go()
        self.passes.show_passes(to_go)
        try:
            for samples in self._samples(to_go):
                self.passes.render(samples)
                if self.passes.renderer.enough:
                    break
            else:
                self.ending = Ending.OUT_OF_TIME
        except (KeyboardInterrupt, ClusterError) as error:
            self.ending, self.error = Ending.of(error), error
        self.passes.close()
        return self.passes.estimator.estimate()

    def _passes_to_go(self) -> int:
        """After the first, how many share the time that is left."""
        left, costs = max(self.passes.seconds_left(), 0.0), self.passes.costs
        beside = costs.fixed + costs.records
        cheap = int(BESIDE_SHARE * left / beside) if beside > 0 else USUAL_PASSES
        return max(min(cheap, USUAL_PASSES), int(left / LONGEST_PASS_S), 1)

    def _samples(self, to_go: int) -> Iterator[int]:
        """Of pass after pass, as long as one is worth it."""
        while True:
            samples = self.passes.samples_that_fit(to_go) or self.passes.samples_that_fit(1)
            if not self.passes.is_worth_a_pass(samples):
                return
            yield samples
            to_go = max(to_go - 1, 1)
