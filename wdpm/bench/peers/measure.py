"""`wdpm bench peers`: time to an error, of wdpm and of Mitsuba 3's path tracer, in one run.

wdpm gets there by several ways (grid.py): the fastest of a fixed grid of settings, what it takes by default, and its
own path tracer. Members of a way are rendered once each. From these follows, for each error, which settings and how
many samples should reach it in the least time (guess.py); that is rendered with other seeds, and the figures are of
these renders alone: a render that was lucky is not what is shown. They go by turns with renders of Mitsuba that take
about as long, which set its speed; how many samples it needs is in law.py. Both are warm, with the same longest path.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from wdpm.bench.peers.figures import Confirmed, PeerFigures, Reached, Try, mean_try
from wdpm.bench.peers.grid import DEFAULT_WAYS, FEW_PATHS, Member, Way
from wdpm.bench.peers.guess import guesses
from wdpm.bench.peers.law import ErrorLaw, Point
from wdpm.bench.peers.mitsuba import Cost, MitsubaProcess, Setup
from wdpm.bench.peers.target import Bounds, RelMse, Target, rel_mse_of, targets_of
from wdpm.bench.rows import Rows
from wdpm.cluster.render_settings import Integrator
from wdpm.goal.clock import cpu_seconds
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

WARM_SEED = 2**20
"""Seed of the images that only warm up."""

TURN_SEED, SAMPLES_SEED = 2**16, 2**18
"""Seeds of the renders by turns, and of those whose errors are to be reached, are above these: none is used twice."""


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
    ways: Sequence[Way] = DEFAULT_WAYS,
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
    setup = Setup(scene_file, width, height, scene.max_depth, backend.threads)
    of = {
        "scene": str(scene_file),
        "reference": str(reference_file),
        "region": bounds.region,
        "trim": bounds.trim,
        "threads": setup.threads,
    }
    with MitsubaProcess(setup) as mitsuba:
        renders = _Renders(scene, reference, bounds, mitsuba, backend, _Kept(rows or Rows(), of))
        measure_mitsuba(renders, bounds, progress)
        targets = targets_of(bounds, renders.points)
        chosen = [(way, _Comparison(renders, targets, bounds, progress, way)) for way in ways]
        for target in targets:
            for _, comparison in chosen:
                comparison.confirm(target)
        reached = [comparison.reached(target) for target in targets for _, comparison in chosen]
    tried = {done.member: done for _, comparison in chosen for done in comparison.tries}
    skipped = {member: None for _, comparison in chosen for member in comparison.skipped if member not in tried}
    return PeerFigures(
        scene_file,
        reference_file,
        (width, height),
        backend.threads,
        bounds,
        mitsuba.version,
        tuple(tried.values()),
        tuple(skipped),
        renders.refused,
        tuple(renders.points),
        tuple(ways),
        tuple(reached),
    )


def measure_mitsuba(renders: _Renders, bounds: Bounds, progress: Progress) -> None:
    """Mitsuba at more and more samples, until all errors are reached or the next image would take too long.

    The numbers of samples whose errors are to be reached are rendered as often as a choice is confirmed, or as often
    as there is time for.
    """
    progress.start("Mitsuba")
    limit_cpu_s = bounds.limit_s * renders.threads
    least = min(bounds.errors, default=math.inf)
    spp, point = MITSUBA_SPP, renders.mitsuba(MITSUBA_SPP, seed=MITSUBA_SPP)
    while True:
        progress.note(f"Mitsuba: {spp:,} samples have an error of {point.error.whole:.4g}")
        reached = max(point.error.whole, point.error.trimmed) <= least
        if reached or point.cost.cpu_s * MITSUBA_STEP > limit_cpu_s:
            break
        spp *= MITSUBA_STEP
        point = renders.mitsuba(spp, seed=spp)
    for spp in bounds.samples:
        longest = max(renders.points, key=lambda point: point.spp)
        of_one = longest.cost.cpu_s * spp / longest.spp
        for number in range(min(bounds.rounds, int(limit_cpu_s / of_one))):
            point = renders.mitsuba(spp, seed=SAMPLES_SEED * (number + 1) + spp)
            progress.note(f"Mitsuba: {spp:,} samples have an error of {point.error.whole:.4g}")


class _Kept:
    """What renders of one scene took, kept as rows.

    Args:
        of: what all of them have in common, as JSON has it.
    """

    def __init__(self, rows: Rows, of: Mapping[str, Any]) -> None:
        self._rows = rows
        self._of = of

    def measured(self, what: Mapping[str, Any], measure: Callable[[], _Measured]) -> _Measured:
        """A render that is kept, or done now."""

        def figures() -> dict[str, Any]:
            return asdict(measure())

        row = self._rows.measured({**self._of, **what}, figures)
        return _Measured(RelMse(**row["errors"]), Cost(**row["cost"]), row["chose"])


@dataclass(frozen=True)
class _Measured:
    """A render, see Try."""

    errors: RelMse
    cost: Cost
    chose: str = ""


class _Renders:
    """Renders of one scene by both.

    Attributes:
        threads: of each.
        points: all that Mitsuba has rendered.
        refused: family -> why wdpm does not render the scene that way.
    """

    def __init__(
        self,
        scene: Scene,
        reference: Image,
        bounds: Bounds,
        mitsuba: MitsubaProcess,
        backend: Backend,
        kept: _Kept,
    ) -> None:
        self.threads = backend.threads
        self.points: list[Point[RelMse]] = []
        self.refused: dict[str, str] = {}
        self._kept = kept
        self._warm: set[str] = set()
        self._bounds = bounds
        self._scene = scene
        self._reference = reference
        self._mitsuba = mitsuba
        self._backend = backend
        self._confirmed: dict[Member, Confirmed] = {}

    def wdpm(self, member: Member, seed: int) -> Try:
        """A member of the grid, or one like it."""
        key = {"with": member.family.name, "photons": member.photons, "spp": member.spp, "seed": seed}
        done = self._kept.measured(key, lambda: self._wdpm_warm(member, seed))
        return Try(member, done.errors, done.cost, done.chose)

    def mitsuba(self, spp: int, seed: int) -> Point[RelMse]:
        """So many samples of Mitsuba."""
        key = {"with": MITSUBA, "spp": spp, "seed": seed}
        done = self._kept.measured(key, lambda: self._mitsuba_warm(spp, seed))
        self.points.append(Point(spp, done.errors, done.cost))
        return self.points[-1]

    def confirmed(self, member: Member, cpu_s: float) -> Confirmed:
        """A member with other seeds, by turns with Mitsuba.

        Args:
            cpu_s: that it is expected to take.
        """
        if member not in self._confirmed:
            spp = self._spp_in(cpu_s)
            ours, theirs = [], []
            for seed in range(1, self._bounds.rounds + 1):
                ours.append(self.wdpm(member, seed))
                theirs.append(self.mitsuba(spp, TURN_SEED + len(self.points)))
            self._confirmed[member] = Confirmed(mean_try(ours, member), tuple(theirs))
        return self._confirmed[member]

    def of(self, way: Way) -> list[Confirmed]:
        """What was rendered with other seeds, of one way."""
        return [done for member, done in self._confirmed.items() if member.family in way.families]

    def _spp_in(self, cpu_s: float) -> int:
        """Samples of Mitsuba in about that time, of those that share a kernel."""
        longest = max(self.points, key=lambda point: point.spp)
        spp = MITSUBA_SPP
        while spp < longest.spp and longest.cost.cpu_s * spp / longest.spp < cpu_s:
            spp *= 2
        return spp

    def _wdpm_warm(self, member: Member, seed: int) -> _Measured:
        """What a render takes, once one like it has loaded what it needs."""
        name = member.family.name
        if name not in self._warm:
            small = Member(member.family, min(member.photons, 1000), member.family.passes)
            image = render_in_passes(self._scene, self._backend, small.settings(WARM_SEED, self._scene.max_depth))
            self._warm |= {name, name + _chosen(image)}
        while True:
            began, cpu_began = time.perf_counter(), cpu_seconds()
            image = render_in_passes(self._scene, self._backend, member.settings(seed, self._scene.max_depth))
            cost = Cost(time.perf_counter() - began, cpu_seconds() - cpu_began)
            chosen = _chosen(image)
            if name + chosen in self._warm:
                errors = rel_mse_of(image, self._reference, self._bounds)
                return _Measured(errors, cost, chosen if member.family.is_plain else "")
            self._warm.add(name + chosen)  # more samples than before: another way was chosen, with kernels of its own

    def _mitsuba_warm(self, spp: int, seed: int) -> _Measured:
        if MITSUBA not in self._warm:
            self._mitsuba.render(MITSUBA_SPP, WARM_SEED)
            self._warm.add(MITSUBA)
        pixels, cost = self._mitsuba.render(spp, seed)
        return _Measured(rel_mse_of(Image({"beauty": pixels}), self._reference, self._bounds), cost)


def _chosen(image: Image) -> str:
    """How an image was rendered, in words."""
    settings = image.metadata["settings"]
    integrator = Integrator(settings["integrator"])
    has_indirect = "indirect" not in integrator.algorithm.ignored
    return f"{integrator.value}, {settings['indirect']}" if has_indirect else integrator.value


class _Comparison:
    """One way on one scene: what was tried, and what reaches an error.

    Attributes:
        tries, skipped: see PeerFigures.
    """

    def __init__(
        self, renders: _Renders, targets: Sequence[Target], bounds: Bounds, progress: Progress, way: Way
    ) -> None:
        self.tries: list[Try] = []
        self.skipped: list[Member] = []
        self._renders = renders
        self._targets = targets
        self._progress = progress
        self._way = way
        self._least: dict[Target, Confirmed] = {}
        self._limit_cpu_s = bounds.limit_s * renders.threads
        # What reaches all errors reaches each, so nothing slower is of use.
        self._enough_s = math.inf
        self._sweep()

    def confirm(self, target: Target) -> None:
        """Look for what reaches an error, also with other seeds."""
        self._progress.start(f"confirm {self._way.name}: {target.name}")
        for guess in sorted(guesses(self.tries, target), key=lambda each: each.cpu_s):
            member, cpu_s = guess.member, guess.cpu_s
            while member.spp <= OVERSHOOT * guess.enough_spp:
                confirmed = self._renders.confirmed(member, cpu_s)
                if target.reached_by(confirmed.wdpm.errors):
                    self._least[target] = confirmed
                    return
                member, cpu_s = replace(member, spp=math.ceil(SPP_STEP * member.spp)), SPP_STEP * cpu_s

    def reached(self, target: Target) -> Reached:
        """The least that reaches an error, when what reaches any of them was looked for."""
        ours, points = self._least_to(target), self._renders.points
        law = target.law(points)
        speed = None if ours is None else ours.speed
        theirs = law.to(target.error, speed) if target.spp is None else law.with_samples(target.spp, speed)
        own = None
        if ours is None and self._way.families == (FEW_PATHS,) and self.tries:
            own = self._own_law(target).beyond(target.error)
        lucky = ours is None and any(target.reached_by(done.errors) for done in self.tries)
        others = [confirmed.wdpm for confirmed in self._renders.of(self._way)] if lucky else []
        rejected = min(others, key=lambda done: target.error_in(done.errors), default=None)
        return Reached(target, self._way.name, None if ours is None else ours.wdpm, own, theirs, rejected)

    def _own_law(self, target: Target) -> ErrorLaw:
        return target.law([Point(done.member.spp, done.errors, done.cost) for done in self.tries])

    def _sweep(self) -> None:
        """Render all members that may be the fastest to some error."""
        # Little work first, of all families: so what needs a lot of it is known to be slower before it is tried.
        members = sorted(
            (member for family in self._way.families for member in family.members()),
            key=lambda each: (each.spp, each.photons),
        )
        self._progress.start(f"wdpm: {self._way.name}", len(members))
        for member in members:
            if member.family.name not in self._renders.refused:
                self._try(member)
            self._progress.advance()

    def _least_to(self, target: Target) -> Confirmed | None:
        """What was found; or else what was confirmed for another error, and reaches this one as well."""
        if target in self._least:
            return self._least[target]
        enough = [each for each in self._renders.of(self._way) if target.reached_by(each.wdpm.errors)]
        return min(enough, key=lambda each: each.wdpm.cost.cpu_s, default=None)

    def _try(self, member: Member) -> None:
        for less in (each for each in self.tries if member.adds_to(each.member)):
            if less.cost.cpu_s > self._limit_cpu_s or less.cost.cpu_s >= self._enough_s:
                self.skipped.append(member)
                return
        try:
            done = self._renders.wdpm(member, 0)
        except SettingsError as error:
            self._renders.refused[member.family.name] = str(error)
            return
        self.tries.append(done)
        if not self._reaches_all(done) or done.cost.cpu_s >= self._enough_s:
            return
        if self._reaches_all(self._renders.confirmed(member, done.cost.cpu_s).wdpm):
            self._enough_s = done.cost.cpu_s

    def _reaches_all(self, done: Try) -> bool:
        return all(target.reached_by(done.errors) for target in self._targets)
