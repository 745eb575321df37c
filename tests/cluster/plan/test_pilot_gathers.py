"""Gathers among the pilot's photons: in whatever order places are asked about, each is told the same."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.photon_pilot import PhotonPilot, fly_pilot
from wdpm.cluster.plan.pilot_gathers import RUN, AmongPhotons
from wdpm.cluster.render_settings import RenderSettings
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import GLOBAL_MAP
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten


@pytest.fixture(scope="module")
def pilot() -> PhotonPilot:
    flat = flatten(cornell_box((32, 32)))
    settings = RenderSettings()
    return fly_pilot(flat, features_of(flat, settings), settings, Launcher(threads=1))


def test_order_and_company_of_places_do_not_matter(pilot: PhotonPilot) -> None:
    photons = pilot.photons[GLOBAL_MAP]
    rows = np.random.default_rng(1).permutation(len(photons["id"]))[: 3 * RUN + 5]
    position, normal = photons["position"][rows], photons["normal"][rows]
    among, extent = AmongPhotons(pilot.cell, photons), pilot.world.extent
    together = among.gather(position, normal, extent)
    alone = [among.gather(position[i : i + 1], normal[i : i + 1], extent) for i in range(len(rows))]
    for number in (0, 1):
        assert np.array_equal(together[number], np.concatenate([each[number] for each in alone]))
    assert together[0].min() > 0.0
    assert 0.0 < together[1].min() <= together[1].max() < extent


def test_no_place_is_told_nothing(pilot: PhotonPilot) -> None:
    nowhere = np.zeros((0, 3), np.float32)
    irradiance, radius = AmongPhotons(pilot.cell, pilot.photons[GLOBAL_MAP]).gather(nowhere, nowhere, 1.0)
    assert len(irradiance) == len(radius) == 0


def test_places_that_coincide(pilot: PhotonPilot) -> None:
    photons = pilot.photons[GLOBAL_MAP]
    position, normal = (np.repeat(photons[name][:1], 3, axis=0) for name in ("position", "normal"))
    irradiance, radius = AmongPhotons(pilot.cell, photons).gather(position, normal, pilot.world.extent, 50)
    assert len(set(irradiance.tolist())) == len(set(radius.tolist())) == 1
