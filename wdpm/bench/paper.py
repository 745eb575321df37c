"""`wdpm bench paper`: the paper's table. What a local cluster holds, sends and costs, and that it changes no bit.

The paper (Xu et al.) gives, for each scene and number of slaves: speed-up, photons and triangles that a slave holds as
shares of all, and the error against one machine. Slaves here share one machine's cores, so their speed-up says what
distribution costs; their shares are those of a real cluster.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from wdpm.bench.outputs import settings_to_dict
from wdpm.bench.rows import Rows
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Integrator, RenderSettings, Routing
from wdpm.devices import available_cores
from wdpm.images.comparison import compare
from wdpm.images.image import Image
from wdpm.progress import Progress
from wdpm.rendering.backend import ClusterBackends
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.scene_settings import settings_for
from wdpm.report import report
from wdpm.report.grid import Grid
from wdpm.report.tables import format_bytes, format_seconds
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene

DEFAULT_SCENES = ("cornell-box", "atrium:100k")
DEFAULT_SLAVES = (0, 2, 4)
WORK_PHASES = ("photons", "map", "render")
"""Phases that count as the time of a render; before them a cluster starts processes and sends the scene."""

Renderer = Callable[[Scene, RenderSettings, int], Image]
"""Renders a scene with a number of slaves."""


@dataclass(frozen=True)
class Run:
    """One render.

    Attributes:
        scene: its name on the command line.
        slaves: processes of the cluster; 0 for none.
        routing: of camera rays; None without slaves, where there is but one cell.
        phases: wall-clock seconds by phase.
        speed_up: time without slaves over time of this run, of photons, map and render.
        photons: of each slave, own, copies and ghosts, as a share of all stored.
        triangles: of each slave, as a share of all.
        bytes: sent by all slaves to each other and to the master.
        mse, max_abs: of the beauty layer against the image without slaves.
        bits_equal: whether every bit of every layer but `cell` is that of the image without slaves.
    """

    scene: str
    slaves: int
    routing: str | None
    phases: dict[str, float]
    speed_up: float
    photons: tuple[float, ...]
    triangles: tuple[float, ...]
    bytes: int
    mse: float
    max_abs: float
    bits_equal: bool

    @property
    def seconds(self) -> float:
        """Of photons, map and render."""
        return work_seconds(self.phases)


@dataclass(frozen=True)
class SceneFigures:
    """All renders of one scene; the first is the one without slaves."""

    scene: str
    triangles: int
    width: int
    height: int
    spp: int
    k: int
    photons: int
    runs: tuple[Run, ...]

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        runs = [asdict(run) | {"seconds": run.seconds} for run in self.runs]
        return asdict(self) | {"runs": runs}

    def grid(self, cores: int | None = None) -> Grid:
        """The table; says so if there are fewer cores than slaves."""
        columns = ("slaves", "time", "speed-up", "photons", "triangles", "sent", "MSE", "max", "bits")
        title = (
            f"{self.scene}: {self.triangles:,} triangles, {self.photons:,} photons, k {self.k}, "
            f"{self.width}x{self.height}, {self.spp} samples"
        )
        notes = (
            "time: of photons, map and render. photons, triangles: shares of all that a slave holds, least to most, "
            "ghosts included. MSE, max: error against the image without slaves, mean square and largest.",
            *_cores_note([run.slaves for run in self.runs], available_cores() if cores is None else cores),
        )
        return Grid(title, columns, tuple(map(_row, self.runs)), notes)


def measure(
    name: str,
    slaves: Sequence[int],
    routings: Sequence[Routing],
    backends: ClusterBackends,
    progress: Progress,
    *,
    copies: Copies = Copies.NONE,
    size: tuple[int, int] | None = None,
    render: Renderer | None = None,
    rows: Rows | None = None,
    **chosen: Any,
) -> SceneFigures:
    """Render a scene without slaves and with each number of them.

    Args:
        name: of the scene: a file, or a built-in one.
        slaves: numbers of slaves; 0 is always rendered, and first.
        routings: each is tried with each number of slaves.
        backends: makes what renders, anew for each render.
        copies: of the scene, among slaves: with none it is cut among all of them, as in the paper.
        size: of the image; None for the scene's.
        render: renders; None for wdpm itself.
        rows: keeps each render's figures, and has those of renders that need not be done again; None for none.
        chosen: settings by name, see RenderSettings.
    """
    progress.start("load")
    scene = load(name, size=size)
    settings = settings_for(scene, **{"integrator": Integrator.PHOTONS, **chosen})
    render = render or (lambda scene, settings, count: _render(scene, settings, count, backends, copies))
    clusters = [(count, routing) for count in sorted(set(slaves) - {0}) for routing in routings]

    progress.start(name, 1 + len(clusters))
    rows = rows or Rows()
    measured_of = {
        "scene": name,
        "settings": settings_to_dict(settings),
        "size": [scene.camera.width, scene.camera.height],
        "copies": copies.value,
    }

    @functools.cache
    def alone() -> Image:
        """What all others are compared with: rendered when it is needed first."""
        progress.note(f"{name}: rendering without slaves")
        return render(scene, settings, 0)

    def run(slaves: int, routing: Routing | None) -> dict[str, Any]:
        first = alone()
        if routing is None:
            return _figures_of(name, 0, None, first, first)
        progress.note(f"{name}: rendering with {slaves} slaves, routing {routing.value}")
        return _figures_of(name, slaves, routing, render(scene, replace(settings, routing=routing), slaves), first)

    runs: list[dict[str, Any]] = []
    for count, routing in [(0, None), *clusters]:
        key = {**measured_of, "slaves": count, "routing": None if routing is None else routing.value}
        runs.append(rows.measured(key, functools.partial(run, count, routing)))
        progress.advance()
    first = runs[0]
    size = (first["size"][0], first["size"][1])
    stored = first["stored"]
    return SceneFigures(
        name, first["scene_triangles"], *size, settings.spp, settings.k, stored, tuple(map(_run_from, runs))
    )


def _render(
    scene: Scene, settings: RenderSettings, slaves: int, backends: ClusterBackends, copies: Copies = Copies.NONE
) -> Image:
    """By slaves of its own: those of the last render would have its photons still, and their time would be missing."""
    with backends(slaves, copies) as backend:
        return render_in_passes(scene, backend, settings)


def work_seconds(phases: dict[str, float]) -> float:
    """Of photons, map and render."""
    return sum(phases[phase] for phase in WORK_PHASES)


def _figures_of(name: str, slaves: int, routing: Routing | None, image: Image, alone: Image) -> dict[str, Any]:
    """A run as a row has it, with what is known of the scene."""
    account = _account(image)
    height, width = image.shape
    run = asdict(_run_of(name, slaves, routing, image, alone))
    return {**run, "scene_triangles": account.triangles, "size": [width, height], "stored": account.photons.stored}


def _run_from(row: Mapping[str, Any]) -> Run:
    """The run of a row."""
    values = {field.name: row[field.name] for field in fields(Run)}
    return Run(**{**values, "photons": tuple(row["photons"]), "triangles": tuple(row["triangles"])})


def _run_of(name: str, slaves: int, routing: Routing | None, image: Image, alone: Image) -> Run:
    account, single = _account(image), _account(alone)
    stored, triangles = max(account.photons.stored, 1), max(account.triangles, 1)
    difference = compare(_without_cells(image), _without_cells(alone))
    return Run(
        scene=name,
        slaves=slaves,
        routing=None if routing is None else routing.value,
        phases=account.phases,
        speed_up=work_seconds(single.phases) / work_seconds(account.phases),
        photons=tuple(slave.held / stored for slave in account.slaves),
        triangles=tuple(slave.triangles / triangles for slave in account.slaves),
        bytes=sum(slave.bytes_out for slave in account.slaves),
        mse=difference.mse,
        max_abs=difference.max_abs,
        bits_equal=difference.bits_equal,
    )


def _account(image: Image) -> report.Report:
    return report.from_dict(image.metadata["report"])


def _without_cells(image: Image) -> Image:
    """The layer `cell` shows the partition itself, and so is meant to differ."""
    return Image({name: layer for name, layer in image.layers.items() if name != "cell"})


def _cores_note(slaves: Sequence[int], cores: int) -> list[str]:
    crowded = [str(count) for count in dict.fromkeys(slaves) if count > cores]
    if not crowded:
        return []
    has = "1 core" if cores == 1 else f"{cores} cores"
    return [
        f"Cores are shared: this machine has {has} for {' and '.join(crowded)} slaves, so the speed-up of these shows "
        "what distribution costs, and not what as many machines would gain."
    ]


def _row(run: Run) -> tuple[str, ...]:
    return (
        f"{run.slaves}" if run.routing is None else f"{run.slaves} {run.routing}",
        format_seconds(run.seconds),
        f"{run.speed_up:.2f}",
        _range(run.photons),
        _range(run.triangles),
        format_bytes(run.bytes),
        f"{run.mse:.3g}",
        f"{run.max_abs:.3g}",
        "equal" if run.bits_equal else "DIFFER",
    )


def _range(shares: Sequence[float]) -> str:
    low, high = min(shares), max(shares)
    return f"{high:.2f}" if f"{low:.2f}" == f"{high:.2f}" else f"{low:.2f}-{high:.2f}"
