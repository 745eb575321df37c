"""Any number of passes, of any samples, stopped anywhere: the same mean, to the last bit."""

from __future__ import annotations

import itertools
import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.session import SessionResult
from wdpm.cluster.task import PhotonsTraced
from wdpm.rendering.pass_average import PassAverage, merged
from wdpm.rendering.pass_plan import PassResult, plans_for
from wdpm.rendering.passes import PassPlan, spread_samples
from wdpm.scenes.errors import SettingsError

LAYERS = {"beauty": 3, "direct": 3, "indirect": 3, "depth": 1, "cell": 1}
SIZE = (3, 5)
PLANNED: Any = SimpleNamespace(
    settings=RenderSettings(),
    session=SimpleNamespace(
        view=SimpleNamespace(camera=SimpleNamespace(width=SIZE[1], height=SIZE[0])),
        world=SimpleNamespace(
            maps=[SimpleNamespace(paths=9, read=True)],
            unit=1.0,
        ),
    ),
)


@pytest.fixture(autouse=True)
def no_world(monkeypatch: pytest.MonkeyPatch) -> None:
    """The radius of a pass is all that an average asks the world for."""
    plan = SimpleNamespace(global_map=SimpleNamespace(radius=0.5))
    monkeypatch.setattr("wdpm.rendering.pass_average.photon_plan", lambda *_: plan)


def made_up(plan: PassPlan, seed: int, slaves: int) -> PassResult:
    """A pass of noise."""
    rng = np.random.default_rng([seed, plan.number])
    layers = {
        name: rng.exponential(1.0, SIZE if channels == 1 else (*SIZE, channels)).astype(np.float32)
        for name, channels in LAYERS.items()
    }
    statistics = [
        {
            "slave": number,
            "photons": [int(rng.integers(9)), 2],
            "peak_memory_bytes": int(rng.integers(9)),
            "guards": {"a": 1},
            "cells": [0],
        }
        for number in range(slaves)
    ]
    seconds = {"photons": 0.5, "render": 1.0}
    traced = (PhotonsTraced(0, 7, 3.5), PhotonsTraced(1, 2, 0.25))
    return PassResult(plan, layers, seconds, SessionResult(layers, statistics, traced, {"energy": [1.5]}, seconds, {}))


@given(st.integers(1, 5000), st.integers(1, 64))
def test_samples_are_spread_without_gaps_and_evenly(spp: int, passes: int) -> None:
    if passes > spp:
        return
    plans = spread_samples(spp, passes)
    assert [plan.number for plan in plans] == list(range(passes))
    assert plans[0].first_sample == 0
    assert all(a.first_sample + a.spp == b.first_sample for a, b in itertools.pairwise(plans))
    assert sum(plan.spp for plan in plans) == spp
    assert max(plan.spp for plan in plans) - min(plan.spp for plan in plans) <= 1


@given(st.integers(1, 200), st.integers(1, 12), st.integers(1, 200), st.integers(1, 12), st.integers(1, 12))
def test_passes_that_are_done_are_never_done_again(spp: int, passes: int, more: int, larger: int, count: int) -> None:
    if passes > spp:
        return
    done = spread_samples(spp, passes)[:count]
    settings = RenderSettings(spp=more, passes=larger)
    if larger < len(done):
        with pytest.raises(SettingsError, match="done already"):
            plans_for(settings, done)
        return
    plans = plans_for(settings, done)
    assert plans[: len(done)] == done
    assert [plan.number for plan in plans] == list(range(larger))
    assert all(a.first_sample + a.spp == b.first_sample for a, b in itertools.pairwise(plans))
    assert all(plan.spp >= 1 for plan in plans)


@given(st.integers(2, 7), st.integers(0, 9), st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_a_mean_that_was_kept_goes_on_to_the_same_bits(passes: int, spare: int, stop: int, seed: int) -> None:
    plans = spread_samples(passes + spare, passes)
    whole = PassAverage(PLANNED)
    part = PassAverage(PLANNED)
    for plan in plans:
        whole.add(made_up(plan, seed, 2))
        if plan.number < stop:
            part.add(made_up(plan, seed, 2))
    restored = PassAverage(PLANNED)
    like = {name: SIZE if channels == 1 else (*SIZE, channels) for name, channels in LAYERS.items()}
    arrays = {name: array.copy() for name, array in part.arrays().items()}
    restored.restore(arrays, json.loads(json.dumps(part.account())), like)
    for plan in plans[stop:]:
        restored.add(made_up(plan, seed, 2))
    for name, layer in whole.layers().items():
        np.testing.assert_array_equal(restored.layers()[name], layer, err_msg=name)
    assert restored.account() == whole.account()
    assert restored.error() == whole.error()


def test_passes_come_in_order() -> None:
    average = PassAverage(PLANNED)
    average.add(made_up(PassPlan(1, 0, 1), 0, 1))
    with pytest.raises(ValueError, match="pass 1 came after pass 1"):
        average.add(made_up(PassPlan(1, 1, 1), 0, 1))


def test_statistics_of_more_slaves_are_added_to_those_of_fewer() -> None:
    average = PassAverage(PLANNED)
    one, two = made_up(PassPlan(0, 0, 1), 0, 1), made_up(PassPlan(1, 1, 1), 0, 2)
    average.add(one)
    average.add(two)
    first, second = average.account()["statistics"]
    before, after = one.result.statistics[0], two.result.statistics
    assert first["photons"] == [before["photons"][0] + after[0]["photons"][0], 4]
    assert first["peak_memory_bytes"] == max(before["peak_memory_bytes"], after[0]["peak_memory_bytes"])
    assert (first["guards"], first["cells"]) == ({"a": 2}, [0])
    assert second == after[1]


def test_counts_that_only_one_pass_has_are_kept() -> None:
    assert merged({"a": 1, "b": {"x": 2}}, {"b": {"y": 3}, "c": [1.5]}) == {"a": 1, "b": {"x": 2, "y": 3}, "c": [1.5]}
