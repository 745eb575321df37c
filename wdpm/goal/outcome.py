"""What came of asking for an error or a time: figures, and the reasons for what was chosen."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any, NamedTuple

from wdpm.goal.convergence import Estimate
from wdpm.goal.goal import Goal, Metric
from wdpm.goal.schedule import Schedule
from wdpm.images.comparison import RELATIVE_FLOOR
from wdpm.rendering.pass_plan import passes_in_words
from wdpm.report.report import ErrorFigure
from wdpm.scenes.errors import ClusterError

DARK_STOPS = 3.0
"""More than so many stops too dark, most of a picture's radiance squared is below what relMSE adds to it."""


class Ending(Enum):
    """What ends the passes of a render that is asked for an error or a time."""

    DONE = "done"
    """The error was reached, or as many passes were made as could be expected to reach it."""
    OUT_OF_TIME = "out of time"
    INTERRUPTED = "interrupted"
    LOST = "slaves lost"

    @classmethod
    def of(cls, error: BaseException) -> Ending:
        """What ends passes by such an error."""
        return cls.LOST if isinstance(error, ClusterError) else cls.INTERRUPTED


class Times(NamedTuple):
    """What things took [s]: all passes, as foretold and in fact, the pilot, and compiling."""

    passes: float
    predicted: float
    pilot: float
    compiling: float


class Found(NamedTuple):
    """What came of passes; see Outcome. `expected` is in the goal's metric."""

    estimate: Estimate | None
    pass_samples: tuple[int, ...]
    ending: Ending
    why: str
    expected: float = math.nan


@dataclass(frozen=True)
class Outcome:
    """Of a render that was asked for an error or a time.

    Attributes:
        goal: what was asked for.
        estimate: of the error, in the goal's metric, with an interval of 80 %; None if there were too few passes.
        noise, bias: parts of the estimate, as mean squares (the weighted ones, for relMSE).
        most_bias: upper end of that bias; where nothing was rendered to measure it, what it is at most by experience.
        reached: whether the upper end of the estimate is within the error asked for; True if none was.
        ending: what ended it.
        pass_samples: samples of a pixel in each pass that was rendered.
        seconds: of the passes; predicted_seconds: the same, as the pilot told; pilot_seconds: of the pilot.
        compile_seconds: that went by for compiling.
        stops: of exposure that would show the image as it should be seen.
        expected: error that the chosen settings were expected to reach, in the goal's metric; not a number where none
            was foretold.
        why: what was chosen, and for what reason.
    """

    goal: Goal
    estimate: ErrorFigure | None
    noise: float
    bias: float
    most_bias: float
    reached: bool
    ending: Ending
    pass_samples: tuple[int, ...]
    seconds: float
    predicted_seconds: float
    pilot_seconds: float
    compile_seconds: float
    stops: float
    expected: float
    why: str

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        goal = asdict(self.goal) | {"metric": self.goal.metric.value}
        figures = {name: _finite_or_none(value) for name, value in asdict(self).items()}
        return figures | {"goal": goal, "ending": self.ending.value, "lines": self.lines()}

    def lines(self) -> list[str]:
        """For people."""
        goal, name = self.goal, NAMES[self.goal.metric]
        found = [f"chose {self.why}"]
        if self.estimate is None:
            passes = len(self.pass_samples)
            few = "one pass is" if passes == 1 else f"{passes} passes are"
            found.append(f"{name} not known: {few} too few to tell")
        else:
            e = self.estimate
            found.append(
                f"{name} about {e.value:.3g}, in 9 of 10 cases below {e.high:.3g} "
                f"(noise {self.noise:.2g}, squared bias {self.bias:.2g}, at most {self.most_bias:.2g}); the render "
                "stops by this estimate, which allows for rare light that no pass may have met"
            )
        if goal.metric.is_relative and self.stops > DARK_STOPS:
            found.append(self._dark())
        found.append(
            f"{passes_in_words(self.pass_samples)} in {self.seconds:.1f} s ({self.predicted_seconds:.1f} s "
            f"predicted), after a pilot of {self.pilot_seconds:.1f} s and {self.compile_seconds:.1f} s of compiling"
        )
        if self.ending in (Ending.INTERRUPTED, Ending.LOST):
            found.append(f"{self.ending.value.upper()}: the image is the best so far")
        elif not self.reached:
            found.append(
                f"NOT REACHED: {name} {goal.error:g} was asked for; {self._obstacle()}. The image is the best so far."
            )
        return found

    def _dark(self) -> str:
        """That the figure says little, and which one would."""
        found = (
            f"the picture is {self.stops:.1f} stops too dark to be seen as it is, and relMSE, which adds "
            f"{RELATIVE_FLOOR:g} to squares of radiance, hardly sees errors in it"
        )
        if self.goal.error is None:
            return found
        same = self.goal.error / 4.0**self.stops
        return f"{found}: what {self.goal.error:g} is in a picture as bright as others, {same:.1g} is here"

    def _obstacle(self) -> str:
        """Why the error was not reached, and what may help."""
        if self.ending is Ending.OUT_OF_TIME:
            return "time was up"
        if not self.noise > self.bias:
            found = "what is left is mostly bias, which more passes lessen slowly"
            return f"{found}: try more photons, or --integrator path, which has none"
        times = math.ceil(self.noise / max(self.goal.mean_square, 1e-300))
        if times > 1000:
            return "what is left is mostly noise, and so small an error is out of reach"
        return f"what is left is mostly noise: some {max(times, 2)} times the samples would reach it"


def _finite_or_none(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


NAMES = {Metric.RELMSE: "relMSE", Metric.RMSE: "RMSE"}


def in_metric(metric: Metric, figure: ErrorFigure) -> ErrorFigure:
    """A figure of mean squares in the metric's own terms."""
    return ErrorFigure(metric.figure(figure.value), metric.figure(figure.low), metric.figure(figure.high))


def outcome_of(goal: Goal, found: Found, times: Times, stops: float = 0.0) -> Outcome:
    """From what was measured."""
    estimate = found.estimate
    return Outcome(
        goal=goal,
        estimate=None if estimate is None else in_metric(goal.metric, estimate.total),
        noise=math.nan if estimate is None else estimate.noise.value,
        bias=math.nan if estimate is None else estimate.bias.value,
        most_bias=math.nan if estimate is None else estimate.bias.high,
        reached=goal.error is None or (estimate is not None and estimate.total.high <= goal.mean_square),
        ending=found.ending,
        pass_samples=found.pass_samples,
        stops=stops,
        expected=found.expected,
        why=found.why,
        seconds=times.passes,
        predicted_seconds=times.predicted,
        pilot_seconds=times.pilot,
        compile_seconds=times.compiling,
    )


def reasons(schedule: Schedule) -> str:
    """What was chosen, and why, in words."""
    settings, trial = schedule.settings, schedule.trial
    kind = settings.algorithm.in_words(settings)
    if settings.algorithm.shoots_photons:
        kind += f", {settings.photons:,} photons a pass"
    kind += f", {schedule.samples} sample{'s' * (schedule.samples != 1)} a pass"
    if not trial.measured:
        return f"{kind}, which took {trial.sample_cost:.2g} s with one: there was no time to see how noise falls"
    return (
        f"{kind}: a pass costs {trial.pass_cost:.2g} s and "
        f"{trial.sample_cost:.2g} s a sample, with mean squares of noise {trial.pass_noise:.2g} and "
        f"{trial.sample_noise:.2g} a sample, and "
        f"squared bias of at most {trial.bias:.2g}"
    )
