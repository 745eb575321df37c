"""The paths of the volume map: as many as its photons take where a medium is bright, and few where it is faint."""

from __future__ import annotations

import pytest
from fog import foggy

from wdpm.cluster.plan.map_plans import map_plans
from wdpm.cluster.plan.map_worth import PATHS_A_PHOTON, PLAIN_SHARE, worth_of_volume
from wdpm.cluster.plan.photon_pilot import PILOT_PATHS, fly_pilot
from wdpm.cluster.render_settings import RenderSettings
from wdpm.kernels.features import ALL
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import VOLUME_MAP
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.model.scene import Medium

ASKED = 50_000
SETTINGS = RenderSettings(photons=100, volume_photons=ASKED, all_effects=True)


def lamp_in(density: float) -> FlatScene:
    """A room with a lamp, full of a grey medium."""
    return flatten(foggy(Medium("fog", (density,) * 3, (0.5,) * 3), 0.5))


@pytest.mark.parametrize(("density", "is_seen"), [(0.6, True), (0.01, False)])
def test_a_medium_whose_light_is_seen_has_paths_for_its_photons_and_a_faint_one_a_path_each(
    density: float, is_seen: bool
) -> None:
    flat = lamp_in(density)
    pilot = fly_pilot(flat, ALL, SETTINGS, Launcher("cpu"))
    worth, stored = worth_of_volume(pilot), len(pilot.photons[VOLUME_MAP]["id"])
    paths = map_plans(pilot, SETTINGS, flat).maps[VOLUME_MAP].paths
    needed = ASKED * PILOT_PATHS / stored
    assert (worth.share > PLAIN_SHARE) == is_seen
    assert (paths >= needed) == is_seen
    assert ASKED <= paths <= PATHS_A_PHOTON * ASKED
    assert (paths == ASKED) != is_seen
