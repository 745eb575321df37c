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


def looks(found: int) -> Any:
    """Of which so many pixels of either half have light."""
    image = np.zeros((64, 64, 3))
    image.reshape(-1, 3)[:found] = 1.0
    return SimpleNamespace(paths=SimpleNamespace(layers=[{"beauty": image}] * 2), by_paths=FIGURES, samples=8)


def test_a_room_round_two_bends_is_for_photons_though_a_trial_by_paths_sees_no_noise() -> None:
    """By paths it is black but for some bright pixels."""
    assert settled(round_two_bends((128, 128)), spp=16).settings.integrator is Integrator.PHOTONS
    assert settled(cornell_box((16, 12)), spp=2, all_effects=True).settings.integrator is Integrator.PATH


@pytest.mark.parametrize("found", [0, 1, ENOUGH // 2 - 1])
def test_what_few_paths_find_is_as_noisy_as_it_is_rare(found: int) -> None:
    told = with_unfound(looks(found), GLOBAL)
    assert is_dark(looks(found))
    assert told.noise == told.of_indirect == pytest.approx(0.5 * 4 * (2 * PIXELS / (2 * found + 3) - 1))
    assert told.indirect == 0.5


def test_where_paths_find_enough_they_tell_their_noise_themselves() -> None:
    assert not is_dark(looks(ENOUGH // 2))
    assert with_unfound(looks(ENOUGH // 2), GLOBAL) is FIGURES
    assert with_unfound(looks(0), None) is FIGURES
    noisy = looks(0)
    noisy.by_paths = replace(FIGURES, noise=1e9)
    assert with_unfound(noisy, GLOBAL).noise == 1e9
