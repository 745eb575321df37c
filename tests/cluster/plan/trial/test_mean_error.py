"""How far an image's mean is off by chance, by the photons of a pilot, and how many photons that calls for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from two_rooms import by_a_door

from wdpm.cluster.plan import integrator_trial
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.map_worth import FEWEST, best_shares
from wdpm.cluster.plan.photon_pilot import PhotonPilot, fly_pilot
from wdpm.cluster.plan.trial import mean_error
from wdpm.cluster.plan.trial.mean_error import NO_MEAN_ERROR, MeanError
from wdpm.cluster.plan.view import view_of
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.kernels.compile import compile_kernels
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import GLOBAL_MAP
from wdpm.rendering.automatic_settings import ChosenSettings, choose_settings
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.model.scene import Scene

SETTINGS = RenderSettings(integrator=Integrator.PHOTONS, indirect=Indirect.MAP, all_effects=True)
SEEDS = 24
WIDE = 64


def settled(scene: Scene, **chosen: object) -> ChosenSettings:
    settings = RenderSettings(**{"integrator": Integrator.AUTO} | chosen)  # type: ignore[arg-type]
    launcher = Launcher("cpu", 1)
    return choose_settings(flatten(scene), settings, launcher, lambda features: compile_kernels("cpu", features))


def flown(flat: FlatScene, seed: int = 0) -> PhotonPilot:
    return fly_pilot(flat, features_of(flat, SETTINGS), replace(SETTINGS, seed=seed), Launcher("cpu", 1))


EVERYWHERE = 1e9
"""Photons with irradiance are found wherever a ray lands."""


def told_by(flat: FlatScene, pilot: PhotonPilot, sites: float = EVERYWHERE) -> float:
    """Of light that is all indirect, and all read from photons, for a path."""
    seen = pilot.photons[GLOBAL_MAP]
    pilot.worker.set_view(view_of(flat, SETTINGS, 1))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(mean_error, "_scattered_again", lambda *_: 1.0)
        return mean_error.mean_error(flat, pilot, seen["position"][:1], seen["normal"][:1], 1.0, sites).of_path


@pytest.mark.parametrize("scene", [by_a_door((256, 256)), cornell_box((256, 256))], ids=["by a door", "cornell-box"])
def test_a_pilot_tells_how_much_others_differ(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """What pilots of other seeds bring to the same places differs by what one of them foretells, for a path.

    By gathers so wide that it hardly is chance which photons they ask, as it is not in all pixels together.
    """
    flat = flatten(scene)
    pilots = [flown(flat, seed) for seed in range(SEEDS)]
    told = np.mean([told_by(flat, pilot) for pilot in pilots[:3]])
    halves = mean_error._where_gather_rays_land(flat, pilots[0])
    monkeypatch.setattr(mean_error, "PILOT_K", WIDE)
    brought = [sum(mean_error._densities(pilot, *half)[1].sum() for half in halves) for pilot in pilots]
    measured = pilots[0].paths * np.var(brought, ddof=1) / np.mean(brought) ** 2
    assert 0.5 * measured < told < 2.0 * measured, "the variance of so many numbers is known to 30 %"


def test_rays_that_find_no_photons_have_none_of_their_error() -> None:
    flat = flatten(cornell_box((64, 64)))
    pilot = flown(flat)
    assert told_by(flat, pilot, 0.0) == 0.0
    few = told_by(flat, pilot, 1e-3 * pilot.world.extent**2)
    assert 0.0 < few < 0.5 * told_by(flat, pilot)


def test_few_paths_come_in_by_a_door() -> None:
    by_door, plain = (flatten(scene((256, 256))) for scene in (by_a_door, cornell_box))
    assert told_by(by_door, flown(by_door)) > 2.0 * told_by(plain, flown(plain))


def test_light_that_was_scattered_once_is_not_read_from_photons() -> None:
    flat = flatten(cornell_box((64, 64)))
    pilot = flown(flat)
    photons = pilot.photons[GLOBAL_MAP]
    where = photons["position"], photons["normal"]
    assert 0.2 < mean_error._scattered_again(pilot, *where) < 0.9
    photons["edges"][:] = 2
    assert mean_error._scattered_again(pilot, *where) == 0.0


def test_where_no_photon_comes_nothing_is_told() -> None:
    flat = flatten(cornell_box((32, 32)))
    pilot = flown(flat)
    nowhere = np.zeros((0, 3), np.float32)
    assert mean_error.mean_error(flat, pilot, nowhere, nowhere, 1.0, EVERYWHERE) == NO_MEAN_ERROR


def test_fewer_photons_are_not_taken_where_the_mean_would_lose_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a door few paths come in as it is."""
    scene = cornell_box((256, 256))
    assert settled(scene, spp=4).settings.photons <= RenderSettings.photons // FEWEST
    assert settled(by_a_door((256, 256)), spp=4).settings.photons >= RenderSettings.photons
    monkeypatch.setattr(integrator_trial, "mean_error", lambda *_: MeanError(10.0))
    assert settled(scene, spp=4).settings.photons >= RenderSettings.photons


@pytest.mark.parametrize(("of_fewer", "best"), [(0.9, (4,)), (1.1, (1,))])
def test_pixels_and_the_mean_both_decide(of_fewer: float, best: tuple[int]) -> None:
    of_mean = {(1,): 1.0, (4,): of_fewer}
    assert best_shares({(1,): 1.0, (4,): 0.5}, lambda _: False, of_mean.__getitem__) == best


def test_the_mean_of_passes_is_that_of_all_their_photons() -> None:
    error = MeanError(4.0)
    assert error.of(400.0) == pytest.approx(0.01)
    assert error.of(1.0) == 1.0, "at worst all is elsewhere"


def test_beside_noise_that_is_left_in_regions_fewer_photons_are_no_loss() -> None:
    """A relMSE of 0.1 is 1 % of 32 x 32 pixels: as much as 10,000 paths leave, where 40,000 leave half."""
    error = MeanError(1.0)
    without, with_noise = (error.worth(1e4, 0.5, noise) / error.worth(4e4, 1.0, noise) for noise in (0.0, 0.1))
    assert without > 1.0 > with_noise
