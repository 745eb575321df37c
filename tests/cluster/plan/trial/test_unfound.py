"""Light that hardly a path of a trial finds: no reason to think that paths have no noise."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_mean_error import settled
from two_rooms import round_two_bends

from wdpm.cluster.plan.map_worth import MapError
from wdpm.cluster.plan.small_view import Figures
from wdpm.cluster.plan.trial.unfound import ENOUGH, is_dark, with_unfound
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.scenes import cornell_box

PIXELS = 4096
FIGURES = Figures(RenderSettings(), noise=0.0, of_indirect=0.0, vertices=1.0, light_samples=1, indirect=0.0)
GLOBAL = MapError(50, np.full(3, 0.5), np.zeros(3), np.zeros(3), 0.0, np.full(3, 99.0))


FEW = int(ENOUGH * PIXELS)
"""Pixels of either half in which light is found often enough."""


def looks(found: int, brightest: float = 1.0, seen: int = PIXELS) -> Any:
    """Of which so many pixels of either half have light, one of them so much; of so many photons tell."""
    image = np.zeros((64, 64, 3))
    image.reshape(-1, 3)[:found] = 1.0
    image[0, 0] *= brightest
    paths = SimpleNamespace(layers=[{"beauty": image, "indirect": image}] * 2)
    places = SimpleNamespace(all={"pixel": np.arange(seen).repeat(2)}.get)
    return SimpleNamespace(paths=paths, places=places, by_paths=FIGURES, samples=8)


def test_a_room_round_two_bends_is_for_photons_though_a_trial_by_paths_sees_no_noise() -> None:
    """By paths it is black but for some bright pixels."""
    assert settled(round_two_bends((128, 128)), spp=16).settings.integrator is Integrator.PHOTONS
    assert settled(cornell_box((16, 12)), spp=2, all_effects=True).settings.integrator is Integrator.PATH


def test_a_room_round_two_bends_is_for_photons_though_a_trial_by_paths_finds_some_light() -> None:
    """With doors so wide that one pixel in ten of the trial's has found light, and some of them nearly all of it."""
    assert settled(round_two_bends((64, 64), wide=0.4), spp=64).settings.integrator is Integrator.PHOTONS


@pytest.mark.parametrize("found", [0, 1, FEW - 1])
def test_what_few_paths_find_is_as_noisy_as_it_is_rare(found: int) -> None:
    told = with_unfound(looks(found), GLOBAL)
    assert is_dark(looks(found))
    assert told.noise == told.of_indirect == pytest.approx(0.5 * 4 * (2 * PIXELS / (2 * found + 3) - 1))
    assert told.indirect == 0.5


def test_what_few_paths_find_is_as_noisy_as_it_is_unlike() -> None:
    """Of a hundred pixels one has found nearly all light: it is as noisy as if no other had."""
    told = with_unfound(looks(100, brightest=1e6), GLOBAL)
    assert told.noise == pytest.approx(0.5 * 4 * (PIXELS - 1), rel=0.02)


def test_where_paths_find_enough_they_tell_their_noise_themselves() -> None:
    assert not is_dark(looks(FEW))
    assert with_unfound(looks(FEW), GLOBAL) is FIGURES
    assert with_unfound(looks(0), None) is FIGURES
    noisy = looks(0)
    noisy.by_paths = replace(FIGURES, noise=1e9)
    assert with_unfound(noisy, GLOBAL).noise == 1e9


def test_what_sees_nothing_that_photons_tell_of_finds_no_light_there() -> None:
    """The sky between the leaves is no light that paths have missed."""
    assert not is_dark(looks(100, seen=200))
    assert not is_dark(looks(0, seen=0))
    assert with_unfound(looks(0, seen=0), GLOBAL) is FIGURES
