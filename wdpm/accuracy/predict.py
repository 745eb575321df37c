"""What errors cost on a scene and a machine, told before anything but a pilot and two passes are rendered."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.default_passes import DefaultPasses
from wdpm.goal.goal import Goal, Metric
from wdpm.goal.outcome import NAMES
from wdpm.goal.render import is_searched_for
from wdpm.goal.schedule import Schedule
from wdpm.goal.to_error import RenderToError
from wdpm.goal.trial_pilot import TrialPilot
from wdpm.goal.workplace import Workplace
from wdpm.rendering.pass_plan import passes_in_words
from wdpm.rendering.scene_settings import settings_for
from wdpm.report.tables import format_seconds
from wdpm.scenes.model.scene import Scene

if TYPE_CHECKING:
    from rich.console import Console

TARGETS = (0.1, 0.05, 0.02, 0.01, 0.005)


@dataclass(frozen=True)
class Foretold:
    """What an error is expected to take.

    Attributes:
        seconds: of all passes.
        pass_samples: of a pixel, of each of them.
        settings: that are chosen.
    """

    seconds: float
    pass_samples: tuple[int, ...]
    settings: RenderSettings

    @classmethod
    def of(cls, schedule: Schedule) -> Foretold:
        """What a search foretells."""
        return cls(schedule.seconds, (schedule.samples,) * schedule.passes, schedule.settings)


@dataclass(frozen=True, eq=False)
class Predictions:
    """Of several errors.

    Attributes:
        foretold: by error; None where it is out of reach.
        pilot_seconds: that they took to find; compile_seconds: spent on compiling besides.
    """

    metric: Metric
    foretold: dict[float, Foretold | None]
    pilot_seconds: float
    compile_seconds: float

    def print(self, console: Console) -> None:
        """A table for people."""
        from rich.table import Table

        table = Table(NAMES[self.metric], "time", "samples a pixel", "photons a pass", "how", box=None)
        for error, found in self.foretold.items():
            if found is None:
                table.add_row(f"{error:g}", "out of reach", "", "", "")
                continue
            settings = found.settings
            photons = f"{settings.photons:,}" if settings.algorithm.shoots_photons else "none"
            words = (passes_in_words(found.pass_samples), photons, settings.algorithm.in_words(settings))
            table.add_row(f"{error:g}", format_seconds(found.seconds), *words)
        console.print(table)
        console.print(
            f"Predicted by what took {self.pilot_seconds:.1f} s ({self.compile_seconds:.1f} s of compiling besides): "
            "pilots that --until-error makes, too, and two passes, which are part of its image.",
            markup=False,
            highlight=False,
        )


def predict(
    scene: Scene, work: Workplace, metric: Metric = Metric.RELMSE, targets: tuple[float, ...] = TARGETS, **chosen: Any
) -> Predictions:
    """What it takes to reach errors.

    Args:
        work: where pilots are rendered.
        targets: errors in the metric.
        chosen: settings that are kept, by name, see RenderSettings.

    Raises:
        SceneError, SettingsError, ClusterError: see their messages.
    """
    settings, fixed = settings_for(scene, **chosen), frozenset(chosen)
    goals = {error: Goal(error, metric) for error in targets}
    foretold: dict[float, Foretold | None] = dict.fromkeys(goals)
    searched = {error: goal for error, goal in goals.items() if is_searched_for(goal, settings)}
    by_default = {error: goal for error, goal in goals.items() if error not in searched}
    passes = DefaultPasses(scene, settings, work, metric, lambda: math.inf)
    began = work.clock()
    if by_default:
        to_error = RenderToError(passes, by_default[min(by_default)], fixed)
        to_error.begin()
        to_error.render_pair()
        for error, goal in by_default.items():
            if to_error.is_too_biased_for(goal):
                searched[error] = goal
            else:
                samples, seconds = to_error.foretell(goal)
                foretold[error] = Foretold(seconds, samples, passes.renderer.prepared.settings)
        passes.let_go()
    pilot = TrialPilot(scene, settings, fixed, work)
    if searched:
        pilot.run(searched[min(searched)])
        for error, goal in searched.items():
            schedule, reached = pilot.best(goal)
            foretold[error] = Foretold.of(schedule) if reached else None
    compiled = passes.compile_seconds + pilot.compile_seconds
    return Predictions(metric, foretold, max(work.clock() - began - compiled, 0.0), compiled)
