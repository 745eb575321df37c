"""What errors cost on a scene and a machine, told before anything but a pilot is rendered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from wdpm.goal.goal import Goal, Metric
from wdpm.goal.outcome import NAMES
from wdpm.goal.schedule import Schedule
from wdpm.goal.trial_pilot import TrialPilot
from wdpm.goal.workplace import Workplace
from wdpm.rendering.scene_settings import settings_for
from wdpm.report.tables import format_seconds
from wdpm.scenes.model.scene import Scene

if TYPE_CHECKING:
    from rich.console import Console

TARGETS = (0.1, 0.05, 0.02, 0.01, 0.005)


@dataclass(frozen=True, eq=False)
class Predictions:
    """Of several errors.

    Attributes:
        schedules: what would be rendered, by error; None where the error is out of reach.
        pilot_seconds: that they took to find; compile_seconds: spent on compiling besides.
    """

    metric: Metric
    schedules: dict[float, Schedule | None]
    pilot_seconds: float
    compile_seconds: float

    def print(self, console: Console) -> None:
        """A table for people."""
        from rich.table import Table

        table = Table(NAMES[self.metric], "time", "passes", "samples a pass", "photons a pass", "how", box=None)
        for error, schedule in self.schedules.items():
            if schedule is None:
                table.add_row(f"{error:g}", "out of reach", "", "", "", "")
                continue
            settings = schedule.settings
            photons = f"{settings.photons:,}" if settings.algorithm.shoots_photons else "none"
            counts = (f"{schedule.passes:,}", f"{schedule.samples:,}", photons)
            table.add_row(
                f"{error:g}", format_seconds(schedule.seconds), *counts, settings.algorithm.in_words(settings)
            )
        console.print(table)
        console.print(
            f"Predicted by a pilot of {self.pilot_seconds:.1f} s ({self.compile_seconds:.1f} s of compiling besides), "
            "which --until-error makes, too; its is shorter for larger errors.",
            markup=False,
            highlight=False,
        )


def predict(
    scene: Scene, work: Workplace, metric: Metric = Metric.RELMSE, targets: tuple[float, ...] = TARGETS, **chosen: Any
) -> Predictions:
    """What it takes to reach errors.

    Args:
        work: where the pilot is rendered.
        targets: errors in the metric.
        chosen: settings that are kept, by name, see RenderSettings.

    Raises:
        SceneError, SettingsError, ClusterError: see their messages.
    """
    goals = {error: Goal(error, metric) for error in targets}
    pilot = TrialPilot(scene, settings_for(scene, **chosen), frozenset(chosen), work)
    pilot.run(goals[min(targets)])
    schedules: dict[float, Schedule | None] = {}
    for error, goal in goals.items():
        schedule, reached = pilot.best(goal)
        schedules[error] = schedule if reached else None
    return Predictions(metric, schedules, pilot.seconds, pilot.compile_seconds)
