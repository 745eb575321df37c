"""`wdpm accuracy`, start to end: check, plan, trace the reference, render the points, write the results."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from wdpm.accuracy.csv import to_csv
from wdpm.accuracy.error import LEAST_SEEDS
from wdpm.accuracy.facts import Facts, find_facts
from wdpm.accuracy.knobs import Sweep
from wdpm.accuracy.page import page_of
from wdpm.accuracy.plan import (
    DEFAULT_BUDGET_S,
    REFERENCE_SHARE,
    CostModel,
    default_points,
    left_out_in_words,
    plan_in_words,
    total_seconds,
)
from wdpm.accuracy.points import LEFT_OPEN, Point, Points, command_of, plan_points
from wdpm.accuracy.reference import Reference, read_reference, trace_reference, traced_settings
from wdpm.accuracy.render import PointRenderer
from wdpm.accuracy.result import Accuracy, curves_of, figures_of, front_of, reference_noise, worst_share
from wdpm.accuracy.store import Store, make_folder, plain_settings
from wdpm.accuracy.uses import idle_by_settings, refuse_idle
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.cluster.versions import versions
from wdpm.devices import available_cores
from wdpm.images.files import write_bytes
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend, Backends
from wdpm.rendering.scene_settings import settings_for
from wdpm.report.grid import machine
from wdpm.scenes.errors import ImageError, SettingsError
from wdpm.scenes.load import load

MOST_TRIM = 0.1

MODEL = "cost.json"
"""What the trial told, which the plan of a default sweep depends on."""


@dataclass(frozen=True)
class Request:
    """What is asked for.

    Attributes:
        scene, definitions, size, lenient: as on the command line.
        chosen: settings of the base, by name.
        slaves: of the base.
        sweeps: none for the default ones.
        seeds: of each point.
        budget: of the default sweep, with the reference [s]; None for five minutes.
        references: one image, two independent ones, or none.
        reference_time: for a reference of our own [s]; None for a share of the budget.
        clock: what counts as the time of a point.
        trim: share of the pixels to leave out of errors.
        folder: of the results.
    """

    scene: str
    folder: Path
    definitions: tuple[tuple[str, str], ...] = ()
    size: tuple[int, int] | None = None
    chosen: Mapping[str, Any] = field(default_factory=dict)
    slaves: int = 0
    sweeps: tuple[Sweep, ...] = ()
    seeds: int = LEAST_SEEDS
    budget: float | None = None
    references: tuple[Path, ...] = ()
    reference_time: float | None = None
    clock: str = "wall"
    trim: float = 0.0
    lenient: bool = False

    @property
    def reference_seconds(self) -> float:
        """For a reference of our own."""
        return self.reference_time or REFERENCE_SHARE * (self.budget or DEFAULT_BUDGET_S)

    def words(self) -> list[str]:
        """The scene, as `wdpm render` has it."""
        words = [self.scene]
        for name, value in self.definitions:
            words += ["-D", f"{name}={value}"]
        if self.size is not None:
            words += ["--size", f"{self.size[0]}x{self.size[1]}"]
        return [*words, "--lenient"] if self.lenient else words


def measure(request: Request, backends: Backends, progress: Progress) -> Accuracy:
    """Render all that is not there yet, and write the results into the folder.

    Args:
        backends: makes what renders, all of them with as many threads of the same device.

    Raises:
        SceneError, SettingsError, ImageError, ClusterError: see their messages. Renders that are done are kept.
    """
    _check(request)
    progress.start("load")
    scene = load(request.scene, defines=dict(request.definitions), size=request.size, lenient=request.lenient)
    # Sweeps are of photons: which integrator suits each point would be another question.
    by_photons = {"integrator": Integrator.PHOTONS}
    defaults = settings_for(scene, **by_photons)
    base = Point(settings_for(scene, **(by_photons | dict(request.chosen))), request.slaves)
    size = (scene.camera.width, scene.camera.height)
    given = read_reference(request.references, size) if request.references else None
    plan_points(base, request.sweeps, dict.fromkeys(LEFT_OPEN, 1))
    refuse_idle(request.sweeps, idle_by_settings(base.settings))
    make_folder(request.folder)
    with PointRenderer(scene, backends) as renderer:
        here = renderer.backend(0)

        @cache
        def facts_of(settings: RenderSettings) -> Facts:
            return find_facts(scene, settings, here, progress)

        facts = facts_of(base.settings)
        refuse_idle(request.sweeps, facts.idle)
        store = Store(request.folder, _identity(here, facts))
        points = _plan(request, base, facts_of, store, renderer, given is None, progress)
        reference = given or _own_reference(request, points, store, renderer, progress)
        seeds = [(base.settings.seed + number) % 2**32 for number in range(request.seeds)]
        _render_all(points, seeds, store, renderer, progress)
        compile_seconds = renderer.compile_seconds
    threads = None if here.threads == available_cores() else here.threads
    figures = figures_of(
        points,
        store,
        seeds,
        reference.truth,
        lambda point: command_of(point, seeds[0], request.words(), defaults, threads),
        request.clock,
        request.trim,
        progress,
    )
    found = Accuracy(
        scene=request.scene,
        width=size[0],
        height=size[1],
        seeds=tuple(seeds),
        reference=reference.words,
        reference_noise=reference_noise(reference.truth),
        clock=request.clock,
        compile_seconds=compile_seconds,
        trim=request.trim,
        worst=worst_share([store.image(points.base, seed).pixels for seed in seeds], reference.truth),
        machine=machine() | {"threads": here.threads, "device": here.device},
        points=figures,
        curves=curves_of(points),
        front=front_of(figures),
    )
    _write(request.folder, found, reference)
    return found


def renders_in_order(points: Points, seeds: Sequence[int]) -> list[tuple[Point, int]]:
    """All renders, seed by seed and otherwise at random, the same way every time.

    A machine that grows slower or faster while it is measured so bends no curve.
    """
    order = random.Random(0)
    renders = []
    for seed in seeds:
        shuffled = list(points.points)
        order.shuffle(shuffled)
        renders += [(point, seed) for point in shuffled]
    return renders


def _check(request: Request) -> None:
    """What can be found wrong before the scene is read."""
    RenderSettings(**request.chosen)
    if request.seeds < LEAST_SEEDS:
        raise SettingsError(f"--seeds is {request.seeds}; noise and bias come apart with {LEAST_SEEDS} or more")
    if not 0 <= request.trim <= MOST_TRIM:
        raise SettingsError(
            f"--trim is {request.trim}; expected a share of the pixels from 0 to {MOST_TRIM}, like 0.001"
        )
    if len(request.references) > 2:
        raise SettingsError(f"--reference was given {len(request.references)} times; expected one image or two halves")
    if request.references and request.reference_time is not None:
        raise SettingsError("--reference-time is for a reference of our own; leave it or --reference out")
    if request.sweeps and request.budget is not None and request.references:
        raise SettingsError("--budget is for the default sweep; leave it or --sweep out")


def _identity(backend: Backend, facts: Facts) -> dict[str, Any]:
    return {**facts.identity, "threads": backend.threads, "device": backend.device, "versions": versions()}


def _plan(
    request: Request,
    base: Point,
    facts_of: Callable[[RenderSettings], Facts],
    store: Store,
    renderer: PointRenderer,
    trace: bool,
    progress: Progress,
) -> Points:
    """The points, after a short render that tells what they will cost; says what the plan is."""
    facts = facts_of(base.settings)
    model = _model(request, base, facts.light_samples, store, renderer, progress)
    reference = request.reference_seconds if trace else 0.0
    if request.sweeps:
        points = plan_points(base, request.sweeps, facts.chosen)
    else:
        left = (request.budget or DEFAULT_BUDGET_S) - reference
        points = default_points(base, model, facts_of, request.seeds, left)
    seconds = total_seconds(points, model, request.seeds, facts.maps) + reference
    lines = plan_in_words(points, request.seeds, seconds, reference, base)
    for line in lines if request.sweeps else [*lines, *left_out_in_words(points, facts.idle)]:
        progress.note(line)
    return points


def _model(
    request: Request, base: Point, light_samples: int, store: Store, renderer: PointRenderer, progress: Progress
) -> CostModel:
    """From a short render; or the one from the last time, so that a sweep that goes on has the same points."""
    path = request.folder / MODEL
    digest = store.digest("model", plain_settings(base.settings, 0))
    found = read_model(path, digest)
    if found is None:
        progress.start("trial")
        trial = Point(_small(base.settings), 0)
        record = renderer.render(trial, base.settings.seed)[1]
        found = CostModel.fitted_to(trial, record, light_samples)
        write_bytes(json.dumps({"digest": digest, **asdict(found)}, indent=2).encode(), path)
    return found


def read_model(path: Path, digest: str) -> CostModel | None:
    """What an earlier sweep measured; None if there was none, or of another scene. Raises ImageError: it is broken."""
    if not path.is_file():
        return None
    try:
        data = json.loads(path.read_text())
        return CostModel(**data) if data.pop("digest") == digest else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ImageError(f"{path}: is broken ({error}); delete it to have it measured again") from None


def _own_reference(
    request: Request, points: Points, store: Store, renderer: PointRenderer, progress: Progress
) -> Reference:
    settings = traced_settings(points.base.settings)
    # Settings of quality change nothing in a path-traced image but its noise.
    kept = {name: plain_settings(settings, 0)[name] for name in ("max_depth", "without", "light_samples")}
    return trace_reference(
        lambda chosen: renderer.render(Point(chosen), chosen.seed)[0],
        settings,
        request.reference_seconds,
        request.folder,
        store.digest("reference", kept),
        progress,
    )


def _render_all(
    points: Points, seeds: Sequence[int], store: Store, renderer: PointRenderer, progress: Progress
) -> None:
    renders = renders_in_order(points, seeds)
    left = []
    for point, seed in renders:
        if store.find(point, seed) is None:
            left.append((point, seed))
        else:
            store.image(point, seed)  # one that is broken is told now, not after hours of rendering
    if len(left) < len(renders):
        progress.note(f"{len(renders) - len(left)} of {len(renders)} renders are there already")
    progress.start("sweep", len(left))
    for point, seed in left:
        store.keep(point, seed, *renderer.render(point, seed))
        progress.advance()


def _write(folder: Path, found: Accuracy, reference: Reference) -> None:
    write_bytes(to_csv(found).encode(), folder / "points.csv")
    write_bytes(found.to_json().encode(), folder / "points.json")
    write_bytes(page_of(found, folder, reference.truth).encode(), folder / "index.html")


def _small(settings: RenderSettings) -> RenderSettings:
    """A trial: large enough to take the time of."""
    return replace(settings, spp=max(settings.spp // 8, 1), passes=1, pass_samples=(), band=1.0, inexact=False)
