"""The photon pilot where light scatters without end: it is bounded, and so is what is planned after it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fog import INSIDE
from furnaces import quad, scene

from wdpm.cluster.plan import map_plans, photon_pilot
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.photon_pilot import PILOT_PATHS, PhotonPilot, fly_pilot
from wdpm.cluster.render_settings import RenderSettings
from wdpm.kernels.features import ALL
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import GLOBAL_MAP, VOLUME_MAP
from wdpm.kernels.photons.flight import BOUNCE_LIMIT
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Medium

SETTINGS = RenderSettings(photons=5000, volume_photons=5000, all_effects=True)
MOST = 1 << 17


def lamp_in_fog(albedo: float) -> FlatScene:
    """A floor in a medium without end, and a lamp above it."""
    floor = quad((-1, -1, 1), (0, 2, 0), (2, 0, 0))
    what = scene([floor], INSIDE, (0.5,) * 3, (PointLight("lamp", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0),))
    return flatten(replace(what, media=(Medium("milk", (5.0,) * 3, (albedo,) * 3),)))


def flown(flat: FlatScene, settings: RenderSettings) -> PhotonPilot:
    assert features_of(flat, settings) == ALL
    return fly_pilot(flat, ALL, settings, Launcher("cpu"))


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bounds that a fraction of a second reaches."""
    monkeypatch.setattr(photon_pilot, "TRIAL_PATHS", 4)
    monkeypatch.setattr(photon_pilot, "PILOT_PHOTONS_MOST", MOST)
    monkeypatch.setattr(map_plans, "VOLUME_PHOTONS_MOST", MOST)


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("volume_photons", [5000, 0])
def test_white_fog_without_end_does_not_keep_the_pilot(volume_photons: int) -> None:
    settings = replace(SETTINGS, volume_photons=volume_photons)
    flat = lamp_in_fog(1.0)
    pilot = flown(flat, settings)
    stored = len(pilot.photons[VOLUME_MAP]["id"])
    assert pilot.paths == 4  # a trial's paths are the fewest
    assert stored > BOUNCE_LIMIT  # some path was followed to the end
    plans = map_plans.map_plans(pilot, settings, flat)
    paths = plans.maps[GLOBAL_MAP].paths
    assert 1 <= paths <= max(1, MOST * pilot.paths // stored)
    assert paths * stored / pilot.paths <= 2 * MOST


def test_other_media_have_all_of_the_pilot() -> None:
    pilot = flown(lamp_in_fog(0.8), SETTINGS)
    assert pilot.paths == PILOT_PATHS
    assert pilot.world.global_map.paths == PILOT_PATHS
