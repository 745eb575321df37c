"""What is picked by what trials measured: pure arithmetic."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.goal import clock
from wdpm.goal.clock import Budget, process_age
from wdpm.goal.convergence import LEAST_PASSES
from wdpm.goal.goal import Goal, Metric, goal_of
from wdpm.goal.schedule import (
    MOST_PHOTONS,
    RARE_POWER,
    RECORD_NOISE,
    lone_left,
    nearest,
    schedule_of,
    soonest,
    with_photons,
)
from wdpm.goal.trial import MARGIN, Trial, stratified
from wdpm.rendering.pass_plan import shrink
from wdpm.scenes.errors import SettingsError


def trial(
    pass_cost: float = 1.0,
    sample_cost: float = 0.2,
    pass_noise: float = 0.01,
    sample_noise: float = 0.05,
    bias: float = 0.002,
    settings: RenderSettings | None = None,
) -> Trial:
    return Trial(
        settings or RenderSettings(indirect=Indirect.MAP), 0.5, pass_cost, sample_cost, pass_noise, sample_noise, bias
    )


positive = st.floats(1e-4, 1.0)
trials = st.builds(trial, positive, positive, positive, positive, st.floats(0.0, 0.01))


def test_the_model_adds_up() -> None:
    shares = [shrink(number) for number in range(3)]
    found = schedule_of(trial(), 3, 4)
    assert found.seconds == pytest.approx(0.5 + 3 * (1.0 + 4 * 0.2))
    assert found.noise == pytest.approx((0.01 * sum(1 / q for q in shares) / 3 + stratified(12) * 0.05 / 4) / 3)
    feared = schedule_of(replace(trial(), rare=0.7), 3, 4)
    assert feared.noise - found.noise == pytest.approx(0.7 * (2 / 12) ** RARE_POWER)
    lone = schedule_of(replace(trial(), lone=(70.0,) * 9), 3, 4)
    assert lone.noise - found.noise == pytest.approx(lone_left((70.0,) * 9, 12)) != 0
    again = schedule_of(replace(trial(), ready=True), 12, 1)
    assert again.seconds == pytest.approx(12 * 1.2)  # without the start
    assert found.bias == pytest.approx(0.002 * sum(shares) / 3)
    assert (found.settings.spp, found.settings.passes, found.samples) == (12, 3, 4)


def test_a_lone_bright_pixel_is_most_likely_gone_soon_and_of_many_some_are_left() -> None:
    assert lone_left((), 4) == 0
    one, many = (3.0,), (3.0,) * 100
    assert lone_left(one, 2) == 3.0
    assert lone_left(one, 8) == 0
    # 12 / (6 x 7) of a hundred are expected to be left of the 8 samples' worth, and to be feared a 16th as much.
    expected = 100 * 12 / (6 * 7) * 3.0 / 16
    assert 0.9 * expected < lone_left(many, 8) <= expected
    falling = [lone_left(many, samples) for samples in (2, 4, 8, 16, 32, 64)]
    assert falling == sorted(falling, reverse=True)


def test_records_have_rays_by_the_samples_of_a_pass() -> None:
    """From 4 samples on, twice the samples are twice the rays: time and noise go with them."""
    cached = replace(trial(), record_cost=0.4)
    few, many = schedule_of(cached, 2, 4), schedule_of(cached, 2, 8)
    assert few.seconds == pytest.approx(0.5 + 2 * (1.0 + 4 * 0.2))
    assert many.seconds == pytest.approx(0.5 + 2 * (1.0 + 0.4 + 8 * 0.2))
    plain = schedule_of(trial(), 2, 8)
    assert plain.noise - many.noise == pytest.approx((few.noise - stratified(8) * 0.05 / 8) * RECORD_NOISE / 2)
    assert with_photons(cached, 4.0).pass_cost == pytest.approx(4 * 0.6 + 0.4)


def test_path_tracing_has_no_radius_to_shrink() -> None:
    found = schedule_of(trial(bias=0.0, settings=RenderSettings(integrator=Integrator.PATH)), 8, 1)
    assert found.noise == pytest.approx((0.01 + stratified(8) * 0.05) / 8)


@given(trials, st.floats(1e-3, 1.0))
def test_the_soonest_reaches_the_error_and_no_fewer_passes_do(one: Trial, error: float) -> None:
    found = soonest([one], error)
    if found is None:
        return
    assert MARGIN * found.error <= error
    if found.passes > LEAST_PASSES:
        assert MARGIN * schedule_of(one, found.passes - 1, found.samples).error > error


@given(st.lists(trials, min_size=1, max_size=3), st.floats(1e-3, 1.0), st.floats(1.1, 10.0))
def test_a_smaller_error_takes_no_less_time(some: list[Trial], error: float, factor: float) -> None:
    large, small = soonest(some, error), soonest(some, error / factor)
    if small is not None:
        assert large is not None
        assert large.seconds <= small.seconds


@given(st.lists(trials, min_size=1, max_size=3), st.floats(0.01, 1000.0))
def test_the_nearest_fits_into_the_time_if_anything_does(some: list[Trial], seconds: float) -> None:
    found = nearest(some, seconds)
    if any(each.start + each.pass_cost + each.sample_cost <= seconds for each in some):
        assert found.seconds <= seconds * (1 + 1e-9)
    else:
        assert found.passes == 1


def test_costly_photons_call_for_more_samples_a_pass() -> None:
    samples = [found.samples for cost in (0.01, 10.0) if (found := soonest([trial(cost)], 0.002 + 1e-2))]
    assert len(samples) == 2
    assert samples[1] > samples[0]


def test_bias_calls_for_more_photons() -> None:
    one = trial(bias=0.02)
    more = with_photons(one, 4)
    assert more.settings.photons == 4 * one.settings.photons
    assert more.bias == pytest.approx(0.005)
    assert more.pass_cost == pytest.approx(4.0)
    assert with_photons(one, 0.25).pass_cost == pytest.approx(0.625)  # a part of it may be there without photons
    found = soonest([one, more], 0.012)
    assert found is not None
    assert found.trial is more
    assert soonest([trial(bias=1e9)], 0.01) is None


def test_photons_have_a_limit() -> None:
    most = with_photons(trial(), 1e6)
    assert most.settings.photons == MOST_PHOTONS
    assert most.bias == pytest.approx(0.002 * 250_000 / MOST_PHOTONS)


@pytest.mark.parametrize(
    ("given_", "said"),
    [
        ({"error": 0.0}, "positive"),
        ({"error": -1.0}, "positive"),
        ({"error": math.nan}, "positive"),
        ({"error": math.inf}, "positive"),
        ({"error": 0.1, "seconds": 0.0}, "at least 1 s"),
        ({"seconds": math.nan}, "at least 1 s"),
        ({"error": 0.1, "metric": "flip"}, "relmse, rmse"),
        ({}, "neither"),
    ],
)
def test_goals_that_make_no_sense_are_refused(given_: dict[str, float | str | None], said: str) -> None:
    with pytest.raises(SettingsError, match=said):
        goal_of(**({"error": None} | given_))  # type: ignore[arg-type]


def test_a_goal_in_mean_squares() -> None:
    assert Goal(0.1).mean_square == 0.1
    assert Goal(0.1, Metric.RMSE).mean_square == pytest.approx(0.01)
    assert Goal(seconds=5.0).mean_square == math.inf


def test_a_budget_counts_what_was_used_and_keeps_a_reserve(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(clock, "time", SimpleNamespace(monotonic=lambda: now[0]))
    budget = Budget(10.0, used=4.0, reserve=1.0)
    assert budget.left() == 5.0
    now[0] = 102.0
    assert budget.left() == 3.0
    assert Budget(math.inf).left() == math.inf


def test_the_age_of_the_process_grows_with_the_clock() -> None:
    before, young, between = time.monotonic(), process_age(), time.monotonic()
    time.sleep(0.01)
    later, old, after = time.monotonic(), process_age(), time.monotonic()
    assert young > 0
    slack = 1e-3  # between the two clocks
    assert later - between - slack <= old - young <= after - before + slack


def test_what_was_not_measured_is_not_foretold() -> None:
    """A trial that had time for one pass knows a time and no error: it gives way to one that knows both."""
    blind = replace(trial(0.0, 0.2, 0.0, 0.0, 0.0), measured=False)
    assert math.isnan(schedule_of(blind, 3, 4).error)
    assert soonest([blind], 0.1) is None
    assert nearest([blind], 10.0).seconds <= 10.0
    assert nearest([blind, trial()], 10.0).trial.measured
