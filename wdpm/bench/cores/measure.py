"""`wdpm bench cores`: what a render would take on more cores than there are here, and where the time goes.

A render with as many processes and threads as there are to be cores does here, by turns on the cores that there are,
what it would do there: how work is cut depends on their number, not on how many run at once. So the times of the parts
are measured, and their critical path is reckoned (schedule.py).
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path as File
from typing import Any

from wdpm.bench.cores.recorder import Recorder, TimedLauncher
from wdpm.bench.cores.schedule import Path
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.work.processes.forked_tasks import can_fork
from wdpm.devices import available_cores
from wdpm.progress import Progress
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.scene_settings import settings_for
from wdpm.report.grid import Grid
from wdpm.report.tables import format_seconds
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene

SMALL = (8, 8)
"""Pixels of the render that is taken off: what is done once, however large the image."""


@dataclass(frozen=True)
class Reckoned:
    """A render on a number of cores, less one of a few pixels.

    Attributes:
        path: the critical path; on one core all CPU time of the process.
        tasks: that other processes did.
        wall_s: what it took here on the wall, for as many cores as there are; else None.
    """

    cores: int
    path: Path
    tasks: int
    wall_s: float | None

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        path = asdict(self.path) | {"seconds": self.path.seconds}
        return {"cores": self.cores, "path": path, "tasks": self.tasks, "wall_s": self.wall_s}


@dataclass(frozen=True)
class OnCores:
    """All numbers of cores of a scene; the first is one core."""

    scene: str
    title: str
    runs: tuple[Reckoned, ...]

    def times(self, run: Reckoned) -> float:
        """How many times as fast as on one core a render is reckoned to be."""
        return self.runs[0].path.seconds / run.path.seconds

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        runs = [run.to_dict() | {"times_as_fast": self.times(run)} for run in self.runs]
        return {"scene": self.scene, "title": self.title, "runs": runs}

    def grid(self) -> Grid:
        """The table."""
        columns = ("cores", "reckoned", "times as fast", "alone", "launches", "tasks", "waiting", "number", "measured")
        notes = (
            "Reckoned, not measured: the critical path, by CPU time of each part. Not in it: that cores share memory "
            "and its bandwidth, that a clock falls as more of them work, and that many processes on few cores take "
            "each other's caches, which makes it longer here than there.",
            "alone: the first process on one thread. launches: cut for threads, while no other process is at a task. "
            "tasks: their time, shared evenly. waiting: of processes for their fork and for the longest tasks. number: "
            "of tasks. measured: on the wall here, where there are so many cores, with whatever else runs.",
            f"A render of {SMALL[0]}x{SMALL[1]} pixels is taken off everywhere.",
        )
        return Grid(self.title, columns, tuple(self._row(run) for run in self.runs), notes)

    def _row(self, run: Reckoned) -> tuple[str, ...]:
        path = run.path
        parts = [format_seconds(part) for part in (path.alone, path.launches, path.even, path.waiting)]
        wall = "-" if run.wall_s is None else f"{format_seconds(run.wall_s)}"
        ratio = f"{self.times(run):.2f}"
        return (str(run.cores), format_seconds(path.seconds), ratio, *parts, str(run.tasks) if run.tasks else "-", wall)


def measure(
    name: str, cores: Sequence[int], progress: Progress, *, size: tuple[int, int] | None = None, **chosen: Any
) -> OnCores:
    """Render a scene with one thread, and with as many processes as each of these numbers of cores.

    Args:
        chosen: settings that are not the scene's.

    Raises:
        SettingsError: no processes are forked on this system.
    """
    if not can_fork("cpu"):
        raise SettingsError("tasks are done by forked processes on Linux alone: here is nothing to be reckoned")
    progress.start("load")
    scene = load(name, size=size)
    settings = settings_for(scene, **chosen)
    small = replace(scene, camera=replace(scene.camera, width=SMALL[0], height=SMALL[1], crop=None, full_size=None))
    counts = (1, *sorted(set(cores) - {1}))
    progress.start(name, 1 + len(counts))
    for each in (small, scene):  # so that kernels are loaded
        _render(each, replace(settings, spp=1), 1)
    progress.advance()
    runs = []
    for count in counts:
        progress.note(f"{name}: {count} cores")
        runs.append(_less(_render(scene, settings, count), _render(small, settings, count)))
        progress.advance()
    width, height = scene.camera.width, scene.camera.height
    return OnCores(name, f"{name}: {width}x{height}, {settings.spp} samples", tuple(runs))


def _less(run: Reckoned, small: Reckoned) -> Reckoned:
    """A render less a small one."""
    wall = None if run.wall_s is None or small.wall_s is None else run.wall_s - small.wall_s
    return replace(run, path=run.path - small.path, wall_s=wall)


def _render(scene: Scene, settings: RenderSettings, cores: int) -> Reckoned:
    """Render anew, from the scene in memory to a file."""
    recorder = Recorder()
    launcher = TimedLauncher(cores, recorder)
    began = time.perf_counter()
    with (
        tempfile.TemporaryDirectory() as folder,
        InProcess(threads=cores, launcher=launcher, task_observer=recorder) as backend,
    ):
        render_in_passes(scene, backend, settings).save(File(folder) / "image.exr", threads=cores)
        wall, render = time.perf_counter() - began, recorder.end()
    launcher.stop_threads()
    return Reckoned(cores, render.path(cores), render.tasks, wall if cores <= available_cores() else None)
