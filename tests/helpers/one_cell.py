"""A worker that holds a whole small scene, and what it says of one sample."""

from __future__ import annotations

from typing import Any

from wdpm.cluster.batch import Batch, Kind, zeros
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.work.worker import CellWorker
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes.model.scene import Scene

FEW = RenderSettings(photons=500, volume_photons=500, spp=2, all_effects=True)


def ready(scene: Scene, settings: RenderSettings) -> CellWorker:
    """A worker with the only cell, in which no photon has been traced."""
    prepared = prepare(scene, settings, 1, Launcher("cpu", 1), SilentProgress())
    assert prepared.pilot is not None
    prepared.pilot.adopt(prepared.session.world)
    prepared.pilot.set_view(prepared.session.view)
    return prepared.pilot


def one(kind: Kind, **values: Any) -> Batch:
    """A batch of one item: zeros, but for some values."""
    arrays = zeros(kind, 1)
    for name, value in values.items():
        arrays[name][0] = value
    return Batch.of_task(kind, 0, 0, 0, 10_000, arrays)
