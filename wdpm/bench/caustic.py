"""`wdpm bench caustic`: time to an error bound in a region of the image, against Mitsuba 3's path tracer, by turns.

wdpm renders with settings that reach the bound. Mitsuba renders with a number of samples that need not: its error is
noise alone, and falls with the number of samples, so the time that it would take is the measured one times the measured
error over the bound. Both are warm, and times are those of `wdpm bench mitsuba`.
"""

from __future__ import annotations

import statistics
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from wdpm.bench.mitsuba import WARM_SEED, MitsubaProcess, Setup, timed_render
from wdpm.bench.outputs import settings_to_dict
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.comparison import RELATIVE_FLOOR, compare
from wdpm.images.image import Image
from wdpm.images.image import load as load_image
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend
from wdpm.report.grid import Grid
from wdpm.report.tables import format_seconds
from wdpm.scenes.errors import SceneError, SettingsError, WdpmError
from wdpm.scenes.load import load

FLOOR = 0.1
"""Of wdpm's time over Mitsuba's, at a caustic."""


@dataclass(frozen=True)
class Bound:
    """What is to be reached.

    Attributes:
        reference: image that errors are measured against.
        region: left, top, right, bottom of the pixels that count; None for all.
        error: relMSE.
    """

    reference: Path
    region: tuple[int, int, int, int] | None = None
    error: float = 0.02


@dataclass(frozen=True)
class Round:
    """Seconds and relMSE of one image each, one right after the other."""

    wdpm_s: float
    wdpm_error: float
    mitsuba_s: float
    mitsuba_error: float


@dataclass(frozen=True)
class CausticFigures:
    """What was measured."""

    setup: Setup
    bound: Bound
    mitsuba_version: str
    rounds: tuple[Round, ...]

    @property
    def wdpm_seconds(self) -> float:
        """Median."""
        return statistics.median(each.wdpm_s for each in self.rounds)

    @property
    def wdpm_error(self) -> float:
        """Mean."""
        return statistics.fmean(each.wdpm_error for each in self.rounds)

    @property
    def mitsuba_seconds(self) -> float:
        """To the bound, from the median time and the mean error."""
        seconds = statistics.median(each.mitsuba_s for each in self.rounds)
        return seconds * statistics.fmean(each.mitsuba_error for each in self.rounds) / self.bound.error

    @property
    def ratio(self) -> float:
        """Of wdpm's time to Mitsuba's."""
        return self.wdpm_seconds / self.mitsuba_seconds

    @property
    def reached(self) -> bool:
        """Whether wdpm's error is within the bound."""
        return self.wdpm_error <= self.bound.error

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        setup = asdict(self.setup) | {"scene": str(self.setup.scene)}
        setup["settings"] = settings_to_dict(self.setup.settings)
        bound = asdict(self.bound) | {"reference": str(self.bound.reference)}
        names = ("wdpm_seconds", "wdpm_error", "mitsuba_seconds", "ratio", "reached")
        return asdict(self) | {"setup": setup, "bound": bound} | {name: getattr(self, name) for name in names}

    def grid(self) -> Grid:
        """The table."""
        setup, s = self.setup, self.setup.settings
        measured = statistics.median(each.mitsuba_s for each in self.rounds)
        error = statistics.fmean(each.mitsuba_error for each in self.rounds)
        spp = setup.mitsuba_spp * error / self.bound.error
        rows = (
            (
                f"wdpm, {s.spp} samples, {s.photons:,} + {s.caustic_photons:,} photons, k {s.k} and {s.caustic_k}",
                format_seconds(self.wdpm_seconds),
                f"{self.wdpm_error:.4f}",
            ),
            (
                f"Mitsuba {self.mitsuba_version} path, {setup.mitsuba_spp:,} samples",
                format_seconds(measured),
                f"{error:.4f}",
            ),
            (
                f"the same, {spp:,.0f} samples (1 / samples)",
                format_seconds(self.mitsuba_seconds),
                f"{self.bound.error:g}",
            ),
            ("wdpm / Mitsuba", f"{self.ratio:.3f}", "-"),
        )
        region = "the whole image" if self.bound.region is None else f"pixels {self.bound.region}"
        notes = [
            f"relMSE of {region}: mean of (a - b)² / (b² + {RELATIVE_FLOOR:g}). Medians of times, means of errors: "
            f"{len(self.rounds)} rounds by turns; floor of the ratio: {FLOOR:g}."
        ]
        if not self.reached:
            notes.append(
                f"wdpm does not reach {self.bound.error:g}: the ratio says nothing. Use more samples or photons."
            )
        title = f"{setup.scene}, {setup.width}x{setup.height}, {setup.threads} threads"
        return Grid(title, ("renderer", "time", "relMSE"), rows, tuple(notes))


def measure(
    scene_file: Path,
    bound: Bound,
    settings: RenderSettings,
    mitsuba_spp: int,
    backend: Backend,
    progress: Progress,
    *,
    rounds: int = 3,
) -> CausticFigures:
    """Render by turns and compare.

    Raises:
        SceneError: not a Mitsuba scene, or it cannot be loaded.
        ImageError: the reference cannot be read, or the region lies outside.
        WdpmError: Mitsuba is not installed, or fails.
    """
    if scene_file.suffix.lower() != ".xml":
        raise SceneError(f"'{scene_file}' cannot be rendered by both: expected a Mitsuba scene, a file SCENE.xml")
    if not bound.error > 0:
        raise SettingsError(f"error is {bound.error}; expected a positive relMSE")
    if find_spec("mitsuba") is None:
        raise WdpmError("bench caustic: Mitsuba 3 is not installed: pip install 'wdpm[peers]'")
    reference = load_image(bound.reference)
    height, width = reference.shape
    compare(reference, reference, bound.region)  # a region that lies outside is an error before anything is rendered
    progress.start("load")
    scene = load(scene_file, size=(width, height))
    # Both trace paths of the same length: what the file asks for, or no limit.
    settings = replace(settings, max_depth=scene.max_depth)
    setup = Setup(scene_file, width, height, settings, mitsuba_spp, rounds, backend.threads)
    progress.start("warm up")
    with MitsubaProcess(setup) as mitsuba:
        mitsuba.render(mitsuba_spp, WARM_SEED)
        timed_render(scene, backend, settings, WARM_SEED)
        progress.start("rounds", rounds)
        done = []
        for seed in range(rounds):
            image, seconds = timed_render(scene, backend, settings, seed)
            pixels, mitsuba_seconds = mitsuba.render(mitsuba_spp, seed)
            ours = compare(image, reference, bound.region).rel_mse
            theirs = compare(Image({"beauty": pixels}), reference, bound.region).rel_mse
            done.append(Round(seconds, ours, mitsuba_seconds, theirs))
            progress.advance()
        return CausticFigures(setup, bound, mitsuba.version, tuple(done))
