"""What gather rays and camera hits read by one kernel each is what the steps of the others give, bit for bit."""

from __future__ import annotations

from collections import Counter
from typing import Any
from unittest import mock

import effect_scenes
import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.work.final_gather import Actions, FinalGather
from wdpm.cluster.work.whole.samples import WholeSamples
from wdpm.images.image import Image
from wdpm.kernels.camera import vertices
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box

SCENE = cornell_box((16, 16))


ACTIONS = ("codes", "by_photons", "by_length", "radiance", "grazing", "length")


def undecided(gather: FinalGather, places: Any, arrays: Arrays) -> Actions:
    """All go on."""
    count = len(arrays["slot"])
    return Actions(
        np.full(count, int(vertices.TRACE_ON), np.int32),
        np.zeros(count, np.bool_),
        gather._is_too_long(arrays, 0),
        np.zeros((count, 3), np.float32),
        np.zeros(count, np.float32),
        places.length.numpy(),
    )


def step_by_step(gather: FinalGather, paths: Any, arrays: Arrays) -> tuple[Actions, NDArray[np.bool_]]:
    """Places, readings and decisions one after another."""
    count = len(arrays["slot"])
    places = gather._places(paths, count)
    actions = undecided(gather, places, arrays)
    return actions, gather._read(places, np.arange(count), arrays["diffuse"], actions)


def by_batches() -> Any:
    """Paths that are followed whole have no such steps (tests/property/test_exactness_whole_samples.py)."""
    return mock.patch.object(WholeSamples, "can_be", False)


@pytest.mark.parametrize("indirect", [Indirect.CACHE, Indirect.GATHER])
def test_one_kernel_decides_as_three_steps_do(indirect: Indirect) -> None:
    arrive, codes = FinalGather._arrive, Counter()

    def both(gather: FinalGather, points: Any, paths: Any, arrays: Arrays) -> tuple[Actions, NDArray[np.bool_]]:
        expected, near = step_by_step(gather, paths, arrays)
        actions, found = arrive(gather, points, paths, arrays)
        np.testing.assert_array_equal(found, near)
        for name in ACTIONS:
            np.testing.assert_array_equal(getattr(actions, name), getattr(expected, name))
        codes.update(actions.codes.tolist())
        return actions, found

    settings = RenderSettings(photons=2000, spp=2, indirect=indirect)
    plain = render_in_process(SCENE, settings, workers=1, threads=1)
    with mock.patch.object(FinalGather, "_arrive", both), by_batches():
        checked = render_in_process(SCENE, settings, workers=1, threads=1)
    assert codes.keys() == {int(vertices.TRACE_ON), int(vertices.CACHED)}
    assert checked.digest() == plain.digest()


def test_one_kernel_asks_records_as_three_steps_do() -> None:
    ask, codes = FinalGather._ask_records, Counter()

    def both(gather: FinalGather, cache: Any, paths: Any, arrays: Arrays) -> Actions:
        counted = vars(gather.counters).copy()
        places = gather._places(paths, len(arrays["slot"]))
        expected = undecided(gather, places, arrays)
        gather._interpolate(places, np.arange(len(arrays["slot"])), expected)
        by_steps = gather.counters.interpolated, gather.counters.uncovered
        vars(gather.counters).update(counted)
        actions = ask(gather, cache, paths, arrays)
        assert (gather.counters.interpolated, gather.counters.uncovered) == by_steps
        for name in ACTIONS:
            np.testing.assert_array_equal(getattr(actions, name), getattr(expected, name))
        codes.update(actions.codes.tolist())
        return actions

    scene, settings = effect_scenes.metals(), RenderSettings(photons=2000, spp=2, indirect=Indirect.CACHE)
    plain = render_in_process(scene, settings, workers=1, threads=1)
    with mock.patch.object(FinalGather, "_ask_records", both), mock.patch.object(WholeSamples, "can_be", False):
        checked = render_in_process(scene, settings, workers=1, threads=1)
    assert codes.keys() == {int(vertices.TRACE_ON), int(vertices.CACHED)}
    assert checked.digest() == plain.digest()


def read_none(gather: FinalGather, _paths: Any, arrays: Arrays, _found: NDArray[np.bool_], actions: Actions) -> None:
    """In place of FinalGather._read_records: all that would go on do."""
    going_on = actions.codes[arrays["diffuse"] > 0] == int(vertices.TRACE_ON)
    gather.counters.short += int(np.count_nonzero(going_on))


def gone_on(image: Image) -> int:
    """Gather rays that went on, short ones and others."""
    done = image.report.final_gather
    assert done is not None
    return done.short + done.unread


def test_rays_that_would_go_on_read_records_of_earlier_rounds() -> None:
    """In corners of the Cornell box; its light stays what it is."""
    scene = cornell_box((48, 48))
    settings = RenderSettings(photons=20_000, spp=4, indirect=Indirect.CACHE)
    read = render_in_process(scene, settings, workers=1, threads=1)
    with mock.patch.object(FinalGather, "_read_records", read_none), by_batches():
        bounced = render_in_process(scene, settings, workers=1, threads=1)
    assert 0 < gone_on(read) < 0.8 * gone_on(bounced)
    assert read.layers["beauty"].mean() == pytest.approx(bounced.layers["beauty"].mean(), rel=0.01)


def test_no_record_is_read_that_may_know_light_of_too_long_paths() -> None:
    settings = RenderSettings(photons=2000, spp=2, indirect=Indirect.CACHE, max_depth=4)
    limited = render_in_process(SCENE, settings, workers=1, threads=1)
    with mock.patch.object(FinalGather, "_read_records", read_none), by_batches():
        bounced = render_in_process(SCENE, settings, workers=1, threads=1)
    assert gone_on(limited) == gone_on(bounced) > 0
    assert limited.digest() == bounced.digest()
