"""`wdpm bench scaling`: what more slaves cost. Work inflation: CPU seconds of all processes over those of one process.

Slaves have one thread each and share this machine's cores, so wall time says little, and CPU seconds say what as many
machines would compute together. Clusters are warm: a small render before the measured one has loaded its kernels, but
the scene is sent and photons are traced anew.
"""

from __future__ import annotations

import functools
import os
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from wdpm.bench.outputs import settings_to_dict
from wdpm.bench.rows import Rows
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.images.comparison import compare
from wdpm.images.image import Image
from wdpm.progress import Progress, SilentProgress
from wdpm.rendering.backend import Backend, ClusterBackends
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.scene_settings import settings_for
from wdpm.report.grid import Grid
from wdpm.report.tables import format_bytes, format_seconds
from wdpm.scenes.errors import ClusterError, SettingsError
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene

WARM_PHOTONS, WARM_SIZE = 1000, (32, 32)
"""Of the render that has kernels loaded."""


@dataclass(frozen=True)
class Run:
    """One render.

    Attributes:
        copies: of the scene; None without slaves.
        memory: that each slave might use [bytes]; None if nobody said.
        master_s, slaves_s: CPU seconds of this process, and of all slaves.
        wall_s: of the whole render.
        sent: bytes that slaves sent to each other and to the master.
        triangles, photons: that one slave held at most, as shares of all.
        bits_equal: whether the image is that of one process, bit for bit.
    """

    slaves: int
    copies: str | None
    master_s: float
    slaves_s: float
    wall_s: float
    sent: int
    triangles: float
    photons: float
    bits_equal: bool
    memory: int | None = None

    @property
    def cpu_s(self) -> float:
        """CPU seconds of all processes."""
        return self.master_s + self.slaves_s


@dataclass(frozen=True)
class Scaling:
    """All renders of a scene; the first is that of one process."""

    scene: str
    title: str
    runs: tuple[Run, ...]

    def inflation(self, run: Run) -> float:
        """CPU seconds of a run over those of one process."""
        return run.cpu_s / self.runs[0].cpu_s

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        runs = [asdict(run) | {"cpu_s": run.cpu_s, "inflation": self.inflation(run)} for run in self.runs]
        return {"scene": self.scene, "title": self.title, "runs": runs}

    def grid(self) -> Grid:
        """The table."""
        columns = ("slaves", "copies", "CPU", "inflation", "master", "wall", "sent", "triangles", "photons", "bits")
        notes = (
            "CPU: of all processes. inflation: that over that of one process on one thread. triangles, photons: "
            "the most that a slave held, as shares of all. A warm cluster, one thread a slave.",
        )
        return Grid(self.title, columns, tuple(self._row(run) for run in self.runs), notes)

    def _row(self, run: Run) -> tuple[str, ...]:
        times = (format_seconds(run.cpu_s), f"{self.inflation(run):.2f}", format_seconds(run.master_s))
        held = (f"{run.triangles:.0%}", f"{run.photons:.0%}", "equal" if run.bits_equal else "DIFFER")
        sent = format_bytes(run.sent) if run.slaves else "-"
        copies = f"{run.copies}, {format_bytes(run.memory)}" if run.memory else run.copies or "-"
        return (str(run.slaves), copies, *times, format_seconds(run.wall_s), sent, *held)


def measure(
    name: str,
    slaves: Sequence[int],
    copies: Sequence[Copies],
    backends: ClusterBackends,
    progress: Progress,
    *,
    size: tuple[int, int] | None = None,
    memory: int | None = None,
    rows: Rows | None = None,
    **chosen: Any,
) -> Scaling:
    """Render a scene in one process, and with each number of slaves and each way of copies.

    Args:
        memory: that each slave may use [bytes]; None for no limit.
        rows: keeps each render's figures, and has those of renders that need not be done again; None for none.

    Raises:
        SettingsError: this system does not tell other processes' CPU time, or all slaves together have not room for
            the scene.
        ClusterError: a slave was lost.
    """
    if not Path("/proc/self/stat").is_file():
        raise SettingsError("CPU seconds of other processes are read from /proc, which this system has not")
    progress.start("load")
    scene = load(name, size=size)
    settings = settings_for(scene, **{"integrator": Integrator.PHOTONS, **chosen})
    clusters = [(count, how) for how in copies for count in sorted(set(slaves) - {0})]
    progress.start(name, 1 + len(clusters))
    rows = rows or Rows()
    of = {"scene": name, "settings": settings_to_dict(settings), "size": [scene.camera.width, scene.camera.height]}
    first = {**of, "slaves": 0, "copies": None}
    images: list[Image] = []

    def alone() -> tuple[Run, Image]:
        """What all others are compared with: rendered when it is needed first."""
        run, image = _run(scene, settings, backends(0, Copies.AUTO, 1), None, None)
        images.append(image)
        return run, image

    def one() -> dict[str, Any]:
        run, image = alone()
        return asdict(run) | {"stored": image.metadata["report"]["photons"]["stored"]}

    def several(count: int, how: Copies) -> dict[str, Any]:
        progress.note(f"{name}: {count} slaves, copies {how.value}")
        image = images[0] if images else alone()[1]
        run, _ = _run(scene, settings, backends(count, how, count, memory), how, image)
        return asdict(replace(run, memory=memory))

    figures = [rows.measured(first, one)]
    progress.advance()
    for count, how in clusters:
        key = {**of, "slaves": count, "copies": how.value, **({"memory": memory} if memory else {})}
        figures.append(rows.measured(key, functools.partial(several, count, how)))
        progress.advance()
    width, height = scene.camera.width, scene.camera.height
    title = f"{name}: {width}x{height}, {settings.spp} samples, {figures[0]['stored']:,} photons"
    return Scaling(name, title, tuple(Run(**{each.name: row[each.name] for each in fields(Run)}) for row in figures))


def _run(
    scene: Scene, settings: RenderSettings, backend: Backend, copies: Copies | None, alone: Image | None
) -> tuple[Run, Image]:
    with backend:
        there = backend.processes
        warm_render(scene, settings, backend)
        began, master, others = time.perf_counter(), _cpu_of(os.getpid()), sum(map(_cpu_of, backend.processes))
        image = render_in_passes(scene, backend, settings)
        wall, master = time.perf_counter() - began, _cpu_of(os.getpid()) - master
        if (lost := len(there) - len(backend.processes)) > 0:
            raise ClusterError(f"{lost} of {len(there)} slaves were lost, and their CPU time with them; measure again")
        others = sum(map(_cpu_of, backend.processes)) - others
    report = image.metadata["report"]
    held = [slave["photons"] + slave["copies"] + slave["ghosts"] for slave in report["slaves"]]
    run = Run(
        slaves=backend.slaves,
        copies=None if copies is None else copies.value,
        master_s=master,
        slaves_s=others,
        wall_s=wall,
        sent=sum(slave["bytes_out"] for slave in report["slaves"]),
        triangles=max(slave["triangles"] for slave in report["slaves"]) / max(report["triangles"], 1),
        photons=max(held) / max(sum(report[kind]["stored"] for kind in ("photons", "caustics", "volume")), 1),
        bits_equal=alone is None or compare(pixels(image), pixels(alone)).bits_equal,
    )
    return run, image


def warm_render(scene: Scene, settings: RenderSettings, backend: Backend) -> None:
    """Have kernels loaded: a small render."""
    width, height = WARM_SIZE
    small = replace(scene, camera=replace(scene.camera, width=width, height=height, crop=None, full_size=None))
    # What so small a render leaves open it would choose differently, and so load other kernels. Another limit of
    # depth makes another scene of it for the cluster, so that nothing is left for the measured render.
    chosen = backend.prepare(scene, settings, SilentProgress()).settings
    warm = replace(chosen, photons=WARM_PHOTONS, spp=1, passes=1, pass_samples=())
    warm = replace(warm, max_depth=(settings.max_depth or 63) + 1)
    render_in_passes(small, backend, warm)


def pixels(image: Image) -> Image:
    """The layers that are the same on any cluster."""
    return Image({name: layer for name, layer in image.layers.items() if name != "cell"})


def _cpu_of(process: int) -> float:
    """CPU seconds of a process so far, on all its threads (proc_pid_stat(5): utime and stime)."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
