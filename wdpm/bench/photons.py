"""How fast one core traces photons: paths through the Cornell box, as a slave traces the tasks that it is handed."""

from __future__ import annotations

import time

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.cluster.task import PhotonTask
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes.load import load

SCENE = "cornell-box"


def seconds_per_photon(task_paths: int = ClusterLimits.photon_task_paths, rounds: int = 8) -> float:
    """Time of one core for each photon stored [s], launches and bookkeeping included; the best of some tasks counts.

    Args:
        task_paths: photon paths a task.
        rounds: tasks.
    """
    launcher = Launcher("cpu", threads=1)
    prepared = prepare(load(SCENE), RenderSettings(integrator=Integrator.PHOTONS), 1, launcher, SilentProgress())
    worker = prepared.pilot
    assert worker is not None  # one worker, one cell
    worker.adopt(prepared.session.world)
    best = float("inf")
    for number in range(rounds):
        task = PhotonTask(number, number * task_paths, (number + 1) * task_paths)
        began = time.thread_time()  # one thread traces: this one
        worker.start(task)
        seconds = time.thread_time() - began
        best = min(best, seconds / sum(int(cell.store.count.sum()) for cell in worker.cells.values()))
        worker.forget_photons()
    return best
