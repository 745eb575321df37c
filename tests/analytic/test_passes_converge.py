"""The mean of passes goes towards the truth, as fast as the theory says (Knaus & Zwicker 2011)."""

from __future__ import annotations

import numpy as np
import pytest
from furnaces import box, scene, view
from numpy.typing import NDArray

from wdpm.api import render
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.pass_plan import smaller_k
from wdpm.rendering.passes import PassAverage, PassRenderer, shrink, spread_samples
from wdpm.scenes import cornell_box
from wdpm.scenes.model.scene import Scene

DOUBLINGS = 5
PASSES = 1 << DOUBLINGS


def errors(what: Scene, truth: NDArray[np.float64] | float, **chosen: int) -> NDArray[np.float64]:
    """Mean squared error of indirect light after 1, 2, 4, ... passes, mean of two seeds."""
    found = np.zeros((2, DOUBLINGS + 1))
    for seed in range(2):
        settings = RenderSettings(spp=PASSES, passes=PASSES, seed=seed, **chosen)
        renderer = PassRenderer(what, InProcess(), settings)
        average = PassAverage(renderer.prepared)
        for plan in spread_samples(settings.spp, PASSES):
            average.add(renderer.render(plan))
            done = plan.number + 1
            if done & plan.number == 0:
                indirect = average.layers()["indirect"].astype(np.float64)
                found[seed, done.bit_length() - 1] = ((indirect - truth) ** 2).mean()
    return np.asarray(found.mean(axis=0))


def slope(mse: NDArray[np.float64], first: int = 0) -> float:
    """Of the line through the errors in a log-log plot."""
    return float(np.polyfit(np.arange(first, len(mse)), np.log2(mse[first:]), 1)[0])


def test_the_noise_of_a_furnace_falls_as_fast_as_shrinking_gathers_let_it() -> None:
    """Light is the same everywhere, so there is no blur: what is left is noise, of a gather of k photons as 1 / k."""
    room = scene(
        [box((1, 1, 1), inside=True, emission=(1.0,) * 3)], view((-0.5, 0.3, -0.6), (1, 0, 0.2), 60, 10), (0.5,) * 3
    )
    mse = errors(room, 0.5, photons=3000, k=50)
    per_pass = np.array([1 / smaller_k(50, shrink(number)) for number in range(PASSES)])
    expected = np.array([per_pass[: 1 << n].sum() / 4**n for n in range(DOUBLINGS + 1)])
    assert slope(mse) == pytest.approx(slope(expected), abs=0.12)
    assert -0.85 < slope(expected) < -2 / 3  # which it tends to


def test_the_error_of_a_room_falls_on_a_line() -> None:
    """With few photons it is mostly blur, at the edges of shadows and near corners: as the radius there, or faster."""
    box_scene = cornell_box((12, 12))
    truth = (
        render(box_scene, RenderSettings(integrator=Integrator.PATH, spp=1024)).layers["indirect"].astype(np.float64)
    )
    mse = errors(box_scene, truth, photons=1000)
    assert (np.diff(mse[1:]) < 0).all()
    assert -0.9 < slope(mse, first=1) < -0.3
    passes = np.arange(1, DOUBLINGS + 1)
    line = np.polyval(np.polyfit(passes, np.log2(mse[1:]), 1), passes)
    assert np.abs(np.log2(mse[1:]) - line).max() < 0.4
