"""Renders in simulated time: what is measured of it is a cluster that is not there."""

from __future__ import annotations

import gc
import time
from collections.abc import Mapping, Sequence
from functools import partial

from wdpm.bench.simulation.cluster import Hardware, SimulatedCluster
from wdpm.bench.simulation.records import Recorder
from wdpm.cluster.plan.copies import Sharing
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import World
from wdpm.kernels.launch import Launcher
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend
from wdpm.rendering.prepare import Prepared, Source, prepare
from wdpm.scenes.flat.arrays import Triangles


class SimulatedBackend(Backend):
    """Slaves of one thread each on machines that are not there.

    Args:
        team: slaves that hold the whole scene together: 1 where each has room for all of it.

    Attributes:
        session_s: simulated seconds of all sessions.
        host_s: seconds of this process's thread that sessions took here.
        recorders: of the sessions, in their order.
    """

    def __init__(self, hardware: Hardware, team: int) -> None:
        super().__init__(slaves=hardware.slaves, threads=1, device="cpu")
        gc.collect()
        gc.freeze()  # as slaves do when they have started: a collection looks at what they have made since then alone
        self._launcher = Launcher("cpu", 1)
        self._team = team
        self.session_s = self.host_s = 0.0
        self.recorders: list[Recorder] = []
        self._cluster = SimulatedCluster(partial(_worker, self._launcher), hardware)

    def prepare(self, source: Source, settings: RenderSettings, progress: Progress) -> Prepared:
        return prepare(
            source, settings, self.slaves, self._launcher, progress, team=lambda _: Sharing(self.slaves, self._team)
        )

    def run(self, prepared: Prepared, session: Session, progress: Progress) -> SessionResult:  # noqa: ARG002
        began, now = time.thread_time(), self._cluster.clock.now
        result = self._cluster.render(session)
        self.host_s += time.thread_time() - began
        self.session_s += self._cluster.clock.now - now
        self.recorders.append(self._cluster.recorder)
        return result

    def forget(self) -> None:
        """Count sessions from here on."""
        self.session_s = self.host_s = 0.0
        self.recorders.clear()

    def close(self) -> None:
        """Let the collector look at everything again; nothing else is held that ends."""
        gc.unfreeze()


def _worker(
    launcher: Launcher, number: int, world: World, partition: Mapping[int, Triangles], holders: Sequence[int]
) -> CellWorker:
    return CellWorker(number, world, partition, holders, launcher)
