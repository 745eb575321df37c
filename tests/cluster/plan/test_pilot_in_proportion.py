"""Finding out costs in proportion to the render: few paths for few samples, no photons where none can pay."""

from __future__ import annotations

from dataclasses import replace

import pytest
import window_room

from wdpm.cluster.plan import photon_pilot
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.photon_pilot import ENOUGH, ENOUGH_OF_FAINT, LEAST_PATHS, PILOT_PATHS, SAMPLES_A_PATH, fly_pilot
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.cluster.work.worker import CellWorker
from wdpm.kernels.compile import compile_kernels
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import GLOBAL_MAP
from wdpm.rendering.automatic_settings import choose_settings
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Scene

PHOTONS = RenderSettings(integrator=Integrator.PHOTONS, spp=1)


def outside(far: float = 4000.0) -> Scene:
    """The Cornell box, lit from so far outside that hardly a photon comes in."""
    scene = cornell_box((16, 16))
    unlit = tuple(replace(mesh, emission=None) for mesh in scene.meshes)
    return replace(scene, meshes=unlit, lights=(PointLight("outside", (-far, 278.0, -800.0), (1e7,) * 3),))


@pytest.mark.parametrize(
    ("side", "spp", "paths"),
    [(16, 1, LEAST_PATHS), (512, 2, 512 * 512 * 2 // SAMPLES_A_PATH), (512, 4, PILOT_PATHS), (256, 16, PILOT_PATHS)],
)
def test_paths_go_by_the_samples_of_a_pass(side: int, spp: int, paths: int) -> None:
    flat = flatten(cornell_box((side, side)))
    for passes in (1, 3):
        settings = replace(PHOTONS, spp=passes * spp, passes=passes)
        pilot = fly_pilot(flat, features_of(flat, settings), settings, Launcher("cpu", 1))
        assert pilot.paths == pilot.world.global_map.paths == paths
        assert len(pilot.photons[GLOBAL_MAP]["id"]) >= ENOUGH


def test_all_are_flown_where_hardly_any_stores_a_photon() -> None:
    """Few would not tell how seldom that is."""
    flat = flatten(outside())
    pilot = fly_pilot(flat, features_of(flat, PHOTONS), PHOTONS, Launcher("cpu", 1))
    assert pilot.paths == pilot.world.global_map.paths == PILOT_PATHS
    assert len(pilot.photons[GLOBAL_MAP]["id"]) < ENOUGH * PILOT_PATHS / LEAST_PATHS


def test_as_many_more_are_flown_as_should_store_enough() -> None:
    flat = flatten(outside(far=300.0))
    pilot = fly_pilot(flat, features_of(flat, PHOTONS), PHOTONS, Launcher("cpu", 1))
    assert LEAST_PATHS < pilot.paths < PILOT_PATHS
    assert pilot.paths == pilot.world.global_map.paths
    assert len(pilot.photons[GLOBAL_MAP]["id"]) >= ENOUGH


def test_of_faint_indirect_light_a_few_photons_are_enough() -> None:
    """Beside what samples leave nobody sees what the global map gets wrong."""
    flat = flatten(outside(far=300.0))
    features = features_of(flat, PHOTONS)
    plain, faint = (fly_pilot(flat, features, PHOTONS, Launcher("cpu", 1), is_faint=each) for each in (False, True))
    assert faint.paths < plain.paths
    assert len(faint.photons[GLOBAL_MAP]["id"]) >= ENOUGH_OF_FAINT


@pytest.mark.parametrize(
    ("scene", "flown"), [(window_room.open_ground(), False), (cornell_box((64, 64)), True)], ids=["open ground", "room"]
)
def test_photons_are_flown_only_where_they_may_pay(scene: Scene, flown: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Under the open sky paths leave next to no noise of indirect light; in a room nearly all of it is."""
    traced: list[int] = []
    fly = photon_pilot._fly

    def noted(worker: CellWorker, paths: int, first: int = 0) -> None:
        traced.append(paths - first)
        fly(worker, paths, first)

    monkeypatch.setattr(photon_pilot, "_fly", noted)
    small = replace(scene, camera=replace(scene.camera, width=64, height=64))
    found = choose_settings(
        flatten(small),
        RenderSettings(spp=16, all_effects=True),
        Launcher("cpu", 1),
        lambda f: compile_kernels("cpu", f),
    )
    assert any(traced) == flown
    assert ("at most" in found.chose[0]) == (not flown)
    assert found.settings.integrator is (Integrator.PHOTONS if flown else Integrator.PATH)
