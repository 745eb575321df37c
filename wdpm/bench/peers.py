"""`wdpm bench peers`: time to an error, of wdpm and of Mitsuba 3's path tracer, in one run.

wdpm: every member of a fixed grid of settings (peers_grid.py) is rendered once. From these follows, for each error,
which settings and how many samples should reach it in the least time (peers_guess.py); that is rendered with other
seeds, and the figures are of these renders alone: a render that was lucky is not what is shown. They go by turns with
renders of Mitsuba that take about as long, which set its speed; how many samples it needs is in peers_law.py. Both are
warm, with the same longest path.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from wdpm.bench.mitsuba import WARM_SEED, Cost, MitsubaProcess, Setup
from wdpm.bench.peers_figures import Bounds, Confirmed, PeerFigures, Reached, Try
from wdpm.bench.peers_grid import FAMILIES, Family, Member
from wdpm.bench.peers_guess import guesses
from wdpm.bench.peers_law import ErrorLaw, Point
from wdpm.bench.rows import Rows
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.comparison import compare
from wdpm.images.image import Image
from wdpm.images.image import load as load_image
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend
from wdpm.rendering.passes import render_in_passes
from wdpm.scenes.errors import ImageError, SceneError, SettingsError, WdpmError
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene

MITSUBA_SPP = 8
MITSUBA_STEP = 4
"""Mitsuba's samples: 8, 32, 128, ... Powers of two share a compiled kernel."""

SPP_STEP = 1.2
OVERSHOOT = 2
"""A guess of samples that turns out to be too few is raised by a fifth, again and again, up to twice what the grid's
render had; then the next best guess is tried."""

MITSUBA = "Mitsuba"
"""Its name among the rows."""

TURN_SEED = 2**16
"""Seeds of the renders by turns are above it, so that none is that of another number of samples."""


def default_reference(scene_file: Path) -> Path:
    """`reference.exr` beside the scene. Raises ImageError where there is none."""
    reference = scene_file.with_name("reference.exr")
    if not reference.is_file():
        raise ImageError(f"{scene_file}: there is no {reference} to measure errors against: give --reference FILE")
    return reference


def check(scene_file: Path, reference_file: Path, bounds: Bounds) -> None:
    """Whether a scene can be measured, before any is. Raises as `measure` does."""
    if scene_file.suffix.lower() != ".xml":
        raise SceneError(f"'{scene_file}' cannot be rendered by both: expected a Mitsuba scene, a file SCENE.xml")
    if not scene_file.is_file():
        raise SceneError(f"'{scene_file}': no such file")
    if find_spec("mitsuba") is None:
        raise WdpmError("bench peers: Mitsuba 3 is not installed: pip install 'wdpm[peers]'")
    reference = load_image(reference_file)
    broken = compare(reference, reference, bounds.region).nonfinite_b
    if broken:
        raise ImageError(f"{reference_file}: {broken:,} values are not finite, and no error can be measured there")


def measure(
    scene_file: Path,
    reference_file: Path,
    bounds: Bounds,
    backend: Backend,
    progress: Progress,
    *,
    families: Sequence[Family] = FAMILIES,
    rows: Rows | None = None,
) -> PeerFigures:
    """Time to errors on a scene, at the size of its reference.

    Args:
        rows: keeps what each render took, and has those that need not be done again; None for none.

    Raises:
        SceneError: not a Mitsuba scene, or it cannot be loaded.
        ImageError: the reference cannot be read, or the region lies outside.
        WdpmError: Mitsuba is not installed, or fails.
    """
    check(scene_file, reference_file, bounds)
    reference = load_image(reference_file)
    height, width = reference.shape
    progress.start(f"load {scene_file.parent.name}")
    scene = load(scene_file, size=(width, height))
    setup = Setup(scene_file, width, height, RenderSettings(max_depth=scene.max_depth), threads=backend.threads)
    with MitsubaProcess(setup) as mitsuba:
        of = {
            "scene": str(scene_file),
            "reference": str(reference_file),
            "region": bounds.region,
            "threads": setup.threads,
        }
        comparison = _Comparison(scene, reference, bounds, mitsuba, backend, progress, _Kept(rows or Rows(), of))
        comparison.measure_mitsuba()
        comparison.sweep(families)
        chosen = [(bound, comparison.least_to(bound)) for bound in comparison.each_bound()]
    law = ErrorLaw(tuple(comparison.points))
    reached = [
        Reached(bound, None, law.to(bound)) if ours is None else Reached(bound, ours.wdpm, law.to(bound, ours.speed))
        for bound, ours in chosen
    ]
    return PeerFigures(
        scene_file,
        reference_file,
        (width, height),
        backend.threads,
        bounds,
        mitsuba.version,
        tuple(comparison.tries),
        tuple(comparison.skipped),
        comparison.refused,
        law,
        tuple(reached),
    )


class _Kept:
    """What renders of one scene took, kept as rows.

    Args:
        of: what all of them have in common, as JSON has it.
    """

    def __init__(self, rows: Rows, of: Mapping[str, Any]) -> None:
        self._rows = rows
        self._of = of

    def measured(self, what: Mapping[str, Any], measure: Callable[[], tuple[float, Cost]]) -> tuple[float, Cost]:
        """Error and cost of a render that is kept, or done now."""

        def figures() -> dict[str, Any]:
            error, cost = measure()
            return {"error": error, "wall_s": cost.wall_s, "cpu_s": cost.cpu_s}

        row = self._rows.measured({**self._of, **what}, figures)
        return row["error"], Cost(row["wall_s"], row["cpu_s"])


class _Comparison:
    """Both on one scene: what was tried, and what came out."""

    def __init__(
        self,
        scene: Scene,
        reference: Image,
        bounds: Bounds,
        mitsuba: MitsubaProcess,
        backend: Backend,
        progress: Progress,
        kept: _Kept,
    ) -> None:
        self._kept = kept
        self._warm: set[str] = set()
        self.tries: list[Try] = []
        self.skipped: list[Member] = []
        self.refused: dict[str, str] = {}
        self.points: list[Point] = []
        self._bounds = bounds
        self._progress = progress
        self._scene = scene
        self._reference = reference
        self._mitsuba = mitsuba
        self._backend = backend
        self._confirmed: dict[Member, Confirmed] = {}
        self._limit_cpu_s = bounds.limit_s * backend.threads
        # What reaches the smallest error reaches all, so nothing slower is of use.
        self._enough_s = math.inf

    def measure_mitsuba(self) -> None:
        """At more and more samples, until the smallest error is reached or the next would take too long."""
        self._progress.start("Mitsuba")
        spp = MITSUBA_SPP
        while True:
            point = self._render_mitsuba(spp, seed=spp)
            self._progress.note(f"Mitsuba: {spp} samples have an error of {point.error:.4g}")
            reached = point.error <= self._bounds.errors[-1]
            if reached or point.cost.cpu_s * MITSUBA_STEP > self._limit_cpu_s:
                return
            spp *= MITSUBA_STEP

    def sweep(self, families: Sequence[Family]) -> None:
        """Render all members that may be the fastest to some error."""
        # Little work first, of all families: so what needs a lot of it is known to be slower before it is tried.
        members = sorted(
            (member for family in families for member in family.members()), key=lambda each: (each.spp, each.photons)
        )
        self._progress.start("wdpm's settings", len(members))
        for member in members:
            if member.family.name not in self.refused:
                self._try(member)
            self._progress.advance()

    def each_bound(self) -> Iterator[float]:
        """The errors asked for, with progress."""
        self._progress.start("confirm", len(self._bounds.errors))
        for bound in self._bounds.errors:
            yield bound
            self._progress.advance()

    def least_to(self, bound: float) -> Confirmed | None:
        """The least that reaches an error, also with other seeds."""
        for guess in sorted(guesses(self.tries, bound), key=lambda each: each.cpu_s):
            member, cpu_s = guess.member, guess.cpu_s
            while member.spp <= OVERSHOOT * guess.enough_spp:
                confirmed = self._confirm(member, cpu_s)
                if confirmed.wdpm.error <= bound:
                    return confirmed
                member, cpu_s = replace(member, spp=math.ceil(SPP_STEP * member.spp)), SPP_STEP * cpu_s
        return None

    def _try(self, member: Member) -> None:
        for less in (each for each in self.tries if member.adds_to(each.member)):
            if less.cost.cpu_s > self._limit_cpu_s or less.cost.cpu_s >= self._enough_s:
                self.skipped.append(member)
                return
        try:
            done = self._render(member, 0)
        except SettingsError as error:
            self.refused[member.family.name] = str(error)
            return
        self.tries.append(done)
        smallest = self._bounds.errors[-1]
        if done.error > smallest or done.cost.cpu_s >= self._enough_s:
            return
        if self._confirm(member, done.cost.cpu_s).wdpm.error <= smallest:
            self._enough_s = done.cost.cpu_s

    def _confirm(self, member: Member, cpu_s: float) -> Confirmed:
        if member not in self._confirmed:
            spp = self._spp_in(cpu_s)
            ours, theirs = [], []
            for seed in range(1, self._bounds.rounds + 1):
                ours.append(self._render(member, seed))
                theirs.append(self._render_mitsuba(spp, TURN_SEED + len(self.points)))
            cost = Cost(
                statistics.median(each.cost.wall_s for each in ours),
                statistics.median(each.cost.cpu_s for each in ours),
            )
            error = statistics.fmean(each.error for each in ours)
            self._confirmed[member] = Confirmed(Try(member, error, cost), tuple(theirs))
        return self._confirmed[member]

    def _spp_in(self, cpu_s: float) -> int:
        """Samples of Mitsuba in about that time, of those that share a kernel."""
        longest = ErrorLaw(tuple(self.points)).longest
        spp = MITSUBA_SPP
        while spp < longest.spp and longest.cost.cpu_s * spp / longest.spp < cpu_s:
            spp *= 2
        return spp

    def _render(self, member: Member, seed: int) -> Try:
        key = {"with": member.family.name, "photons": member.photons, "spp": member.spp, "seed": seed}
        error, cost = self._kept.measured(key, lambda: self._render_warm(member, seed))
        return Try(member, error, cost)

    def _render_warm(self, member: Member, seed: int) -> tuple[float, Cost]:
        """What a render takes, once a small one of its family has loaded what it needs."""
        if member.family.name not in self._warm:
            small = Member(member.family, min(member.photons, 1000), member.family.passes)
            render_in_passes(self._scene, self._backend, small.settings(WARM_SEED, self._scene.max_depth))
            self._warm.add(member.family.name)
        settings = member.settings(seed, self._scene.max_depth)
        began, cpu_began = time.perf_counter(), time.process_time()
        image = render_in_passes(self._scene, self._backend, settings)
        cost = Cost(time.perf_counter() - began, time.process_time() - cpu_began)
        return self._error_of(image), cost

    def _render_mitsuba(self, spp: int, seed: int) -> Point:
        key = {"with": MITSUBA, "spp": spp, "seed": seed}
        point = Point(spp, *self._kept.measured(key, lambda: self._render_mitsuba_warm(spp, seed)))
        self.points.append(point)
        return point

    def _render_mitsuba_warm(self, spp: int, seed: int) -> tuple[float, Cost]:
        if MITSUBA not in self._warm:
            self._mitsuba.render(MITSUBA_SPP, WARM_SEED)
            self._warm.add(MITSUBA)
        pixels, cost = self._mitsuba.render_with_cost(spp, seed)
        return self._error_of(Image({"beauty": pixels})), cost

    def _error_of(self, image: Image) -> float:
        return compare(image, self._reference, self._bounds.region).rel_mse
