"""`wdpm bench predict`: how true it is what `--until-error` says: the time it predicts, and the error it estimates.

Each run asks for an error and is held against a reference image and against the clock. Time is that of the process's
threads by default, which other work on the machine does not lengthen.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from wdpm.bench.rows import Figures, Rows
from wdpm.goal.clock import cpu_seconds
from wdpm.goal.goal import Goal
from wdpm.goal.reference_pair import coarser
from wdpm.goal.render import OUTCOME, render_until
from wdpm.images.comparison import compare
from wdpm.images.image import Image
from wdpm.images.image import load as load_image
from wdpm.progress import Progress, SilentProgress
from wdpm.rendering.backend import Backend
from wdpm.report.grid import Grid
from wdpm.report.tables import format_seconds
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.load import load

TARGETS = (0.1, 0.05, 0.02, 0.01)

TIME_FACTOR = 1.5
TIME_FLOOR, ERROR_FLOOR, SPENDING_FLOOR = 0.8, 0.9, 0.5
"""Shares of runs that are to have the time within TIME_FACTOR, the error within what was asked for, and no less than a
quarter of that."""

LEAST_TIME = 0.01
"""Seconds; where the pilot's passes are enough none are to come, and a ratio says nothing."""


CLOCKS = {"cpu": cpu_seconds, "wall": time.perf_counter}


@dataclass(frozen=True)
class Run:
    """One render that was asked for an error.

    Attributes:
        target: relMSE asked for; true: against the reference; estimated, high: by the render, and its upper end.
        reached: whether the render says so.
        predicted, taken: seconds of the passes; pilot: of the pilot before them; wall: of everything, as a clock on the
            wall has it.
        how: what was chosen, as JSON has it.
    """

    scene: str
    seed: int
    target: float
    true: float
    estimated: float | None
    high: float | None
    reached: bool
    predicted: float
    taken: float
    pilot: float
    wall: float
    how: dict[str, Any]

    @property
    def ratio(self) -> float:
        """Of time taken to time predicted."""
        return self.taken / max(self.predicted, LEAST_TIME)

    @property
    def whole_ratio(self) -> float:
        """The same with the pilot, whose time is known when the prediction is made."""
        return (self.pilot + self.taken) / max(self.pilot + self.predicted, LEAST_TIME)


@dataclass(frozen=True)
class PredictFigures:
    """All runs."""

    clock: str
    threads: int
    runs: tuple[Run, ...]

    def share(self, holds: Any) -> float:
        """Of the runs, that something holds for."""
        return sum(map(holds, self.runs)) / len(self.runs)

    @property
    def time_share(self) -> float:
        return self.share(lambda run: 1 / TIME_FACTOR <= run.whole_ratio <= TIME_FACTOR)

    @property
    def error_share(self) -> float:
        return self.share(lambda run: run.true <= run.target or not run.reached)

    @property
    def spending_share(self) -> float:
        return self.share(lambda run: run.true >= run.target / 4)

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        names = ("time_share", "error_share", "spending_share")
        return asdict(self) | {name: getattr(self, name) for name in names}

    def grid(self) -> Grid:
        """The table."""
        columns = ("scene", "seed", "asked", "true", "estimated", "time predicted", "taken", "with pilot", "passes")
        rows = tuple(_row(run) for run in self.runs)
        notes = (
            f"True error at most the one asked for (or said not to be reached): {self.error_share:.0%} of runs "
            f"(floor {ERROR_FLOOR:.0%}); not below a quarter of it: {self.spending_share:.0%} (floor "
            f"{SPENDING_FLOOR:.0%}); time with pilot within a factor of {TIME_FACTOR:g}: {self.time_share:.0%} (floor "
            f"{TIME_FLOOR:.0%}), of the passes alone: "
            f"{self.share(lambda run: 1 / TIME_FACTOR <= run.ratio <= TIME_FACTOR):.0%}.",
            "relMSE against reference.exr beside the scene. Time: "
            + ("CPU time of all threads." if self.clock == "cpu" else "wall-clock time."),
        )
        return Grid("Asked for an error", columns, rows, notes)


def measure(
    scenes: Sequence[Path],
    backend: Backend,
    progress: Progress,
    *,
    targets: Sequence[float] = TARGETS,
    seeds: int = 1,
    clock: str = "cpu",
    smaller: int = 1,
    rows: Rows | None = None,
) -> PredictFigures:
    """Ask each scene for each error.

    Args:
        scenes: files with a reference.exr beside them, which gives the size.
        backend: that renders.
        seeds: runs of each.
        clock: a name of CLOCKS.
        smaller: so many pixels of the reference along a side are one of the image's: scenes cost as much less.
        rows: keeps what each run came to, and has those that need not be done again; None for none.

    Raises:
        SettingsError: no scene, or one without reference, or one whose reference does not divide into such pixels.
        SceneError, ImageError: one of them cannot be read.
    """
    if not scenes:
        raise SettingsError("no scene is given; expected files with a reference.exr beside them")
    for file in scenes:
        if not reference_of(file).is_file():
            raise SettingsError(f"{file}: no {reference_of(file).name} beside it, so no error could be told")
    rows = rows or Rows()
    progress.start("runs", len(scenes) * len(targets) * seeds)
    runs = []
    for file in scenes:
        reference = _in_larger_pixels(load_image(reference_of(file)), smaller, file)
        height, width = reference.shape
        scene = load(file, size=(width, height))
        for seed in range(seeds):
            for target in targets:
                of = {"scene": str(file), "seed": seed, "error": target, "clock": clock, "smaller": smaller}
                run = partial(_run, scene, file, reference, target, seed, clock, backend)
                runs.append(Run(**rows.measured({**of, "threads": backend.threads}, run)))
                progress.note("  ".join(_row(runs[-1])))
                progress.advance()
    return PredictFigures(clock, backend.threads, tuple(runs))


def reference_of(scene: Path) -> Path:
    """Where the reference of a scene is expected."""
    return scene.with_name("reference.exr")


def _in_larger_pixels(reference: Image, smaller: int, file: Path) -> Image:
    """A reference of box-filtered pixels that are means of `smaller` by `smaller` of its own."""
    height, width = reference.shape
    if height % smaller or width % smaller:
        raise SettingsError(
            f"{reference_of(file)}: {width}x{height} pixels are no whole number of squares of {smaller}x{smaller}; "
            "give another --smaller"
        )
    return Image({"beauty": coarser(reference.pixels.astype(np.float64), smaller).astype(np.float32)})


def _run(scene: Any, file: Path, reference: Image, target: float, seed: int, clock: str, backend: Backend) -> Figures:
    began = time.perf_counter()
    image = render_until(scene, Goal(target), backend, progress=SilentProgress(), clock=CLOCKS[clock], seed=seed)
    outcome: dict[str, Any] = image.metadata[OUTCOME]
    estimate = outcome["estimate"]
    names = ("indirect", "photons", "k", "passes", "spp")
    run = Run(
        scene=file.parent.name,
        seed=seed,
        target=target,
        true=compare(image, reference).rel_mse,
        estimated=None if estimate is None else estimate["value"],
        high=None if estimate is None else estimate["high"],
        reached=outcome["reached"],
        predicted=outcome["predicted_seconds"],
        taken=outcome["seconds"],
        pilot=outcome["pilot_seconds"],
        wall=time.perf_counter() - began,
        how={name: image.metadata["settings"][name] for name in names},
    )
    return asdict(run)


def _row(run: Run) -> tuple[str, ...]:
    passes, spp = run.how["passes"], run.how["spp"]
    return (
        run.scene,
        str(run.seed),
        f"{run.target:g}" + ("" if run.reached else " (said: no)"),
        f"{run.true:.4f}",
        "-" if run.estimated is None else f"{run.estimated:.4f} (< {run.high:.4f})",
        format_seconds(run.predicted),
        f"{format_seconds(run.taken)} (x {run.ratio:.2f})",
        f"{format_seconds(run.pilot + run.taken)} (x {run.whole_ratio:.2f})",
        f"{passes} x {spp // max(passes, 1)}, {run.how['indirect']} {run.how['photons']:,}",
    )
