"""Paths end where their numbers do, and what is cut off stays in the ledger."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from one_cell import FEW, one, ready

from wdpm.cluster.batch import Kind
from wdpm.kernels.limits import CHAIN_LIMIT
from wdpm.kernels.photons.flight import BOUNCE_LIMIT
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.model.bsdfs import Conductor, TwoSided
from wdpm.scenes.model.scene import Material, Scene


def of_mirrors() -> Scene:
    """The Cornell box, of perfect mirrors but for its coloured walls."""
    box = cornell_box((4, 4))
    mirror = Material("white", TwoSided(Conductor()))
    return replace(box, materials=tuple(mirror if m.name == "white" else m for m in box.materials))


def test_a_camera_path_has_no_vertex_beyond_the_limit() -> None:
    """Its place in the sample, and its credit, are those of CHAIN_LIMIT vertices."""
    worker = ready(of_mirrors(), FEW)
    floor = {
        "pixel": 7, "sample": 1, "edges": 2, "medium": -1, "prim": 0, "u": 0.3, "v": 0.3, "t": 1.3,
        "origin": (0, 0.3, 0), "direction": (0, -1, 0), "throughput": (1e6, 1e6, 1e6), "bounce": CHAIN_LIMIT - 3,
    }  # fmt: skip
    waiting, bounces = [one(Kind.VERTEX, **floor)], []
    while waiting:
        batch = waiting.pop()
        bounces += batch.arrays["bounce"].tolist() if "bounce" in batch.arrays else []
        waiting += [new for new in worker.cells[0].advance(batch) if new.kind in worker.cells[0]._actions]
    assert max(bounces) in (CHAIN_LIMIT - 2, CHAIN_LIMIT - 1)  # roulette may end it before
    assert len(bounces) < 20


@pytest.mark.parametrize("bounce", [0, 1])
def test_a_path_comes_from_a_vertex_where_it_cannot_collide(bounce: int) -> None:
    """What first vertices show is written where there is no room for it but in launches of camera rays."""
    worker = ready(of_mirrors(), replace(FEW, all_effects=False))
    batch = one(Kind.VERTEX, prim=0, u=0.3, v=0.3, t=1.3, direction=(0, -1, 0), medium=-1, bounce=bounce)
    refused = pytest.raises(ProtocolError, match="that have left no vertex")
    with refused if bounce < 1 else nullcontext():
        assert list(worker.cells[0].advance(batch))


def test_a_photon_path_has_no_bounce_beyond_the_limit() -> None:
    """Its number, path and bounce, has no room for one more."""
    worker = ready(of_mirrors(), FEW)
    floor = {
        "path": 17, "edges": 3, "medium": -1, "origin": (0, 0.3, 0), "direction": (0, -1, 0),
        "flux": (1, 1, 1), "t": 3.4e38, "prim": -1, "owner": -1, "bounce": BOUNCE_LIMIT - 1,
    }  # fmt: skip
    list(worker.cells[0].advance(one(Kind.PHOTON, **floor)))
    np.testing.assert_array_equal(worker.cells[0].energy, [0.0, 0.0, 1.0])  # absorbed, escaped, cut off
