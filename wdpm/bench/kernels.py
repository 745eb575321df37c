"""`wdpm bench kernels`: one core, each kernel by turns with the best library for the same work, in one process."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.bench import gather, traversal
from wdpm.bench import photons as bench_photons
from wdpm.bench.gather import Row
from wdpm.cluster.limits import ClusterLimits
from wdpm.kernels.compile import compile_kernels
from wdpm.progress import Progress
from wdpm.report.grid import Grid
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.load import load as load_scene

FLOORS = {
    "closest hit, coherent": 1.0,
    "closest hit, incoherent": 0.7,
    "50 nearest, coherent": 1.7,
    "50 nearest, incoherent": 1.7,
}
"""Least ratios to the libraries, which a release of wdpm holds."""

MITSUBA_06_PHOTON_S = 1 / 2.0e6
MITSUBA_06_MAP_S = 0.36e-6
"""Of Mitsuba 0.6's photon mapper in the Cornell box, a stored photon: to trace it, and to put it into the map [s]. It
was measured once on the machine that wdpm was written on, so it is shown as a floor and no ratio is formed with it."""


_PEERS = {"Embree (embreex)": "Embree", "scipy cKDTree": "cKDTree"}
"""Short names, for the table."""


@dataclass(frozen=True)
class Figure:
    """One line of the table.

    Attributes:
        work: what was timed, and on how much.
        rate: whether the table shows items a second, and not the time an item.
        seconds: of wdpm, an item: a ray, a gather, a photon. None if the peer it is timed with is missing.
        peer: who did the same by turns, or None where nobody did.
        peer_seconds: of the peer, an item.
        floor_ratio: least peer_seconds / seconds.
        floor_seconds: most seconds, where the floor is not a ratio.
        missing: how to install the peer, if it is missing.
    """

    work: str
    rate: bool
    seconds: float | None
    peer: str | None = None
    peer_seconds: float | None = None
    floor_ratio: float | None = None
    floor_seconds: float | None = None
    missing: str | None = None

    @property
    def ratio(self) -> float | None:
        """How many times faster wdpm is."""
        return None if self.seconds is None or self.peer_seconds is None else self.peer_seconds / self.seconds


@dataclass(frozen=True)
class Load:
    """How much is measured.

    Attributes:
        models: scenes to trace rays in, besides the ball that is made here.
        rays: pixels of the camera that the rays start from.
        seconds: of each comparison of rays.
        photons: in the map.
        neighbours: k of the gathers, with the side of the square of as many queries.
        rounds: of each comparison of gathers.
        photon_rounds: photon tasks traced.
        photon_task_paths: paths of each.
    """

    models: tuple[str, ...] = ()
    rays: int = 1_000_000
    seconds: float = 3.0
    photons: int = 250_000
    neighbours: tuple[tuple[int, int], ...] = ((50, 200), (500, 100))
    rounds: int = 5
    photon_rounds: int = 8
    photon_task_paths: int = ClusterLimits.photon_task_paths


@dataclass(frozen=True)
class KernelFigures:
    """What was measured; compiling is apart."""

    compile_s: float
    figures: tuple[Figure, ...]

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {"compile_s": self.compile_s, "figures": [asdict(f) | {"ratio": f.ratio} for f in self.figures]}

    def grid(self) -> Grid:
        """The table."""
        notes = [
            "Ratio: how many times as fast wdpm is; the best of several rounds by turns.",
            f"Kernels were compiled or loaded in {self.compile_s:.1f} s, which is not counted.",
        ]
        if any(figure.floor_seconds is not None for figure in self.figures):
            notes.append("* Mitsuba 0.6, measured on the machine that wdpm was written on, not in this run.")
        notes += [f"Below its floor: {figure.work}." for figure in self.figures if _below(figure)]
        columns = ("work", "wdpm", "peer", "ratio", "floor")
        return Grid("Kernels, one core", columns, tuple(map(_row, self.figures)), tuple(notes))


def measure(progress: Progress, load: Load | None = None) -> KernelFigures:
    """Time everything; a library that is missing costs its lines only.

    Raises:
        SceneError: a model cannot be loaded; that is found before anything is timed.
    """
    load = load or Load()
    progress.start("load")
    models = [flatten(load_scene(model)).triangles.positions for model in load.models]
    steps: list[tuple[str, Callable[[], list[Figure]]]] = [
        ("rays", lambda: _rays(load, models)),
        *((f"{k} nearest photons", lambda k=k, side=side: _gathers(load, k, side)) for k, side in load.neighbours),
        ("photon map", lambda: _map(load)),
        ("photon tracing", lambda: _photons(load)),
    ]
    progress.start("compile")
    compile_s = _compile()
    progress.start("measure", len(steps))
    figures: list[Figure] = []
    for name, step in steps:
        progress.note(f"measuring {name}")
        figures += step()
        progress.advance()
    return KernelFigures(compile_s, tuple(figures))


def _compile() -> float:
    began = time.perf_counter()
    compile_kernels("cpu")
    wp.force_load("cpu", [wp.get_module(traversal.__name__)])
    return time.perf_counter() - began


def _rays(load: Load, models: Sequence[NDArray[np.float32]]) -> list[Figure]:
    """Of the ball, and of models as corners of triangles, shape [T, 3, 3]."""
    if find_spec("embreex") is None:
        return [_missing("closest hit and any hit", "Embree", "pip install 'wdpm[peers]'")]
    rows = traversal.measure(rays=load.rays, seconds=load.seconds)
    for triangles in models:
        rows += traversal.measure(triangles, rays=load.rays, seconds=load.seconds)
    return [_figure(row, rate=True) for row in rows]


def _gathers(load: Load, k: int, side: int) -> list[Figure]:
    if find_spec("scipy") is None:
        return [_missing(f"{k} nearest of {load.photons:,} photons", "SciPy", "pip install scipy")]
    rows = gather.measure(load.photons, k, side, load.rounds)
    return [_figure(row, rate=False) for row in rows if "nearest" in row.work]


def _map(load: Load) -> list[Figure]:
    if find_spec("scipy") is None:
        return [_missing(f"map of {load.photons:,} photons", "SciPy", "pip install scipy")]
    rows = gather.measure(load.photons, 1, 1, load.rounds)
    return [_figure(row, rate=False, floor_seconds=MITSUBA_06_MAP_S) for row in rows if row.work.startswith("map")]


def _photons(load: Load) -> list[Figure]:
    seconds = bench_photons.seconds_per_photon(load.photon_task_paths, load.photon_rounds)
    work = f"photons traced and stored in {bench_photons.SCENE}"
    return [Figure(work, True, seconds, floor_seconds=MITSUBA_06_PHOTON_S)]


def _figure(row: Row, rate: bool, floor_seconds: float | None = None) -> Figure:
    return Figure(row.work, rate, row.seconds, row.peer, row.peer_seconds, _floor_of(row.work), floor_seconds)


def _floor_of(work: str) -> float | None:
    """The floor whose words all occur: "50 nearest, coherent" in "50 nearest of 250,000 photons, coherent"."""
    what, comma, how = work.rpartition(", ")
    for name, floor in FLOORS.items():
        kind, _, order = name.rpartition(", ")
        if comma and how == order and what.startswith(kind + " "):
            return floor
    return None


def _missing(work: str, peer: str, command: str) -> Figure:
    return Figure(work, False, None, peer, missing=command)


def _below(figure: Figure) -> bool:
    if figure.floor_ratio is not None and figure.ratio is not None and figure.ratio < figure.floor_ratio:
        return True
    return figure.floor_seconds is not None and figure.seconds is not None and figure.seconds > figure.floor_seconds


def _row(figure: Figure) -> tuple[str, ...]:
    if figure.missing is not None:
        return f"{figure.work}: {figure.peer} not installed: {figure.missing}", "-", "-", "-", "-"
    peer = "-"
    if figure.peer is not None:
        peer = f"{_PEERS.get(figure.peer, figure.peer)} {_speed(figure.peer_seconds, figure.rate)}"
    floor = "-" if figure.floor_ratio is None else f"{figure.floor_ratio:.1f}"
    if figure.floor_seconds is not None:
        floor = _speed(figure.floor_seconds, figure.rate) + " *"
    ratio = "-" if figure.ratio is None else f"{figure.ratio:.2f}"
    return figure.work, _speed(figure.seconds, figure.rate), peer, ratio, floor


def _speed(seconds: float | None, rate: bool) -> str:
    if seconds is None:
        return "-"
    return f"{1e-6 / seconds:.2f} M/s" if rate else f"{1e6 * seconds:.2f} µs"
