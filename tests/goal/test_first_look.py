"""One pass may be good enough: a look at a quarter of a second one tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import wdpm
from wdpm.cluster.allotment import BLOCK, Allotment
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.session import SessionResult
from wdpm.goal.first_look import LEAST_SQUARES, blocks_to_look_at, is_worth_a_look, look
from wdpm.goal.goal import Goal, Metric
from wdpm.goal.render import render_until
from wdpm.goal.trial import IMAGE_PLANS
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.pass_plan import PassPlan, PassResult

SIDE = 2 * BLOCK * int(LEAST_SQUARES**0.5)


def result(plan: PassPlan, beauty: NDArray[np.float64]) -> PassResult:
    return PassResult(plan, {"beauty": beauty.astype(np.float32)}, {}, SessionResult({}, [], (), {}, {}, {}))


def noisy(seed: int, spread: float) -> NDArray[np.float64]:
    """Light that grows from left to right, noisier above."""
    light = np.linspace(0.5, 2.0, SIDE)[None, :, None] * np.ones((SIDE, 1, 3))
    relative = spread * np.linspace(1.5, 0.5, SIDE)[:, None, None]
    return np.asarray(light * (1.0 + relative * np.random.default_rng(seed).standard_normal((SIDE, SIDE, 1))))


@pytest.mark.parametrize(("width", "height"), [(64, 64), (100, 37), (8, 8)])
def test_a_quarter_of_the_blocks_is_looked_at(width: int, height: int) -> None:
    blocks = blocks_to_look_at(width, height)
    rows, columns = (size // 2 * 2 for size in blocks.shape)
    squares = blocks[:rows, :columns].reshape(rows // 2, 2, columns // 2, 2)
    assert (squares.sum(axis=(1, 3)) == 1).all()


@pytest.mark.parametrize("spread", [0.05, 0.2])
def test_a_look_tells_the_error_of_one_pass(spread: float) -> None:
    seeds, held = range(20), 0
    for seed in seeds:
        first = noisy(2 * seed, spread)

        def render(plan: PassPlan, allotment: Allotment, seed: int = seed) -> PassResult:
            assert (allotment.first == plan.first_sample).all()
            taken = np.kron(allotment.count, np.ones((BLOCK, BLOCK)))[..., None]
            return result(plan, noisy(2 * seed + 1, spread) * taken)  # what is not asked for is black

        found = look(result(IMAGE_PLANS[0], first), IMAGE_PLANS[1], render, Metric.RELMSE, biased=False)
        assert found is not None
        truth = noisy(0, 0.0)
        true = float(((first - truth) ** 2 / (truth**2 + 0.01)).mean())
        assert found.noise.value == pytest.approx(true, rel=0.35)
        held += true <= found.noise.high
    assert held >= 0.9 * len(seeds)


@pytest.mark.parametrize(
    ("spread", "metric", "side", "worth"),
    [
        pytest.param(0.05, Metric.RELMSE, SIDE, True, id="little noise"),
        pytest.param(1.0, Metric.RELMSE, SIDE, False, id="pixels that are nothing like those beside them"),
        pytest.param(0.05, Metric.RMSE, SIDE, False, id="an error with a unit"),
        pytest.param(0.05, Metric.RELMSE, SIDE // 2, False, id="a small image"),
    ],
)
def test_what_is_worth_a_look(spread: float, metric: Metric, side: int, worth: bool) -> None:
    assert is_worth_a_look(noisy(1, spread)[:side, :side], metric, 0.02) == worth


def test_a_render_that_is_good_enough_at_once_is_that_of_one_pass() -> None:
    scene = wdpm.load("cornell-box")
    scene = replace(scene, camera=replace(scene.camera, width=SIDE, height=SIDE))
    image = render_until(scene, Goal(0.3), InProcess(threads=2), seed=3)
    assert image.metadata["asked"]["pass_samples"] == (1,)
    assert 0 < image.metadata["asked"]["estimate"]["value"] <= 0.3
    names = ("spp", "passes", "photons", "caustic_photons", "volume_photons")
    taken = image.metadata["settings"]
    again = wdpm.render(
        scene,
        RenderSettings(
            seed=3,
            integrator=taken["integrator"],
            indirect=taken["indirect"],
            max_depth=taken["max_depth"],
            light_samples=taken["light_samples"],
            **{name: taken[name] for name in names},
        ),
        threads=2,
    )
    assert np.array_equal(again.pixels, image.pixels)
