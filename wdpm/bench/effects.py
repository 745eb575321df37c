"""`wdpm bench effects`: what each effect costs where a scene calls for it, and that it costs nothing where it does not.

Scenes that differ by one effect are rendered by turns with kernels for just what they call for, and with kernels that
have everything compiled in. Times are of one run; compile times are those of a process with an empty cache.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from wdpm.bench import effects_compiler
from wdpm.bench import effects_scenes as scenes
from wdpm.bench.outputs import settings_to_dict
from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.clock import cpu_seconds
from wdpm.images.image import Image
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend
from wdpm.rendering.passes import render_in_passes
from wdpm.report import report
from wdpm.report.grid import Grid
from wdpm.report.tables import format_seconds
from wdpm.scenes.errors import SettingsError, WdpmError
from wdpm.scenes.model.scene import Scene

Renderer = Callable[[Scene, RenderSettings], Image]
Compiler = Callable[[Sequence[str] | None], tuple[float, int]]
"""Compiles the kernels of some features from scratch, or those that all scenes share; gives seconds and modules."""


@dataclass(frozen=True)
class Times:
    """Of one scene with one set of kernels, medians of all rounds.

    Attributes:
        seconds: wall-clock of the phase `render`.
        cpu_seconds: of all threads of the whole call, the pilot included.
        compile_seconds: of the kernels that depend on features, by a process with an empty cache; None if not measured.
        modules: how many of them.
    """

    seconds: float
    cpu_seconds: float
    compile_seconds: float | None
    modules: int


@dataclass(frozen=True)
class SceneFigures:
    """One scene.

    Attributes:
        features: effects that its kernels are compiled for.
        own: with these kernels.
        all_effects: with everything compiled in.
        bits_equal: whether both give the same bits in all layers.
        gain: time with everything compiled in over its own, round by round, and the same of CPU times.
    """

    name: str
    features: tuple[str, ...]
    own: Times
    all_effects: Times
    bits_equal: bool
    gain: tuple[float, ...]
    cpu_gain: tuple[float, ...]


@dataclass(frozen=True)
class EffectFigures:
    """All scenes; the first is the diffuse box.

    Attributes:
        common_compile_seconds: of the kernels that all scenes share, None if not measured.
    """

    size: tuple[int, int]
    settings: RenderSettings
    rounds: int
    threads: int
    common_compile_seconds: float | None
    scenes: tuple[SceneFigures, ...]

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        settings = settings_to_dict(self.settings)
        return asdict(self) | {"settings": settings}

    def grid(self) -> Grid:
        """The table."""
        s = self.settings
        title = (
            f"Effects: {self.size[0]}x{self.size[1]}, {s.spp} samples, {s.photons:,} photons a map, "
            f"{self.threads} threads, {self.rounds} rounds"
        )
        columns = (
            "scene",
            "time",
            "CPU",
            "/ box",
            "all effects",
            "CPU",
            "gain",
            "CPU gain",
            "compile",
            "modules",
            "bits",
        )
        first = self.scenes[0].own.cpu_seconds
        rows = tuple(_row(figures, first) for figures in self.scenes)
        notes = [
            "time: of the phase render. CPU: of all threads of the whole call, pilot, photons and map included. / box: "
            "CPU time over that of the first scene, both with own kernels. gain: time with all effects over that with "
            "a scene's own kernels, the median of the rounds.",
        ]
        if self.common_compile_seconds is not None:
            everything = self.scenes[-1].all_effects.compile_seconds or 0.0
            notes.append(
                "compile: of the kernels that depend on effects, with an empty cache. Besides, once: "
                f"{format_seconds(self.common_compile_seconds)} for those that all scenes share. With all effects: "
                f"{format_seconds(everything)}."
            )
        return Grid(title, columns, rows, tuple(notes))


def _row(figures: SceneFigures, first: float) -> tuple[str, ...]:
    own, everything = figures.own, figures.all_effects
    return (
        figures.name,
        format_seconds(own.seconds),
        format_seconds(own.cpu_seconds),
        f"{own.cpu_seconds / first:.2f}",
        format_seconds(everything.seconds),
        format_seconds(everything.cpu_seconds),
        f"{statistics.median(figures.gain):.2f}",
        f"{statistics.median(figures.cpu_gain):.2f}",
        "-" if own.compile_seconds is None else format_seconds(own.compile_seconds),
        f"{own.modules}",
        "equal" if figures.bits_equal else "DIFFER",
    )


def measure(
    settings: RenderSettings,
    backend: Backend,
    progress: Progress,
    *,
    names: Sequence[str] = (),
    size: tuple[int, int] = (256, 256),
    rounds: int = 3,
    render: Renderer | None = None,
    compiler: Compiler | None = None,
) -> EffectFigures:
    """Render the scenes by turns.

    Args:
        names: of the scenes; none for all. The diffuse box is always rendered, and first.
        rounds: renders of each scene with either kernels.
        render: renders; None for wdpm itself.
        compiler: measures compile times; None leaves them out.

    Raises:
        SettingsError: no such scene.
    """
    chosen = [name for name in scenes.names() if not names or name in (scenes.DIFFUSE, *names)]
    for name in names:
        if name not in scenes.names():
            raise SettingsError(f"there is no scene {name!r}; expected some of {', '.join(scenes.names())}")
    render = render or (lambda scene, settings: render_in_passes(scene, backend, settings))
    progress.start("warm up", len(chosen))
    loaded = [scenes.scene_of(name, size) for name in chosen]
    for scene in loaded:  # whatever is to be compiled is compiled here
        for everything in (False, True):
            render(scene, replace(settings, all_effects=everything))
        progress.advance()
    progress.start("rounds", rounds * len(chosen))
    turns: list[list[_Turn]] = [[] for _ in loaded]
    for _ in range(rounds):
        for scene, done in zip(loaded, turns, strict=True):
            done.append(_turn(scene, settings, render))
            progress.advance()
    progress.start("compile", len(chosen))
    common = None if compiler is None else compiler(None)[0]
    compiled: dict[tuple[str, ...], float] = {}
    figures = []
    for name, done in zip(chosen, turns, strict=True):
        figures.append(_figures(name, done, compiler, compiled))
        progress.advance()
    return EffectFigures(size, settings, rounds, backend.threads, common, tuple(figures))


@dataclass(frozen=True)
class _Turn:
    """One render with own kernels, and one with all effects."""

    seconds: tuple[float, float]
    cpu: tuple[float, float]
    account: tuple[report.Report, report.Report]
    bits_equal: bool


def _turn(scene: Scene, settings: RenderSettings, render: Renderer) -> _Turn:
    seconds, cpu, accounts, digests = [], [], [], []
    for everything in (False, True):
        began = cpu_seconds()
        image = render(scene, replace(settings, all_effects=everything))
        cpu.append(cpu_seconds() - began)
        account = report.from_dict(image.metadata["report"])
        seconds.append(account.phases["render"])
        accounts.append(account)
        digests.append(image.digest())
    return _Turn((seconds[0], seconds[1]), (cpu[0], cpu[1]), (accounts[0], accounts[1]), digests[0] == digests[1])


def _figures(
    name: str, turns: list[_Turn], compiler: Compiler | None, compiled: dict[tuple[str, ...], float]
) -> SceneFigures:
    kernels = [account.kernels for account in turns[0].account]
    times = []
    for which, each in enumerate(kernels):
        if compiler is not None and each.features not in compiled:
            compiled[each.features] = compiler(each.features)[0]
        times.append(
            Times(
                statistics.median(turn.seconds[which] for turn in turns),
                statistics.median(turn.cpu[which] for turn in turns),
                compiled.get(each.features),
                each.modules,
            )
        )
    return SceneFigures(
        name,
        kernels[0].features,
        times[0],
        times[1],
        all(turn.bits_equal for turn in turns),
        tuple(turn.seconds[1] / turn.seconds[0] for turn in turns),
        tuple(turn.cpu[1] / turn.cpu[0] for turn in turns),
    )


def compile_from_scratch(features: Sequence[str] | None) -> tuple[float, int]:
    """Compile in a process of its own with an empty cache; gives seconds and modules.

    Raises:
        WdpmError: the process failed.
    """
    with tempfile.TemporaryDirectory(prefix="wdpm-bench-") as cache:
        order: dict[str, Any] = {"cache": cache}
        if features is not None:
            order["features"] = list(features)
        # -P: the folder of the program holds wdpm's modules, which must not hide others by their names.
        command = [sys.executable, "-P", str(Path(effects_compiler.__file__))]
        done = subprocess.run(command, input=json.dumps(order), capture_output=True, text=True, check=False)
    if done.returncode:
        words = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise WdpmError(f"bench effects: the process that compiles failed: {words[-1]}")
    answer = json.loads(done.stdout.splitlines()[-1])
    return float(answer["seconds"]), int(answer["modules"])
