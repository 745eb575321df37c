"""Errors that are reached with what a render by default chooses."""

from __future__ import annotations

import math
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wdpm
from wdpm.accuracy.predict import predict
from wdpm.cli.main import main
from wdpm.cluster.allotment import Allotment
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.goal.convergence import MOST_BIAS, Estimate
from wdpm.goal.default_passes import DefaultPasses
from wdpm.goal.goal import Goal, Metric
from wdpm.goal.reference_pair import ReferencePair
from wdpm.goal.render import Interrupted, is_searched_for, render_until
from wdpm.goal.samples_needed import LEAST_MORE, MOST_GROWTH, SURELY, samples_by_estimate, samples_by_trial
from wdpm.goal.to_error import LEFT_BY_DEFAULT, RenderToError
from wdpm.goal.workplace import Workplace
from wdpm.images.comparison import compare
from wdpm.images.image import Image
from wdpm.images.image import load as load_image
from wdpm.progress import SilentProgress
from wdpm.rendering.backend import Backend
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.pass_plan import PassPlan, PassResult
from wdpm.rendering.passes import PassRenderer
from wdpm.report.report import ErrorFigure
from wdpm.scenes.errors import ClusterError
from wdpm.scenes.model.scene import Scene

SMALL = ["cornell-box", "--size", "32x32", "--threads", "2"]
ERROR = 0.004
"""That is asked for: what a render by default chooses is known to be biased by less."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = wdpm.load("cornell-box")
    return replace(scene, camera=replace(scene.camera, width=32, height=32))


@pytest.fixture(scope="module")
def truth(scene: Scene) -> Image:
    return wdpm.render(scene, spp=2048, integrator=Integrator.PATH, seed=99, threads=2)


class Notes(SilentProgress):
    """What a person is told."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def note(self, text: str) -> None:
        self.said.append(text)


def of(
    scene: Scene, error: float = ERROR, metric: Metric = Metric.RELMSE, left: float = math.inf, **chosen: Any
) -> RenderToError:
    """What renders to an error."""
    work = Workplace(InProcess(threads=2), SilentProgress())
    passes = DefaultPasses(scene, RenderSettings(**chosen), work, metric, lambda: left)
    return RenderToError(passes, Goal(error, metric), frozenset(chosen))


def estimated(noise: float, bias: float = 0.0, *, wider: float = 0.2, most_bias: float | None = None) -> Estimate:
    """An estimate whose upper ends are `wider` above its figures."""
    parts = [
        ErrorFigure(noise, noise * (1 - wider), noise * (1 + wider)),
        ErrorFigure(bias, bias, bias if most_bias is None else most_bias),
    ]
    high = parts[0].value + parts[1].value + math.hypot(*(part.high - part.value for part in parts))
    return Estimate(parts[0], parts[1], ErrorFigure(noise + bias, 0.0, high))


@pytest.mark.parametrize("seed", range(3))
def test_the_image_is_within_the_error_and_within_what_is_told(seed: int, scene: Scene, truth: Image) -> None:
    image = render_until(scene, Goal(ERROR), InProcess(threads=2), seed=seed)
    asked = image.metadata["asked"]
    assert asked["reached"]
    assert asked["estimate"]["high"] <= ERROR
    assert compare(image, truth).rel_mse <= ERROR
    assert asked["pass_samples"][0] == asked["pass_samples"][1]


@pytest.mark.parametrize("error", [ERROR, 0.001])
def test_the_command_that_is_told_repeats_the_image(
    error: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, again = tmp_path / "asked.exr", tmp_path / "again.exr"
    assert main(["render", *SMALL, "--until-error", str(error), "-o", str(file)]) == 0
    words = shlex.split(capsys.readouterr().out.split("to repeat it to the bit: ")[1].splitlines()[0])
    assert "--plan-samples" in words
    assert "--integrator" not in words
    assert main([*words[1:], "-q", "-o", str(again)]) == 0
    assert main(["compare", str(file), str(again), "--equal", "--flip", "none"]) == 0


def test_slaves_reach_it_with_the_same_bits(scene: Scene) -> None:
    def asked(backend: Backend) -> Image:
        return render_until(scene, Goal(ERROR), backend, seed=5)

    here = asked(InProcess(threads=2))
    with wdpm.Cluster.local(2, threads=1) as cluster:
        there = asked(cluster)
    assert here.metadata["settings"]["pass_samples"] == there.metadata["settings"]["pass_samples"]
    assert here.layers["beauty"].tobytes() == there.layers["beauty"].tobytes()


@pytest.mark.parametrize(
    ("error", "metric", "chosen", "wanted"),
    [
        pytest.param(ERROR, Metric.RELMSE, {}, False, id="far beyond the bias of a render by default"),
        pytest.param(0.001, Metric.RELMSE, {}, True, id="a small error"),
        pytest.param(ERROR, Metric.RELMSE, {"photons": 20_000}, True, id="photons that are given may be few"),
        pytest.param(0.05, Metric.RMSE, {}, True, id="an error with a unit"),
        pytest.param(0.001, Metric.RELMSE, {"without": ("indirect",)}, False, id="what paths cannot leave out"),
        pytest.param(0.001, Metric.RELMSE, {"max_depth": 2, "integrator": "path"}, False, id="paths are not biased"),
    ],
)
def test_bias_is_measured_where_it_may_matter(
    error: float, metric: Metric, chosen: dict[str, Any], wanted: bool, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    black = ReferencePair(np.zeros((24, 24, 3)), np.zeros((24, 24, 3)), 4, 1)
    monkeypatch.setattr("wdpm.goal.to_error.make_reference_pair", lambda *_: black)
    large = replace(scene, camera=replace(scene.camera, width=96, height=96))  # or it is path tracing by default
    to_error = of(large, error, metric, **chosen)
    to_error.begin()
    assert (to_error.reference is not None) == wanted
    most = to_error.passes.estimator._most_bias
    assert most == (LEFT_BY_DEFAULT if not wanted else MOST_BIAS)


def test_what_is_too_biased_is_searched_for(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a reference that says so: twice as bright as what any photon map shows."""

    def brighter(scene: Scene, *_: Any) -> ReferencePair:
        image = wdpm.render(scene, spp=64, threads=2).layers["beauty"].astype(np.float64) * 2.0
        return ReferencePair(image, image, 1, 64)

    monkeypatch.setattr("wdpm.goal.to_error.make_reference_pair", brighter)
    monkeypatch.setattr("wdpm.goal.searched.PATIENCE", 1)
    monkeypatch.setattr("wdpm.goal.searched.LEAST_FOR_PATIENCE", 2)
    notes = Notes()
    image = render_until(scene, Goal(0.001), InProcess(threads=2), progress=notes, indirect="map")
    asked = image.metadata["asked"]
    assert not asked["reached"]
    assert asked["bias"] > 0.001
    assert any("other settings are tried" in said for said in notes.said)
    assert not image.metadata["settings"]["pass_samples"], "of a search, whose passes are alike"


def stopping(number: int, error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a pass of a render ended."""
    render = PassRenderer.render

    def ended(renderer: PassRenderer, plan: PassPlan, *samples: Allotment) -> PassResult:
        if plan.number == number:
            raise error
        return render(renderer, plan, *samples)

    monkeypatch.setattr(PassRenderer, "render", ended)


def test_ctrl_c_hands_over_what_was_done(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    stopping(1, KeyboardInterrupt(), monkeypatch)
    with pytest.raises(Interrupted) as caught:
        render_until(scene, Goal(ERROR), InProcess(threads=2))
    asked = caught.value.image.metadata["asked"]
    assert (asked["ending"], len(asked["pass_samples"]), asked["estimate"]) == ("interrupted", 1, None)


def test_before_the_first_pass_is_done_there_is_nothing_to_hand_over(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopping(0, ClusterError("no slave is left"), monkeypatch)
    with pytest.raises(ClusterError, match="no slave is left") as caught:
        render_until(scene, Goal(ERROR), InProcess(threads=2))
    assert type(caught.value) is ClusterError


def test_a_time_ends_it(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.goal.default_passes.DefaultPasses.samples_that_fit", lambda _: 0)
    image = render_until(scene, Goal(ERROR, seconds=900.0), InProcess(threads=2))
    asked = image.metadata["asked"]
    assert (asked["ending"], len(asked["pass_samples"]), asked["reached"]) == ("out of time", 1, False)


def test_what_is_out_of_reach_ends_and_says_so(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.goal.reference_pair.MOST_SPP", 8)
    monkeypatch.setattr("wdpm.goal.to_error.MOST_OF_FIRST", 2)
    monkeypatch.setattr("wdpm.goal.to_error.MOST_IN_ALL", 64)
    tiny = replace(scene, camera=replace(scene.camera, width=16, height=16))
    notes = Notes()
    image = render_until(tiny, Goal(1e-7, Metric.RMSE), InProcess(threads=2), progress=notes, integrator="auto")
    assert not image.metadata["asked"]["reached"]
    assert image.metadata["settings"]["spp"] <= 4 * MOST_GROWTH


def test_large_errors_and_what_somebody_chose_are_searched_for() -> None:
    assert is_searched_for(Goal(0.05), RenderSettings())
    assert not is_searched_for(Goal(0.05, Metric.RMSE), RenderSettings())
    assert not is_searched_for(Goal(0.01), RenderSettings(photons=20_000))
    assert is_searched_for(Goal(0.01), RenderSettings(integrator=Integrator.PATH))
    assert is_searched_for(Goal(0.01), RenderSettings(adaptive=True))


def test_smaller_errors_are_foretold_to_take_longer(scene: Scene) -> None:
    work = Workplace(InProcess(threads=2), SilentProgress())
    found = predict(scene, work, targets=(0.05, 0.01, 0.002, 0.0002)).foretold
    by_error = [found[error] for error in (0.01, 0.002, 0.0002)]
    assert found[0.05] is not None
    assert all(each is not None for each in by_error)
    samples = [sum(each.pass_samples) for each in by_error if each is not None]
    seconds = [each.seconds for each in by_error if each is not None]
    assert samples == sorted(samples)
    assert samples[0] < samples[-1]
    assert seconds == sorted(seconds)


figures = st.floats(1e-6, 1.0)


@given(figures, st.integers(2, 500), st.floats(1e-5, 0.5), st.floats(0.0, 0.5))
def test_samples_that_an_estimate_asks_for(noise: float, samples: int, error: float, wider: float) -> None:
    """Noise falls with them, and its interval with it."""
    found = samples_by_estimate(estimated(noise, wider=wider), samples, error)
    assert math.floor(LEAST_MORE * samples) <= found <= math.ceil(MOST_GROWTH * samples)
    if found < MOST_GROWTH * samples:
        left = noise * (1 + wider) * samples / found
        assert left <= error * 1.0001
        if found > math.ceil(LEAST_MORE * samples):
            assert left * SURELY * (1 + 2 / found) >= error * 0.999, "no more than that"


@given(figures, st.floats(1e-5, 0.5), st.floats(0.0, 0.3), st.floats(0.0, 1.0))
def test_bias_asks_for_more_samples(noise: float, error: float, bias: float, beyond: float) -> None:
    """What is surely there, and what may be."""
    without = samples_by_estimate(estimated(noise), 8, error, math.inf)
    biased = estimated(noise, bias * error, most_bias=(bias + beyond) * error)
    assert samples_by_estimate(biased, 8, error, math.inf) >= without


def test_an_image_without_noise_asks_for_no_more() -> None:
    assert samples_by_estimate(estimated(0.0), 4, 0.01) == 4


def test_samples_by_a_trial_fall_with_the_error() -> None:
    assert samples_by_trial(0.1, 0.001) == pytest.approx(10 * samples_by_trial(0.1, 0.01))
    assert samples_by_trial(None, 0.01) == pytest.approx(1.0)


def test_written_settings_say_what_the_plan_was_made_for(tmp_path: Path) -> None:
    file = tmp_path / "asked.exr"
    assert main(["render", *SMALL, "--until-error", str(ERROR), "-q", "-o", str(file)]) == 0
    settings = load_image(file).metadata["settings"]
    assert settings["plan_samples"] == settings["pass_samples"][0]
