"""How good irradiance records are made: as good as is seen beside the noise of the samples."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import window_room

from wdpm.cluster.plan.record_worth import SEEN_SAMPLES
from wdpm.cluster.plan.trial.prices import FEWEST_RAYS, MOST_TOLERANCE, least_rays
from wdpm.cluster.plan.view import CACHE_PLAN
from wdpm.cluster.records import LEAST_RAYS, NO_CACHE
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes import cornell_box
from wdpm.scenes.model.scene import Scene

CACHED = RenderSettings(indirect=Indirect.CACHE, photons=20_000)


def tolerance(scene: Scene, settings: RenderSettings = CACHED, threads: int = 1, cells: int = 1) -> float:
    """What records of a render are to keep to; it is said where that is not what they keep to in other scenes."""
    prepared = prepare(scene, settings, 1, Launcher("cpu", threads), SilentProgress(), cells)
    found = prepared.session.view.cache.tolerance
    said = any(line.startswith("irradiance records: with an error of ") for line in prepared.chose)
    assert said == (CACHE_PLAN.tolerance < found < NO_CACHE.tolerance)
    return found


def test_records_are_exact_where_samples_are_and_no_better_than_needed_where_these_are_noisy() -> None:
    """A lamp lights all of the Cornell box; through the window of the room hardly a shadow ray gets to the sky."""
    assert tolerance(cornell_box((256, 256))) == CACHE_PLAN.tolerance
    noisy = tolerance(window_room.room())
    assert 2 * CACHE_PLAN.tolerance < noisy <= MOST_TOLERANCE


def test_the_least_rays_leave_as_much_as_samples_do() -> None:
    noises = [0.0, 1e-6, 0.004, 0.005, 0.1]
    shares = [least_rays(noise, 0.3) for noise in noises]
    assert shares[:2] == [LEAST_RAYS] * 2
    assert shares[-1] == FEWEST_RAYS
    assert shares[2] * 0.004 == pytest.approx(shares[3] * 0.005)


@pytest.mark.parametrize(("spp", "least"), [(1, FEWEST_RAYS), (3, LEAST_RAYS)])
def test_what_a_trial_has_seen_is_not_looked_at_again(spp: int, least: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """It tells how few rays records may have: half beside one sample, whose noise is more than what they leave."""
    if spp <= SEEN_SAMPLES:
        monkeypatch.setattr("wdpm.cluster.plan.record_worth.Halves", None)
    prepared = prepare(cornell_box((128, 128)), RenderSettings(spp=spp), 1, Launcher("cpu", 1), SilentProgress())
    assert prepared.settings.indirect is Indirect.CACHE
    assert prepared.session.view.cache.least_rays == least


def test_it_is_the_same_on_any_number_of_threads_and_cells() -> None:
    assert tolerance(window_room.room(), threads=2, cells=4) == tolerance(window_room.room())


@pytest.mark.parametrize("effect", ["caustics", "indirect"])
def test_what_is_left_out_of_photon_maps_is_no_error_of_the_paths_that_are_tried(effect: str) -> None:
    settings = replace(CACHED, photons=2000, spp=1, without=(effect,))
    assert 0.0 < tolerance(cornell_box((16, 16)), settings) <= NO_CACHE.tolerance


def test_without_a_cache_nothing_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.cluster.plan.record_worth.Halves", None)
    assert tolerance(cornell_box((16, 16)), RenderSettings(indirect=Indirect.MAP, photons=2000)) == NO_CACHE.tolerance
    assert math.isfinite(NO_CACHE.tolerance)
