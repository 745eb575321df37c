"""Workers in this process: what a render without slaves has, and, with several of them, nearly every test."""

from __future__ import annotations

import random
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from wdpm.cluster.cluster_events import ClusterObserver
from wdpm.cluster.in_process import MemoryCluster
from wdpm.cluster.plan.copies import Sharing
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.work.processes.forked_tasks import TaskObserver, can_fork
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import World
from wdpm.devices import available_cores, check_threads
from wdpm.images.image import Image
from wdpm.kernels.launch import ONE_THREAD, Launcher
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend
from wdpm.rendering.compiling import Compiling
from wdpm.rendering.kernels_beside import KernelsBeside
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.prepare import Prepared, Source, prepare, scene_of
from wdpm.scenes.flat.arrays import NO_TRIANGLES, Triangles
from wdpm.scenes.model.scene import Camera, Scene

WORTH_FORKING = 1 << 17
"""Camera samples of a pass from which on processes are forked: some three quarters of a second of one core. Each fork
takes some milliseconds, and every process copies the pages that it writes to and launches kernels of its own. Of the
Cornell box half as many samples took 0.61 s of CPU time in two processes and 0.46 s in two threads of one, whose
kernels are most of it; four times as many took 6 % more, and a seventh less time."""


class _Held(NamedTuple):
    """A cluster of this process for a scene.

    Attributes:
        processes: that share its tasks.
        end: closes it when the scene is let go of.
    """

    cluster: MemoryCluster
    processes: int
    end: weakref.finalize[Any, Any]


class InProcess(Backend):
    """Renders in this process, with queues in place of sockets; and, on several cores, in processes forked from it.

    Args:
        threads: cores to use; None for all there are.
        device: "cpu" or a CUDA device, "cuda:0".
        workers: how many share the work, for tests; they take turns.
        cells: a power of two, at least `workers`; None for the least that serves them.
        team: how many of them hold the whole scene together; None for all.
        shuffle: shuffles the order in which messages arrive, for tests that it does not matter.
        observers: are told what happens.
        task_observer: is told of tasks that forked processes do.
        launcher: of all launches of this process; None for one with these threads on this device.
        compiling: when a scene's kernels are compiled, on the CPU, if they have not been.

    Raises:
        SettingsError: threads that cannot be.
    """

    def __init__(
        self,
        *,
        threads: int | None = None,
        device: str = "cpu",
        workers: int = 1,
        cells: int | None = None,
        team: int | None = None,
        shuffle: random.Random | None = None,
        observers: Sequence[ClusterObserver] = (),
        task_observer: TaskObserver | None = None,
        launcher: Launcher | None = None,
        compiling: Compiling = Compiling.FIRST,
    ) -> None:
        check_threads(threads)
        super().__init__(slaves=0, threads=threads or available_cores(), device=device)
        waits = compiling is Compiling.FIRST
        self._launcher = launcher or Launcher(device, self.threads, wait_for_kernels=waits)
        self._beside = KernelsBeside(compiling)
        self._workers = workers
        self._cells = cells
        self._team = workers if team is None else team
        self._shuffle = shuffle
        self._observers = observers
        self._task_observer = task_observer
        self._alone = workers == 1 and cells in (None, 1) and shuffle is None
        # By scene, and no longer than whoever renders it holds it: a worker has all its triangles and photons.
        self._clusters: weakref.WeakKeyDictionary[Prepared, _Held] = weakref.WeakKeyDictionary()
        self._kept: Prepared | None = None

    def prepare(self, source: Source, settings: RenderSettings, progress: Progress) -> Prepared:
        scene = scene_of(source)
        prepared = prepare(
            scene,
            settings,
            self._workers,
            self._launcher,
            progress,
            self._cells,
            self._worth(scene.camera, settings),
            lambda _: Sharing(self._workers, self._team),
        )
        self._beside.compile(prepared.uncompiled, progress.note)
        return prepared

    def run(self, prepared: Prepared, session: Session, progress: Progress) -> SessionResult:
        self._beside.before_pass()
        cluster = self._held_for(prepared)
        if prepared.pilot is not None:
            session = replace(session, partition=lambda _: NO_TRIANGLES)
        try:
            return cluster.render(session, progress, self.display, self.keeper)
        except BaseException:
            cluster.close()
            self._kept = None
            self._beside.stop()
            raise

    def close(self) -> None:
        for held in self._clusters.values():
            held.cluster.close()
        self._clusters.clear()
        self._kept = None
        self._beside.leave()

    def _held_for(self, prepared: Prepared) -> MemoryCluster:
        """The cluster that renders a scene: its own, or that of the last one if photons see no difference."""
        held = self._clusters.get(prepared)
        if held is None:
            before, self._kept = self._kept, prepared if self.keeps_scene else None
            held = None if before is None else self._passed_on(before, prepared)
            if held is None:
                cluster = self._cluster_of(prepared)
                held = _Held(cluster, self._processes_for(prepared), weakref.finalize(prepared, cluster.close))
            self._clusters[prepared] = held
        return held.cluster

    def _passed_on(self, before: Prepared, prepared: Prepared) -> _Held | None:
        """The last scene's cluster, if it has this one's geometry and as many processes; else nothing is kept."""
        held = self._clusters.pop(before, None)
        if held is None:
            return None
        held.end.detach()
        processes = self._processes_for(prepared)
        if before.session.digest != prepared.session.digest or held.processes != processes:
            held.cluster.close()
            return None
        prepared.pilot = None  # its geometry is there already
        return _Held(held.cluster, processes, weakref.finalize(prepared, held.cluster.close))

    def _worth(self, camera: Camera, settings: RenderSettings) -> int:
        """Processes that a render is worth; 1 where none may be forked now."""
        samples = camera.width * camera.height * -(-settings.spp // settings.passes)
        return self.threads if self._alone and samples >= WORTH_FORKING and can_fork(self.device) else 1

    def _processes_for(self, prepared: Prepared) -> int:
        return self._worth(prepared.session.view.camera, prepared.settings)

    def _cluster_of(self, prepared: Prepared) -> MemoryCluster:
        """A cluster for any number of sessions of a scene."""
        launcher, pilot = self._launcher, prepared.pilot
        processes = self._processes_for(prepared)

        def make_worker(
            number: int, world: World, partition: Mapping[int, Triangles], holders: Sequence[int]
        ) -> CellWorker:
            if pilot is None:
                return CellWorker(number, world, partition, holders, launcher)
            pilot.adopt(world)  # the only worker, and it has all triangles already
            return pilot

        return MemoryCluster(
            make_worker,
            self._workers if pilot is None else 1,
            shuffle=self._shuffle,
            processes=processes,
            observers=self._observers,
            task_observer=self._task_observer,
            launcher=launcher if launcher.device == "cpu" else ONE_THREAD,
        )


def render_in_process(
    scene: Scene,
    settings: RenderSettings,
    *,
    workers: int,
    cells: int | None = None,
    team: int | None = None,
    threads: int | None = None,
    shuffle: random.Random | None = None,
) -> Image:
    """Render with several workers in this process: a cluster without sockets, for tests.

    Args:
        cells: a power of two, at least `workers`; None for the least that serves them.
        team: how many of them hold the whole scene together; None for all.
        shuffle: shuffles the order in which messages arrive.
    """
    with InProcess(threads=threads, workers=workers, cells=cells, team=team, shuffle=shuffle) as backend:
        return render_in_passes(scene, backend, settings)
