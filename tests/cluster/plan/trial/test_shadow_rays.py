"""More shadow rays where they take little beside what is done once for an image, its plan included."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from wdpm.cluster.plan.trial.prices import FINDING_OUT
from wdpm.cluster.plan.trial.shadow_rays import LEAST_LEFT, LEAST_SAVED, MORE, shadow_rays
from wdpm.cluster.render_settings import Integrator, RenderSettings

SETTINGS = RenderSettings(integrator=Integrator.PHOTONS, spp=2)
USUAL = SETTINGS.algorithm.shadow_rays
DEAREST = LEAST_SAVED / LEAST_LEFT - 1.0
"""Of the price of all, what more shadow rays may take at most where all noise is theirs."""


def chosen(more: float, price: float, of_direct: float = 0.25, noise_share: float = 1.0, tried: int = USUAL) -> int:
    prices: Any = SimpleNamespace(of_more_rays=lambda _: more)
    by_photons = SimpleNamespace(light_samples=tried, of_direct=of_direct)
    trial: Any = SimpleNamespace(by_photons=by_photons, by_paths=SimpleNamespace(of_direct=1.0))
    return shadow_rays(prices, trial, SETTINGS, noise_share, price)


def test_they_are_worth_a_part_of_the_price_of_all() -> None:
    price = 1e9
    assert chosen(0.99 * DEAREST * (price + FINDING_OUT), price) == MORE
    assert chosen(1.01 * DEAREST * (price + FINDING_OUT), price) == USUAL


def test_the_plan_is_a_part_of_what_they_are_held_against() -> None:
    """Where records and photons became cheaper they would be worth less: beside two samples of a court under the sky
    squared errors were twice as large for it, and error times time 1.7 times."""
    assert chosen(1.2 * DEAREST * FINDING_OUT, 0.3 * FINDING_OUT) == MORE


@pytest.mark.parametrize("of_direct", [1.0, 2.0])
def test_noise_that_is_not_theirs_asks_for_none(of_direct: float) -> None:
    assert chosen(1.0, 1e9, of_direct=of_direct) == USUAL
    assert chosen(1.0, 1e9, noise_share=0.1) == USUAL


def test_one_lamp_without_extent_has_one() -> None:
    assert chosen(1.0, 1e9, tried=1) == 1
