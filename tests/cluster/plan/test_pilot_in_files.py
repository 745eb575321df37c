"""A pilot among triangles that lie in files stores the photons of one among triangles in memory."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.photon_pilot import PATHS_OF_PAGES, PILOT_PATHS, PhotonPilot, direct_photons, fly_pilot
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.kernels.launch import Launcher
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.room import Room, in_file


def flown(room: Room) -> PhotonPilot:
    flat = flatten(cornell_box((8, 8)), room=room)
    settings = RenderSettings(integrator=Integrator.PHOTONS)
    return fly_pilot(flat, features_of(flat, settings), settings, Launcher("cpu", 2))


def test_in_files_a_pilot_flies_some_paths_at_a_time_to_the_same_photons(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.cluster.work.cell.MANY_TRIANGLES", 1)
    in_memory, in_files = flown(np.empty), flown(in_file)
    assert PATHS_OF_PAGES < PILOT_PATHS
    assert in_files.cell.lets_go
    assert not in_memory.cell.lets_go
    assert sum(len(part["id"]) for part in in_memory.photons) > 0
    straight = [direct_photons(pilot)[0] for pilot in (in_memory, in_files)]
    pairs = [*zip(in_memory.photons, in_files.photons, strict=True)]
    for ours, theirs in pairs:
        assert ours.keys() == theirs.keys()
        for name, column in ours.items():
            np.testing.assert_array_equal(column, theirs[name])
    orders = [np.argsort(photons["id"]) for photons in straight]
    np.testing.assert_array_equal(straight[0]["flux"][orders[0]], straight[1]["flux"][orders[1]])
    np.testing.assert_array_equal(in_memory.flux_by_light(), in_files.flux_by_light())


def test_few_triangles_are_not_let_go_after_each_batch() -> None:
    assert not flown(in_file).cell.lets_go
