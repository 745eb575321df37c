"""`wdpm bench indirect`: the photon map, final gathering and the irradiance cache side by side: error against time.

Each way is rendered at every number of samples and of photons; all of a round before any of the next, so that what
else the machine does falls on all alike, and each round with a seed of its own. Whatever is to be compiled is compiled
before that, and its time is told apart.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from wdpm.bench.mitsuba import WARM_SEED, Cost
from wdpm.cluster.integrators.registry import REFERENCE
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.goal.clock import cpu_seconds
from wdpm.images.comparison import Region, compare, region_slices
from wdpm.images.image import Image
from wdpm.images.image import load as load_image
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend
from wdpm.rendering.passes import render_in_passes
from wdpm.report import report
from wdpm.report.grid import Grid
from wdpm.report.tables import format_seconds
from wdpm.scenes.errors import ImageError
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene

WAYS = (Indirect.MAP, Indirect.GATHER, Indirect.CACHE)

REFERENCE_SEED = 2**21

Renderer = Callable[[Scene, RenderSettings], Image]


@dataclass(frozen=True)
class Sweep:
    """What is rendered of each scene.

    Attributes:
        spp, photons: every pair of them, by each way; the maps of caustics and media hold as many photons.
        rounds: images of each.
        region: pixels whose error counts; None for all.
        reference_spp: samples a pixel of the reference, where it is path traced here.
    """

    spp: tuple[int, ...] = (4, 8, 16, 32, 64)
    photons: tuple[int, ...] = (50_000, 250_000)
    rounds: int = 2
    region: Region | None = None
    reference_spp: int = 1024


@dataclass(frozen=True)
class Choice:
    """One choice of settings."""

    way: Indirect
    photons: int
    spp: int

    def settings(self, seed: int, max_depth: int | None) -> RenderSettings:
        """For a render."""
        return RenderSettings(
            integrator=Integrator.PHOTONS,
            photons=self.photons,
            caustic_photons=self.photons,
            volume_photons=self.photons,
            spp=self.spp,
            indirect=self.way,
            seed=seed,
            max_depth=max_depth,
        )


@dataclass(frozen=True)
class Found:
    """What came of a choice.

    Attributes:
        cost: median of the rounds, from a loaded scene to the image, kernels being compiled.
        rmse: root of the mean squared error, mean of the rounds.
        rel_mse: mean of the rounds.
        energy: mean of the image over that of the reference, mean of the rounds.
        records: irradiance records, mean of the rounds.
    """

    choice: Choice
    cost: Cost
    rmse: float
    rel_mse: float
    energy: float
    records: float


@dataclass(frozen=True)
class IndirectFigures:
    """All of a scene.

    Attributes:
        scene: its name.
        reference: what errors are measured against, in words.
        size: (width, height) of the images [pixels].
        threads: that rendered.
        sweep: what was asked for.
        compiled: way -> seconds to compile what the ways before it did not need; near 0 from a warm cache.
        found: in the order of ways, photons and samples.
    """

    scene: str
    reference: str
    size: tuple[int, int]
    threads: int
    sweep: Sweep
    compiled: dict[str, float]
    found: tuple[Found, ...]

    def found_by(self, way: Indirect) -> list[Found]:
        """What came of one way."""
        return [each for each in self.found if each.choice.way is way]

    def best(self, way: Indirect) -> Found:
        """The least error of a way."""
        return min(self.found_by(way), key=lambda each: each.rmse)

    def least_to(self, way: Indirect, rmse: float) -> Found | None:
        """The least CPU time of a way to an error; None if it was not reached."""
        return min(
            (each for each in self.found_by(way) if each.rmse <= rmse), key=lambda each: each.cost.cpu_s, default=None
        )

    def grids(self) -> list[Grid]:
        """Every choice, and the time of each way to the least errors of all ways."""
        return [self._sweep_grid(), self._least_grid()]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        found = [
            {"way": each.choice.way.value, "photons": each.choice.photons, "spp": each.choice.spp}
            | {"cpu_s": each.cost.cpu_s, "wall_s": each.cost.wall_s, "rmse": each.rmse, "rel_mse": each.rel_mse}
            | {"energy": each.energy, "records": each.records}
            for each in self.found
        ]
        return {
            "scene": self.scene,
            "reference": self.reference,
            "size": list(self.size),
            "threads": self.threads,
            "sweep": asdict(self.sweep),
            "compile_s": self.compiled,
            "found": found,
        }

    def _sweep_grid(self) -> Grid:
        rows = tuple(
            (
                each.choice.way.value,
                f"{each.choice.photons:,}",
                f"{each.choice.spp}",
                format_seconds(each.cost.cpu_s),
                format_seconds(each.cost.wall_s),
                f"{each.rmse:.5f}",
                f"{each.rel_mse:.3g}",
                f"{each.energy - 1:+.2%}",
                f"{each.records:,.0f}",
            )
            for each in self.found
        )
        columns = ("indirect", "photons", "samples", "CPU time", "time", "RMSE", "relMSE", "energy", "records")
        compiled = ", ".join(f"{way} {format_seconds(seconds)}" for way, seconds in self.compiled.items())
        width, height = self.size
        notes = (
            f"{width}x{height} on {self.threads} threads, median time and mean error of {self.sweep.rounds} by turns. "
            f"Compiled before: {compiled}.",
            f"Errors{'' if self.sweep.region is None else f' in {self.sweep.region}'} against {self.reference}.",
        )
        return Grid(f"Map, gather and cache: {self.scene}", columns, rows, notes)

    def _least_grid(self) -> Grid:
        rows = []
        for of in WAYS:
            bound = self.best(of).rmse
            least = [self.least_to(way, bound) for way in WAYS]
            cells = ["not reached" if each is None else format_seconds(each.cost.cpu_s) for each in least]
            rows.append((f"{bound:.5f}, the least of {of.value}", *cells))
        columns = ("RMSE", *(way.value for way in WAYS))
        notes = ("CPU time of the fastest choice of each way whose error is no larger.",)
        return Grid(f"CPU time to an error: {self.scene}", columns, tuple(rows), notes)


def reference_beside(source: str) -> Path | None:
    """`reference.exr` beside a scene file, or None."""
    beside = Path(source).with_name("reference.exr")
    return beside if Path(source).is_file() and beside.is_file() else None


def measure(
    source: str,
    reference_file: Path | None,
    sweep: Sweep,
    backend: Backend,
    progress: Progress,
    *,
    size: tuple[int, int] | None = None,
    render: Renderer | None = None,
) -> IndirectFigures:
    """Sweep a scene.

    Args:
        source: scene file, or name of a built-in scene.
        reference_file: what errors are measured against, and has the size of the images; None to path trace it here.
        size: (width, height) where the reference is path traced; None for the scene's own.
        render: renders a scene; None for wdpm itself.

    Raises:
        SceneError: the scene cannot be loaded.
        ImageError: the reference cannot be read, has values that are not finite or is black, or the region lies
            outside; or an image has values that are not finite.
        SettingsError: a scene or number that cannot be rendered so.
    """
    render = render or (lambda scene, settings: render_in_passes(scene, backend, settings))
    if reference_file is not None:
        reference = load_image(reference_file)
        size = reference.shape[1], reference.shape[0]
        words = str(reference_file)
        _check_reference(reference, sweep.region, words)
    scene = load(source, size=size)
    size = scene.camera.width, scene.camera.height
    region_slices(sweep.region, (size[1], size[0]))  # one that lies outside is an error before anything is rendered
    choices = [Choice(way, photons, spp) for way, photons, spp in product(WAYS, sweep.photons, sweep.spp)]
    for choice in choices:
        choice.settings(0, scene.max_depth)  # and so is a value out of range
    compiled = _warm_up(scene, sweep, render, progress)
    if reference_file is None:
        progress.start("reference", 1)
        reference = render(scene, _reference_settings(scene, sweep))
        words = f"path tracing of our own, {sweep.reference_spp:,} samples"
        progress.advance()
        _check_reference(reference, sweep.region, words)
    turns: list[list[_Turn]] = [[] for _ in choices]
    progress.start("rounds", sweep.rounds * len(choices))
    for seed in range(sweep.rounds):
        for choice, done in zip(choices, turns, strict=True):
            done.append(_turn(scene, choice.settings(seed, scene.max_depth), reference, sweep.region, render))
            progress.advance()
    found = tuple(_found(choice, done) for choice, done in zip(choices, turns, strict=True))
    return IndirectFigures(scene.name, words, size, backend.threads, sweep, compiled, found)


@dataclass(frozen=True)
class _Turn:
    """One render."""

    cost: Cost
    mse: float
    rel_mse: float
    energy: float
    records: int


def _warm_up(scene: Scene, sweep: Sweep, render: Renderer, progress: Progress) -> dict[str, float]:
    """Render by each way once, at the least that is asked for; gives the seconds to compile."""
    progress.start("warm up", len(WAYS))
    compiled = {}
    for way in WAYS:
        settings = Choice(way, min(sweep.photons), min(sweep.spp)).settings(WARM_SEED, scene.max_depth)
        compiled[way.value] = _account(render(scene, settings)).phases.get("compile", 0.0)
        progress.advance()
    return compiled


def _check_reference(reference: Image, region: Region | None, words: str) -> None:
    """Raise ImageError where no error can be measured."""
    seen = reference.pixels[region_slices(region, reference.shape)]
    if not np.isfinite(seen).all() or not seen.any():
        raise ImageError(f"{words}: has values that are not finite, or is black, and no error can be measured there")


def _reference_settings(scene: Scene, sweep: Sweep) -> RenderSettings:
    return RenderSettings(integrator=REFERENCE, spp=sweep.reference_spp, seed=REFERENCE_SEED, max_depth=scene.max_depth)


def _turn(scene: Scene, settings: RenderSettings, reference: Image, region: Region | None, render: Renderer) -> _Turn:
    began, cpu_began = time.perf_counter(), cpu_seconds()
    image = render(scene, settings)
    cost = Cost(time.perf_counter() - began, cpu_seconds() - cpu_began)
    figures = compare(image, reference, region)
    if figures.nonfinite_a:
        raise ImageError(f"{settings.indirect.value}: {figures.nonfinite_a:,} values of the image are not finite")
    energy = math.fsum(figures.mean_a) / math.fsum(figures.mean_b)
    gathered = _account(image).final_gather
    return _Turn(cost, figures.mse, figures.rel_mse, energy, gathered.records if gathered else 0)


def _found(choice: Choice, turns: Sequence[_Turn]) -> Found:
    cost = Cost(
        statistics.median(turn.cost.wall_s for turn in turns), statistics.median(turn.cost.cpu_s for turn in turns)
    )
    return Found(
        choice,
        cost,
        math.sqrt(statistics.fmean(turn.mse for turn in turns)),
        statistics.fmean(turn.rel_mse for turn in turns),
        statistics.fmean(turn.energy for turn in turns),
        statistics.fmean(turn.records for turn in turns),
    )


def _account(image: Image) -> report.Report:
    return report.from_dict(image.metadata["report"])
