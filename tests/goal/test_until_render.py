"""Asking for an error or a time, end to end, on a small image."""

from __future__ import annotations

import json
import math
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import exit_code

import wdpm
from wdpm.accuracy.predict import predict
from wdpm.cli.goal import EXIT_NOT_REACHED
from wdpm.cli.main import main
from wdpm.cluster.allotment import Allotment
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.goal.convergence import MOST_BIAS, ConvergenceEstimator, Estimate
from wdpm.goal.goal import Goal, Metric
from wdpm.goal.outcome import Ending, Found, Times, outcome_of
from wdpm.goal.reference_pair import make_reference_pair, path_settings
from wdpm.goal.render import Interrupted, render_until
from wdpm.goal.schedule import Schedule, schedule_of
from wdpm.goal.searched import promise
from wdpm.goal.trial import IMAGE_PLANS, MARGIN, UNKNOWN_SHARE, Trial, try_out
from wdpm.goal.trial_pilot import LONG_S, TrialPilot
from wdpm.goal.workplace import Workplace
from wdpm.images.comparison import compare
from wdpm.images.image import Image
from wdpm.images.image import load as load_image
from wdpm.progress import SilentProgress
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.pass_plan import PassPlan, PassResult
from wdpm.rendering.pass_progress import PassProgress
from wdpm.rendering.passes import PassRenderer
from wdpm.report.report import ErrorFigure
from wdpm.scenes.errors import ClusterError, SettingsError
from wdpm.scenes.model.scene import Scene

SMALL = ["cornell-box", "--size", "16x16", "--threads", "2"]
FEW = {"photons": 20_000, "caustic_photons": 0, "volume_photons": 0}
FEW_OPTIONS = ["--photons", "20000"]
SEARCHED = {"integrator": "photons"}
SEARCHED_OPTIONS = ["--integrator", "photons"]
"""Who chooses the integrator has settings searched for."""
TIMES = Times(1.0, 1.0, 1.0, 0.0)
FINE = 0.0001
"""An error that no schedule reaches in four passes: each has 64 samples at most, and times of a busy machine may choose
as many."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = wdpm.load("cornell-box")
    return replace(scene, camera=replace(scene.camera, width=16, height=16))


def test_an_error_is_reached_and_the_command_told_repeats_the_image(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "asked.exr"
    assert main(["render", *SMALL, *FEW_OPTIONS, "--until-error", "0.3", "-o", str(file)]) == 0
    said = capsys.readouterr().out
    asked = load_image(file).metadata["asked"]
    assert asked["reached"]
    assert asked["estimate"]["high"] <= 0.3
    command = said.split("to repeat it to the bit: ")[1].splitlines()[0]
    again = tmp_path / "again.exr"
    words = shlex.split(command)
    assert words[:2] == ["wdpm", "render"]
    assert main([*words[1:], "-q", "-o", str(again)]) == 0
    assert main(["compare", str(file), str(again), "--equal", "--flip", "none"]) == 0


class Costs:
    """A clock of passes that cost so much for their photons and so much a sample, however busy the machine is."""

    def __init__(self, photons: float, sample: float, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 0.0
        render = PassRenderer.render

        def timed(renderer: PassRenderer, plan: PassPlan, *samples: Allotment) -> PassResult:
            seconds = {"photons": photons, "render": sample * plan.spp}
            self.now += sum(seconds.values())
            return replace(render(renderer, plan, *samples), seconds=seconds)

        monkeypatch.setattr(PassRenderer, "render", timed)

    def __call__(self) -> float:
        return self.now


@pytest.fixture(scope="module")
def truth(scene: Scene) -> Image:
    return wdpm.render(scene, spp=1024, integrator=Integrator.PATH, seed=99, threads=2)


@pytest.mark.parametrize(
    ("photons", "several"),
    [pytest.param(0.1, True, id="several samples a pass"), pytest.param(0.0002, False, id="one sample a pass")],
)
def test_the_image_is_within_the_error(
    photons: float, several: bool, scene: Scene, truth: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Costs(photons, 0.02, monkeypatch)
    image = render_until(scene, Goal(0.02), InProcess(threads=2), clock=clock, seed=2, **SEARCHED, **FEW)
    monkeypatch.undo()
    if (max(image.metadata["asked"]["pass_samples"]) > 1) != several:
        pytest.fail("another schedule was chosen than the one that this is about")
    assert compare(image, truth).rel_mse <= 0.02
    assert image.metadata["settings"]["photons"] == 20_000  # what was given is kept


def test_a_trial_s_renderer_goes_on_with_the_passes(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene is prepared for the references and for the trial, no third time; bits are those of a render anew."""
    prepared: list[RenderSettings] = []
    prepare = InProcess.prepare

    def counted(self: InProcess, scene: Scene, settings: RenderSettings, progress: Any) -> Any:
        prepared.append(settings)
        return prepare(self, scene, settings, progress)

    monkeypatch.setattr(InProcess, "prepare", counted)
    clock = Costs(0.0002, 0.02, monkeypatch)
    image = render_until(scene, Goal(0.1), InProcess(threads=2), clock=clock, seed=2, adaptive=True, **FEW)
    monkeypatch.undo()
    settings = image.metadata["settings"]
    assert settings["spp"] == settings["passes"]
    assert settings["adaptive"] is True
    assert [each.integrator for each in prepared] == [Integrator.PATH, Integrator.PHOTONS]
    again = wdpm.render(
        scene,
        threads=2,
        spp=settings["spp"],
        passes=settings["passes"],
        indirect=settings["indirect"],
        adaptive=True,
        seed=2,
        **FEW,
    )
    assert image.layers["beauty"].tobytes() == again.layers["beauty"].tobytes()


@pytest.mark.parametrize(
    ("goal", "fixed", "wanted"),
    [
        pytest.param(Goal(0.05), (), False, id="an error far beyond any bias"),
        pytest.param(Goal(0.05), ("photons",), True, id="photons that are given may be few"),
        pytest.param(Goal(0.01), (), True, id="a small error"),
        pytest.param(Goal(0.05, Metric.RMSE), (), True, id="an error with a unit"),
        pytest.param(Goal(0.01, seconds=30.0), (), False, id="too short a time"),
        pytest.param(Goal(0.01, seconds=300.0), (), True, id="a long time"),
    ],
)
def test_bias_is_measured_where_it_may_matter(goal: Goal, fixed: tuple[str, ...], wanted: bool, scene: Scene) -> None:
    work = Workplace(InProcess(threads=2), SilentProgress(), clock=lambda: 0.0)
    pilot = TrialPilot(scene, RenderSettings(indirect=Indirect.MAP, **FEW), frozenset(fixed), work)
    pilot.run(goal, lambda: goal.seconds or math.inf)
    assert (pilot.reference is not None) == wanted
    assert (pilot.trials[0].bias == UNKNOWN_SHARE * MOST_BIAS) != wanted


def test_what_a_trial_says_of_two_passes_is_what_the_estimate_says_of_them(scene: Scene) -> None:
    """So a schedule of no more passes than the trial had is one that ends where it is said to."""
    work = Workplace(InProcess(threads=2), SilentProgress())
    settings = RenderSettings(indirect=Indirect.MAP, seed=3, **FEW)
    estimator = ConvergenceEstimator((16, 16, 3), Metric.RELMSE, biased=True)
    trial = try_out(lambda: work.renderer(scene, settings), settings, estimator, None)
    estimate = estimator.estimate()
    assert estimate is not None
    told = MARGIN * (schedule_of(trial, 2, 1).noise - sum(trial.lone)) + sum(trial.lone)
    assert told == pytest.approx(estimate.noise.high, rel=0.3 if trial.lone else 1e-6)


def test_references_have_random_numbers_of_their_own(scene: Scene) -> None:
    """One renderer makes both; each is the image that a render with its seed is."""
    work = Workplace(InProcess(threads=2), SilentProgress())
    small = replace(scene, camera=replace(scene.camera, width=8, height=8))
    pair = make_reference_pair(small, RenderSettings(), Metric.RELMSE, math.inf, work.renderer)
    for name, image in (("a", pair.a), ("b", pair.b)):
        path = path_settings(RenderSettings(spp=pair.spp), name)
        alone = wdpm.render(small, path, threads=2).layers["beauty"]
        assert np.allclose(image, alone, rtol=1e-5, atol=1e-6)
    assert not np.array_equal(pair.a, pair.b)


def test_a_time_that_is_too_short_for_the_error_gives_an_image_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, report = tmp_path / "asked.exr", tmp_path / "report.json"
    asking = ["--until-error", "1e-7", "--time-budget", "1s"]
    code = main(["render", *SMALL, *FEW_OPTIONS, *asking, "-q", "-o", str(file), "--report", str(report)])
    assert code == EXIT_NOT_REACHED
    assert "NOT REACHED" in capsys.readouterr().err
    asked = load_image(file).metadata["asked"]
    assert asked["ending"] == "out of time"
    assert not asked["reached"]
    told = json.loads(report.read_text())
    assert told["settings"]["passes"] == len(asked["pass_samples"])
    assert told["asked"] == asked


def test_an_error_out_of_reach_ends_with_the_best_there_is(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.goal.schedule.MOST_PASSES", 8)
    monkeypatch.setattr("wdpm.goal.reference_pair.MOST_SPP", 8)
    image = render_until(scene, Goal(1e-6), InProcess(threads=2), indirect=Indirect.MAP, **SEARCHED, **FEW)
    asked = image.metadata["asked"]
    assert not asked["reached"]
    assert asked["ending"] == "done"
    assert asked["estimate"]["value"] > 1e-6
    assert any("NOT REACHED" in line for line in asked["lines"])


def test_what_is_not_reached_says_what_would_help() -> None:
    """Noise calls for samples, bias for photons; and time may just be up."""

    def said(noise: float, bias: float, ending: Ending) -> str:
        parts = [ErrorFigure(value, value, value) for value in (noise, bias, noise + bias)]
        found = Found(Estimate(*parts), (1, 1, 1, 1), ending, "photons")
        return outcome_of(Goal(0.01), found, TIMES).lines()[-1]

    assert "mostly noise: some 9 times the samples" in said(0.085, 0.001, Ending.DONE)
    assert "mostly bias" in said(0.001, 0.085, Ending.DONE)
    assert "time was up" in said(0.085, 0.001, Ending.OUT_OF_TIME)
    assert "INTERRUPTED" in said(0.085, 0.001, Ending.INTERRUPTED)


def test_a_dark_picture_says_that_its_figure_tells_little() -> None:
    """relMSE adds 0.01 to squares: a picture of a hundredth of the radiance meets almost any goal, by noise alone."""

    def said(goal: Goal, stops: float) -> str:
        found = Found(None, (1, 1, 1, 1), Ending.DONE, "photons")
        return "\n".join(outcome_of(goal, found, TIMES, stops).lines())

    assert "5.0 stops too dark" in said(Goal(0.02), 5.0)
    assert "what 0.02 is in a picture as bright as others, 2e-05 is here" in said(Goal(0.02), 5.0)
    assert "5.0 stops too dark" in said(Goal(seconds=5.0), 5.0)
    assert "too dark" not in said(Goal(0.02), 1.5)
    assert "too dark" not in said(Goal(0.02, Metric.RMSE), 5.0)


def test_darkness_is_that_of_the_picture(scene: Scene) -> None:
    lamp = next(mesh for mesh in scene.meshes if mesh.emission is not None)
    dim = replace(lamp, emission=(0.01, 0.01, 0.01))
    dark = replace(scene, meshes=tuple(dim if mesh is lamp else mesh for mesh in scene.meshes))
    bright, dark_image = (wdpm.render(each, until_error=0.5, threads=2, **FEW) for each in (scene, dark))
    assert bright.metadata["asked"]["stops"] < 3 < dark_image.metadata["asked"]["stops"]
    assert any("too dark" in line for line in dark_image.metadata["asked"]["lines"])


def test_paths_are_not_told_that_they_have_no_photon_maps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`indirect` was set by the search itself, and a warning named it as a choice without effect."""
    file = tmp_path / "asked.exr"
    assert main(["render", *SMALL, "--until-error", "0.5", "--integrator", "path", "-o", str(file)]) == 0
    said = capsys.readouterr().out
    assert "no effect" not in said
    (repeat,) = (line for line in said.splitlines() if line.startswith("to repeat"))
    assert "--integrator path" in repeat
    assert "--indirect" not in repeat


def test_an_error_of_nothing_is_not_foretold() -> None:
    """A pilot that saw no noise, as where a point light alone shines on what few photons reach, knows no error."""
    noisy = Trial(RenderSettings(passes=2, spp=2), 0.1, 0.1, 0.1, 0.1, 0.1, 0.1)
    blank = replace(noisy, pass_noise=0.0, sample_noise=0.0, bias=0.0)
    for trial, error, said in ((noisy, 0.2, "error about 0.2"), (blank, 0.0, "the pilot saw no noise")):
        assert said in promise(Schedule(trial.settings, trial, 1.0, error, 0.0), Goal(0.5), True)
    one = Trial(RenderSettings(passes=1, spp=1), 0.1, 0.1, 0.1, 0.1, 0.1, 0.1)
    assert promise(Schedule(one.settings, one, 1.0, 0.2, 0.0), Goal(0.5), True).startswith("chose 1 pass of 1 sample, ")


def test_bias_that_only_noise_suggests_does_not_keep_the_pilot_at_work(scene: Scene) -> None:
    """A trial whose bias is not known from its noise: passes are rendered rather than trials of ever more photons."""
    pilot = TrialPilot(scene, RenderSettings(), frozenset(), Workplace(InProcess(threads=2), SilentProgress()))
    hidden = Trial(RenderSettings(indirect=Indirect.MAP), 0.1, 0.01, 0.01, 1e-4, 1e-2, bias=0.5, likely_bias=0.0)
    pilot.trials = [hidden]
    schedule, reached = pilot.best(Goal(0.001))
    assert reached
    assert schedule.trial is hidden
    pilot.trials = [replace(hidden, likely_bias=0.4)]
    assert not pilot.best(Goal(1e-9))[1]


@pytest.fixture
def ctrl_c(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Someone presses Ctrl-C in the fourth pass."""
    render = PassRenderer.render

    def interrupted(renderer: PassRenderer, plan: PassPlan, *samples: Allotment) -> PassResult:
        if isinstance(renderer.progress, PassProgress) and plan.number == 3:
            raise KeyboardInterrupt
        return render(renderer, plan, *samples)

    monkeypatch.setattr(PassRenderer, "render", interrupted)
    return monkeypatch


def test_ctrl_c_hands_over_the_image_so_far(scene: Scene, ctrl_c: pytest.MonkeyPatch) -> None:
    with pytest.raises(Interrupted) as caught:
        render_until(scene, Goal(FINE), InProcess(threads=2), **SEARCHED, **FEW)
    image = caught.value.image
    asked = image.metadata["asked"]
    assert asked["ending"] == "interrupted"
    assert asked["pass_samples"] == (image.metadata["settings"]["spp"] // 3,) * 3
    ctrl_c.undo()
    settings = image.metadata["settings"]
    assert settings["adaptive"] is False
    chosen = {"spp": settings["spp"], "indirect": Indirect(settings["indirect"])}
    again = wdpm.render(scene, threads=2, passes=3, **chosen, **FEW)
    assert image.layers["beauty"].tobytes() == again.layers["beauty"].tobytes()


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_writes_the_image_so_far(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "asked.exr"
    assert main(["render", *SMALL, *FEW_OPTIONS, *SEARCHED_OPTIONS, "--until-error", str(FINE), "-o", str(file)]) == 130
    assert load_image(file).metadata["settings"]["passes"] == 3
    said = capsys.readouterr()
    assert "INTERRUPTED: the image is the best so far" in said.out
    assert "interrupted" in said.err


def test_a_lost_cluster_hands_over_the_image_so_far(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    render = PassRenderer.render

    def abandoned(renderer: PassRenderer, plan: PassPlan, *samples: Allotment) -> PassResult:
        if isinstance(renderer.progress, PassProgress) and plan.number == 3:
            raise ClusterError("slave 0 is lost; no slave is left")
        return render(renderer, plan, *samples)

    monkeypatch.setattr(PassRenderer, "render", abandoned)
    file = tmp_path / "asked.exr"
    assert main(["render", *SMALL, *FEW_OPTIONS, *SEARCHED_OPTIONS, "--until-error", str(FINE), "-o", str(file)]) == 1
    asked = load_image(file).metadata["asked"]
    assert (asked["ending"], len(asked["pass_samples"])) == ("slaves lost", 3)
    said = capsys.readouterr()
    assert "SLAVES LOST: the image is the best so far" in said.out
    assert said.err.endswith("wdpm: error: slave 0 is lost; no slave is left\n")


def test_what_comes_by_photon_maps_alone_may_be_left_out(scene: Scene) -> None:
    """There is no reference then: paths cannot leave it out."""
    image = render_until(scene, Goal(0.5), InProcess(threads=2), without=("indirect",), **FEW)
    assert image.metadata["asked"]["reached"]


@pytest.mark.parametrize("photons", [RenderSettings().photons, 20_000])
def test_an_integrator_that_is_to_be_picked_is_picked_once_before_all_else(scene: Scene, photons: int) -> None:
    """Photons that were asked for are shot."""
    settings = RenderSettings(integrator=Integrator.AUTO, photons=photons)
    pilot = TrialPilot(scene, settings, frozenset({"integrator"}), Workplace(InProcess(threads=2), SilentProgress()))
    pilot.run(Goal(0.5))
    picked = wdpm.render(scene, settings, threads=2).metadata["settings"]["integrator"]
    assert {trial.settings.integrator.value for trial in pilot.trials} == {picked}
    assert picked == "photons" or photons != 20_000


def test_passes_of_the_pilot_count(scene: Scene) -> None:
    pilot = TrialPilot(scene, RenderSettings(**FEW), frozenset(FEW), Workplace(InProcess(threads=2), SilentProgress()))
    pilot.run(Goal(0.3))
    schedule, reached = pilot.best(Goal(0.3))
    assert reached
    first = pilot.trials[0]
    assert {plan.number for plan in first.results} == {0, 1}
    assert first.sample_noise > 0 < first.sample_cost
    assert schedule.samples >= 1


@pytest.mark.parametrize(("budget", "measured"), [(200.0, True), (15.0, False)])
def test_a_pilot_takes_a_tenth_of_a_time_but_for_its_first_pass(
    budget: float, measured: bool, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    costs = Costs(0.5, 0.5, monkeypatch)
    work = Workplace(InProcess(threads=2), SilentProgress(), costs)
    pilot = TrialPilot(scene, RenderSettings(indirect=Indirect.MAP), frozenset({"indirect"}), work)
    goal = Goal(0.03, seconds=budget)
    pilot.run(goal, lambda: budget - costs.now)
    assert [trial.measured for trial in pilot.trials] == [measured] * len(pilot.trials)
    assert costs.now <= 0.1 * budget + 1.0
    schedule, _ = pilot.best(goal, budget - costs.now)
    assert math.isnan(schedule.error) != measured


def test_slaves_render_the_same_image(scene: Scene) -> None:
    with wdpm.Cluster.local(2, threads=2) as cluster:
        image = render_until(scene, Goal(0.3), cluster, **FEW)
    settings = image.metadata["settings"]
    kept = {name: settings[name] for name in ("spp", "passes", "photons", "caustic_photons", "volume_photons")}
    again = wdpm.render(scene, threads=2, indirect=Indirect(settings["indirect"]), **kept)
    assert image.layers["beauty"].tobytes() == again.layers["beauty"].tobytes()


def test_predictions_cost_more_for_less_error(scene: Scene) -> None:
    found = predict(scene, Workplace(InProcess(threads=2), SilentProgress()), targets=(0.5, 0.3), **FEW)
    large, small = found.foretold[0.5], found.foretold[0.3]
    assert large is not None
    assert small is not None
    assert large.seconds <= small.seconds
    assert found.pilot_seconds > 0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--until-error", "0"], "positive"),
        (["--until-error", "-1"], "positive"),
        (["--until-error", "nan"], "positive"),
        (["--until-error", "small"], "not a number"),
        (["--until-error", "0.1", "--metric", "flip"], "flip"),
        (["--metric", "rmse"], "--until-error"),
        (["--time-budget", "soon"], "not a time"),
        (["--time-budget", "0s"], "not a time"),
        (["--time-budget", "0.1"], "at least 1 s"),
        (["--until-error", "0.1", "--passes", "4"], "--passes"),
        (["--time-budget", "10s", "--spp", "4"], "--spp"),
        (["--until-error", "0.1", "--pass-samples", "16"], "leave --pass-samples out"),
        (["--time-budget", "10s", "--pass-samples", "2,2"], "leave --pass-samples out"),
        (["--until-error", "0.1", "--resume"], "--resume"),
        (["--until-error", "0.1", "--replay", "1,1,1"], "--replay"),
        (["--until-error", "0.1", "--save-cache", "c"], "irradiance records of its own; leave --save-cache out"),
        (["--time-budget", "9s", "--load-cache", "c"], "irradiance records of its own; leave --load-cache out"),
        (["--until-error", "0.1", "--strict"], "a guard that acts on some that are not chosen"),
    ],
)
def test_bad_options_are_one_clear_error(
    options: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "image.exr"
    assert exit_code(["render", *SMALL, *options, "-o", str(file)]) == 2
    assert said in capsys.readouterr().err
    assert not file.exists()


def test_a_goal_and_settings_contradict_each_other(scene: Scene) -> None:
    with pytest.raises(SettingsError, match="settings"):
        wdpm.render(scene, RenderSettings(), until_error=0.1)
    for name, value in (("spp", 4), ("pass_samples", (16,))):
        with pytest.raises(SettingsError, match=name):
            wdpm.render(scene, until_error=0.1, **{name: value})


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"metric": "foo"}, "give until_error, too"),
        ({"metric": "rmse"}, "give until_error, too"),
        ({"until_error": 0.1, "metric": "foo"}, "metric is 'foo'"),
        ({"until_error": "x"}, "until_error is 'x'; expected a number"),
        ({"until_error": True}, "until_error is True"),
        ({"time_budget": "10s"}, "time_budget is '10s'; expected a number of seconds"),
        ({"until_error": 0.1, "save_cache": Path("c")}, "leave save_cache out"),
        ({"until_error": 0.1, "load_cache": Path("c")}, "leave load_cache out"),
        ({"until_error": 0.1, "journal": Path("j")}, "leave journal out"),
        ({"time_budget": 2.0, "strict": True}, "time_budget tries settings out"),
    ],
)
def test_bad_arguments_are_one_clear_error(arguments: dict[str, Any], said: str) -> None:
    def load() -> Scene:
        raise AssertionError("too late")

    with pytest.raises(SettingsError, match=said):
        wdpm.render(load, **arguments)


def test_predictions_take_no_sweep(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["accuracy", "cornell-box", "--predict", "--sweep", "spp=1,2"]) == 2
    assert "--sweep" in capsys.readouterr().err


@pytest.mark.parametrize(("error", "passes"), [(100.0, 2), (1e-6, 3)])
def test_a_trial_that_is_good_enough_is_not_taken_apart(error: float, passes: int, scene: Scene) -> None:
    """A third pass would only tell of what the noise is."""
    work = Workplace(InProcess(threads=2), SilentProgress(), clock=lambda: 0.0)
    pilot = TrialPilot(scene, RenderSettings(indirect=Indirect.MAP, **FEW), frozenset({"photons"}), work)
    rendered: list[PassPlan] = []
    render = PassRenderer.render

    def counted(self: PassRenderer, plan: PassPlan) -> PassResult:
        rendered.append(plan)
        return render(self, plan)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PassRenderer, "render", counted)
        pilot.run(Goal(error=error), lambda: LONG_S)
    assert len(rendered) == passes
    assert list(pilot.trials[0].results) == list(IMAGE_PLANS), "which are passes of the image"
