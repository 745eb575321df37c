"""Backends: who renders is handed one, and holds what it has of a scene no longer than it needs it."""

from __future__ import annotations

import gc
from dataclasses import replace

import numpy as np
import pytest

import wdpm
from wdpm.cluster.work.worker import CellWorker
from wdpm.devices import available_cores
from wdpm.local_backend import backend_here
from wdpm.rendering.backend import Backend
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.pass_plan import PassPlan
from wdpm.rendering.passes import PassRenderer, render_in_passes
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import SettingsError

FEW = wdpm.RenderSettings(photons=500, spp=2)
ALL = PassPlan(0, 0, FEW.spp)


def test_one_backend_renders_scenes_by_turns() -> None:
    """Each with its own photons, whichever was prepared or rendered last."""
    scenes = [cornell_box((8, 8)), cornell_box((12, 6))]
    alone = [render_in_passes(scene, InProcess(threads=1), FEW) for scene in scenes]
    backend = InProcess(threads=1)
    renderers = [PassRenderer(scene, backend, FEW) for scene in scenes]
    for number in (0, 1, 0):
        layers = renderers[number].render(ALL).layers
        assert layers.keys() == alone[number].layers.keys()
        for name, layer in alone[number].layers.items():
            np.testing.assert_array_equal(layers[name], layer, err_msg=name)


def workers_made_since(before: list[CellWorker]) -> list[CellWorker]:
    """Those in memory besides `before`, whose ids are theirs as long as the list holds them.

    Counts would not do: what other tests left in this process may go while this one runs.
    """
    gc.collect()
    known = {id(each) for each in before}
    return [each for each in gc.get_objects() if isinstance(each, CellWorker) and id(each) not in known]


@pytest.mark.parametrize("workers", [1, 2])
def test_workers_are_let_go_of_with_the_renderer(workers: int) -> None:
    before = workers_made_since([])
    backend = InProcess(threads=1, workers=workers)
    renderer = PassRenderer(cornell_box((8, 8)), backend, FEW)
    renderer.render(ALL)
    assert len(workers_made_since(before)) == workers
    del renderer
    assert not workers_made_since(before)
    backend.close()


def test_a_backend_here_is_this_process_or_slaves() -> None:
    with backend_here(threads=3) as backend:
        assert (backend.slaves, backend.threads, backend.device) == (0, 3, "cpu")
    assert InProcess().threads == available_cores()
    with pytest.raises(SettingsError, match="slaves is -1; expected at least 0"):
        backend_here(slaves=-1)


@pytest.mark.sockets
def test_a_cluster_is_a_backend() -> None:
    scene = cornell_box((8, 8))
    with backend_here(slaves=2, threads=2) as backend:
        assert isinstance(backend, wdpm.Cluster)
        assert isinstance(backend, Backend)
        assert (backend.slaves, backend.threads, backend.device) == (2, 2, "cpu")
        image = render_in_passes(scene, backend, FEW)
    assert image.digest() == render_in_passes(scene, InProcess(), replace(FEW, bucket=4)).digest()
