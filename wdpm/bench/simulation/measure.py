"""`wdpm bench scaling --simulate`: renders of a scene by clusters of many sizes, in simulated time."""

from __future__ import annotations

import functools
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from wdpm.bench.outputs import settings_to_dict
from wdpm.bench.rows import Rows
from wdpm.bench.scaling import pixels, warm_render
from wdpm.bench.simulation import message_costs
from wdpm.bench.simulation.backend import SimulatedBackend
from wdpm.bench.simulation.cluster import Hardware
from wdpm.bench.simulation.figures import LOSSES, WAITS, Run, Simulation
from wdpm.bench.simulation.machines import Link
from wdpm.bench.simulation.message_costs import MessageCosts
from wdpm.bench.simulation.records import SETTING_UP, Recorder
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.images.comparison import compare
from wdpm.images.image import Image
from wdpm.progress import Progress
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.scene_settings import settings_for
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene


@dataclass(frozen=True)
class Description:
    """Machines that are not there.

    Attributes:
        machines: over which slaves are spread in turn; None for one each.
        cores: of each.
        link: that joins them.
        apart: whether the master has a machine of its own, the first, instead of sharing the first slave's.
    """

    link: Link
    machines: int | None = None
    cores: float = 1.0
    apart: bool = False

    def words(self) -> str:
        """For people."""
        where = "a machine each" if self.machines is None else f"on {self.machines} machines"
        link = f"{self.link.bytes_per_s * 8 / 1e9:g} Gbit/s and {self.link.latency_s * 1e6:g} us between machines"
        master = "on one of its own" if self.apart else "on the first"
        cores = "core" if self.cores == 1 else "cores"
        return f"slaves of one thread, {where} with {self.cores:g} {cores}, the master {master}; {link}"

    def hardware(self, slaves: int, costs: MessageCosts) -> Hardware:
        """For so many slaves."""
        machines = min(self.machines or slaves, slaves)
        return Hardware(slaves, machines + self.apart, self.cores, self.link, costs, apart=self.apart)


def simulate(
    name: str,
    slaves: Sequence[int],
    copies: Sequence[Copies],
    description: Description,
    progress: Progress,
    *,
    size: tuple[int, int] | None = None,
    rows: Rows | None = None,
    **chosen: Any,
) -> Simulation:
    """Render a scene in one process, and with each number of slaves that are simulated and each way of copies.

    With copies every slave has room for the whole scene.

    Args:
        rows: keeps each render's figures, and has those of renders that need not be done again; None for none.
        chosen: settings by name, see RenderSettings.
    """
    progress.start("load")
    scene = load(name, size=size)
    settings = settings_for(scene, **{"integrator": Integrator.PHOTONS, **chosen})
    clusters = [(count, how) for how in copies for count in sorted(set(slaves) - {0})]
    progress.start(name, 1 + len(clusters))
    rows = rows or Rows()
    bench = _Bench(scene, settings, description, message_costs.measure())
    of = {"scene": name, "settings": settings_to_dict(settings), "size": [scene.camera.width, scene.camera.height]}
    first = rows.measured({**of, "simulated": 0}, bench.one)
    progress.advance()
    runs: list[Run] = []
    for count, how in clusters:
        progress.note(f"{name}: {count} slaves, copies {how.value}, simulated")
        key = {**of, "simulated": count, "copies": how.value, "hardware": description.words()}
        row = rows.measured(key, functools.partial(bench.several, count, how, first["seconds"]))
        runs.append(Run(**{each.name: row[each.name] for each in fields(Run)}))
        progress.advance()
    width, height = scene.camera.width, scene.camera.height
    title = (
        f"{name}: {width}x{height}, {settings.spp} samples, {first['stored']:,} photons; "
        f"{first['seconds']:.1f} s on one machine"
    )
    return Simulation(name, title, description.words(), tuple(runs))


class _Bench:
    """Renders one scene, alone and by simulated clusters."""

    def __init__(self, scene: Scene, settings: RenderSettings, description: Description, costs: MessageCosts) -> None:
        self._scene, self._settings = scene, settings
        self._description, self._costs = description, costs
        self._alone: Image | None = None

    def one(self) -> dict[str, Any]:
        """One process on one thread."""
        with InProcess(threads=1) as backend:
            warm_render(self._scene, self._settings, backend)
            began = time.thread_time()
            self._alone = render_in_passes(self._scene, backend, self._settings)
            seconds = time.thread_time() - began
        return {"seconds": seconds, "stored": self._alone.metadata["report"]["photons"]["stored"]}

    def several(self, count: int, copies: Copies, alone_s: float) -> dict[str, Any]:
        """A cluster; what one process takes is known."""
        if self._alone is None:
            self.one()
        team = 1 if copies is Copies.AUTO else count
        hardware = self._description.hardware(count, self._costs)
        with SimulatedBackend(hardware, team) as backend:
            warm_render(self._scene, self._settings, backend)
            backend.forget()
            began = time.thread_time()
            image = render_in_passes(self._scene, backend, self._settings)
            host_s = time.thread_time() - began
        run = _run_of(backend, image, hardware, copies, alone_s, host_s)
        equal = self._alone is not None and compare(pixels(image), pixels(self._alone)).bits_equal
        return asdict(replace(run, bits_equal=equal))


def _run_of(
    backend: SimulatedBackend, image: Image, hardware: Hardware, copies: Copies, alone_s: float, host_s: float
) -> Run:
    plan_s = host_s - backend.host_s  # all that is no session is the master's alone
    seconds = plan_s + backend.session_s
    report = image.metadata["report"]
    held = [slave["photons"] + slave["copies"] + slave["ghosts"] for slave in report["slaves"]]
    stored = sum(report[kind]["stored"] for kind in ("photons", "caustics", "volume"))
    spent = [phase.spent for one in backend.recorders for phase in one.phases]
    computing = np.sum([each.computing for each in spent], axis=0)
    wires = np.sum([each.wires for each in spent], axis=0)
    return Run(
        slaves=hardware.slaves,
        machines=hardware.machines,
        copies=copies.value,
        seconds=seconds,
        phases=_phases(backend.recorders),
        alone_s=alone_s,
        lost=losses(backend.recorders, hardware, plan_s, alone_s),
        wire=float(wires.max()) / seconds,
        balance=float(computing.mean() / computing.max()),
        sent=sum(sum(one.sizes.values()) for one in backend.recorders),
        messages=sum(sum(one.messages.values()) for one in backend.recorders),
        triangles=max(slave["triangles"] for slave in report["slaves"]) / max(report["triangles"], 1),
        photons=max(held) / max(stored, 1),
        bits_equal=False,
        host_s=host_s,
    )


def _phases(recorders: Sequence[Recorder]) -> dict[str, float]:
    seconds: dict[str, float] = {}
    for one in recorders:
        for phase in one.phases:
            seconds[phase.name] = seconds.get(phase.name, 0.0) + phase.seconds
    return seconds


def losses(recorders: Sequence[Recorder], hardware: Hardware, plan_s: float, alone_s: float) -> Mapping[str, float]:
    """Shares of the machines' time that did not go to what one machine does alone: with that, they add up to 1."""
    cores = min(hardware.machines * hardware.cores, hardware.slaves)
    lost = dict.fromkeys(LOSSES, 0.0)
    lost["plan"] = plan_s * (cores - 1)
    computed, total = plan_s, plan_s * cores
    for phase in (phase for one in recorders for phase in one.phases):
        computed += sum(phase.spent.computing)
        lost["messages"] += sum(phase.spent.messages) + phase.spent.master
        name = "setup" if phase.name == SETTING_UP else phase.name
        lost[name if name in WAITS else "render"] += phase.seconds * cores - phase.spent.busy_s
        total += phase.seconds * cores
    lost["repeated"] = computed - alone_s
    return {name: seconds / total for name, seconds in lost.items()}
