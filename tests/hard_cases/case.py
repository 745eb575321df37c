"""The one form of all hard cases: what is looked at, what is to be expected and why, and what was found.

A case is a function of a module hard_<section>.py that is given a `Run`; it renders with `Run.render`, which also
demands what holds for every image, and compares with `Run.check`:

    @hard_case(
        "white furnace",
        section=8,
        shows="a closed box of albedo 0.5 that glows everywhere",
        expected="Le / (1 - albedo), by energy conservation",
        tolerance="1 %: the noise of 2,000 photons, 3 sigma",
    )
    def furnace(run: Run) -> None:
        image = run.render(scene, photons=20_000 if run.full else 2_000)
        run.check("radiance", image.pixels.mean(), 2.0, 0.02)

Those that come in several sizes or for several scenes are made in a loop, and stand in the module's tuple CASES.

`pytest tests/hard_cases` runs all at the small size, run.py in full.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.model.scene import Scene

LEDGER = 1e-5
"""Largest imbalance of the photons' energy, as a share of what was emitted."""

SECTIONS = {
    1: "Scale and place",
    2: "Geometry",
    3: "Rays",
    4: "Partition",
    5: "Photons and gather",
    6: "Materials",
    7: "Media",
    8: "Numbers",
}


FIRST_OF_LIGHT = 5
"""From this section on, cases are of what light does, not of where things lie."""


@dataclass(frozen=True)
class Check:
    """One comparison.

    Attributes:
        what: that was compared.
        measured, expected: figures, or words.
        passed: whether they agree.
    """

    what: str
    measured: str
    expected: str
    passed: bool


@dataclass
class Run:
    """One run of a case: what it rendered and compared.

    Attributes:
        full: whether there is time for many samples; otherwise the case should take a second.
        rays: how many rays a case that counts rays is to trace; None for what the size allows.
        cut: whether each image is rendered in several cells as well; small cases of what light does are not, as random
            scenes of such materials, media and lamps are cut in tests/property.
        checks: all comparisons so far.
        picture: linear RGB to be shown, shape [height, width, 3], or None.
        notes: what else a person should know, one sentence each.
    """

    full: bool
    rays: int | None = None
    cut: bool = True
    checks: list[Check] = field(default_factory=list)
    picture: NDArray[np.float32] | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether all comparisons agree, and there was one."""
        return bool(self.checks) and all(check.passed for check in self.checks)

    def render(self, scene: Scene, *, cells: int = 4, settings: RenderSettings | None = None, **chosen: Any) -> Image:
        """The image of one cell; demands what holds for every image: finite values, a closed ledger, the same bits.

        Compiled with all effects unless `all_effects` says otherwise, so that no case needs kernels of its own.

        Args:
            cells: that the second image is rendered with, a power of two; 1 renders no second image.
            settings: all settings; or give single ones by name.
        """
        wanted = settings or RenderSettings(**{"all_effects": True, **chosen})
        image = render_in_process(scene, wanted, workers=1, cells=1)
        self.demand_sound(image)
        if self.cut and cells > 1:
            other = render_in_process(scene, wanted, workers=2, cells=cells)
            self.demand(f"the same bits in {cells} cells", image.digest() == other.digest())
        if self.picture is None:
            self.show(image.pixels)
        return image

    def demand_sound(self, image: Image) -> None:
        """Finite values, nothing blackened, a closed ledger."""
        report = image.metadata["report"]
        bad = sum(int((~np.isfinite(layer)).sum()) for layer in image.layers.values())
        self.check("non-finite values", bad, 0, 0)
        self.check("samples blackened", sum(report["nonfinite"].values()), 0, 0)
        self.check("imbalance of energy", imbalance(image), 0, LEDGER)

    def check(self, what: str, measured: ArrayLike, expected: ArrayLike, tolerance: float) -> None:
        """Demand |measured - expected| <= tolerance in every component; NaN fails."""
        m, e = np.asarray(measured, np.float64), np.asarray(expected, np.float64)
        good = bool((np.abs(m - e) <= tolerance).all())
        self.checks.append(
            Check(what, _figures(m), f"{_figures(e)} ± {tolerance:g}" if tolerance else _figures(e), good)
        )

    def check_share(self, what: str, measured: ArrayLike, expected: ArrayLike, share: float) -> None:
        """Demand |measured / expected - 1| <= share in every component; for any scale of radiance."""
        m, e = np.asarray(measured, np.float64), np.asarray(expected, np.float64)
        good = bool((np.abs(m - e) <= share * np.abs(e)).all())
        self.checks.append(Check(what, _figures(m), f"{_figures(e)} ± {100 * share:g} %", good))

    def demand(self, what: str, passed: bool, measured: str = "", expected: str = "") -> None:
        """A comparison whose outcome is known."""
        self.checks.append(Check(what, measured or ("yes" if passed else "no"), expected or "yes", bool(passed)))

    def show(self, pixels: ArrayLike) -> None:
        """The picture of the page's row; the last one counts."""
        self.picture = np.asarray(pixels, np.float32)

    def note(self, text: str) -> None:
        """Something to be read beside the verdict."""
        self.notes.append(text)


@dataclass(frozen=True, kw_only=True)
class HardCase:
    """A hard case.

    Attributes:
        name: unique.
        section: 1 to 8, see SECTIONS.
        shows: what is rendered or computed, and what could go wrong.
        expected: what is right, and where that comes from: a closed formula, a symmetry, a furnace, another renderer.
        tolerance: how far off the figures may be, and why just so far.
        measure: does it.
        limit: why the case does not pass, and what it would take; empty for a case that must pass.
        needs: a package that must be there, or "" ("mitsuba": left out without it).
        slow: whether it is left out at the small size.
    """

    name: str
    section: int
    shows: str
    expected: str
    tolerance: str
    measure: Callable[[Run], None]
    limit: str = ""
    needs: str = ""
    slow: bool = False


def hard_case(name: str, **told: Any) -> Callable[[Callable[[Run], None]], HardCase]:
    """Makes a case of a function; what is told are the other attributes of a `HardCase`."""
    return lambda measure: HardCase(name=name, measure=measure, **told)


@dataclass(frozen=True)
class Outcome:
    """What became of a case, and how long that took [s]."""

    case: HardCase
    run: Run
    seconds: float
    error: str = ""

    @property
    def passed(self) -> bool:
        return self.run.passed and not self.error


def run_case(case: HardCase, full: bool, rays: int | None = None) -> Outcome:
    """Run a case; an exception is an outcome too."""
    run = Run(full, rays, cut=full or case.section < FIRST_OF_LIGHT)
    began = time.perf_counter()
    error = ""
    try:
        case.measure(run)
    except Exception as exception:
        error = f"{type(exception).__name__}: {exception}"
    return Outcome(case, run, time.perf_counter() - began, error)


def every_case() -> list[HardCase]:
    """The cases of all modules hard_*.py beside this one, by section."""
    modules = [importlib.import_module(path.stem) for path in sorted(Path(__file__).parent.glob("hard_*.py"))]
    own = [case for module in modules for case in vars(module).values() if isinstance(case, HardCase)]
    cases = [*own, *(case for module in modules for case in getattr(module, "CASES", ()))]
    names = [case.name for case in cases]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ValueError(f"two hard cases have one name: {', '.join(sorted(twice))}")
    return sorted(cases, key=lambda case: case.section)


def imbalance(image: Image) -> float:
    """What is missing from the ledger of the photons' energy or too much, as a share of what was emitted."""
    energy = image.metadata["report"]["energy"]
    missing = energy["emitted"] - energy["absorbed"] - energy["escaped"] - energy["travelling"]
    return abs(missing) / energy["emitted"] if energy["emitted"] > 0 else abs(missing)


def mean(image: Image, layer: str) -> NDArray[np.float64]:
    """Of a layer, per channel."""
    return np.asarray(image.layers[layer].mean(axis=(0, 1), dtype=np.float64))


def mean_of(pixels: NDArray[np.float32]) -> NDArray[np.float64]:
    """Of an image, per channel."""
    return np.asarray(pixels.mean(axis=(0, 1), dtype=np.float64))


def _figures(values: NDArray[np.float64]) -> str:
    """Six digits; of many numbers the least and the largest."""
    flat = values.reshape(-1)
    if flat.size == 0:
        return "none"
    if flat.size <= 3:
        return ", ".join(f"{value:.6g}" for value in flat)
    return f"{flat.min():.6g} .. {flat.max():.6g}"
