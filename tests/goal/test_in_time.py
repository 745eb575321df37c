"""Times that are filled as a render by default would fill them."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import wdpm
from wdpm.cli.main import main
from wdpm.cluster.allotment import Allotment
from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.default_passes import MOST_OF_FIRST, DefaultPasses
from wdpm.goal.goal import Goal, Metric
from wdpm.goal.in_time import BEYOND_FIRST, FIRST_SHARE, TimedRender
from wdpm.goal.outcome import Ending
from wdpm.goal.pass_costs import PassCosts
from wdpm.goal.render import _render_in_time
from wdpm.goal.workplace import Workplace
from wdpm.images.image import Image
from wdpm.images.image import load as load_image
from wdpm.progress import SilentProgress
from wdpm.rendering.backend import Backend
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.pass_plan import PassPlan, PassResult, passes_in_words
from wdpm.rendering.passes import PassRenderer
from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.scene import Scene


@pytest.fixture(scope="module")
def room() -> Scene:
    scene = wdpm.load("cornell-box")
    return replace(scene, camera=replace(scene.camera, width=24, height=16))


@pytest.fixture(scope="module")
def mirrored(room: Scene) -> Scene:
    """A box of it mirrors."""
    silver = tuple(replace(each, bsdf=Conductor()) for each in room.materials[-1:])
    return replace(room, materials=(*room.materials[:-1], *silver))


class Rendering:
    """Time that goes by while passes are rendered and scenes are prepared, and at no other."""

    def __init__(self, photons: float, sample: float, monkeypatch: pytest.MonkeyPatch, plan: float = 0.1) -> None:
        self.now = 0.0
        self.passes: list[PassPlan] = []
        self.chosen: list[int] = []
        render, prepare = PassRenderer.render, InProcess.prepare

        def timed(renderer: PassRenderer, plan: PassPlan, *samples: Allotment) -> PassResult:
            result = render(renderer, plan, *samples)
            seconds = {"photons": photons, "render": sample * plan.spp}
            self.passes.append(plan)
            self.now += sum(seconds.values())
            return replace(result, seconds=seconds)

        def counted(backend: InProcess, scene: Scene, settings: RenderSettings, *others: Any) -> Any:
            self.now += plan
            if settings.algorithm.stands_for_others:
                self.chosen.append(settings.spp)
            return prepare(backend, scene, settings, *others)

        monkeypatch.setattr(PassRenderer, "render", timed)
        monkeypatch.setattr(InProcess, "prepare", counted)
        monkeypatch.setattr("wdpm.goal.default_passes.idle_share", lambda: 1.0)  # whatever else the machine does

    def of(self, scene: Scene, budget: float, backend: Backend | None = None, **chosen: Any) -> TimedRender:
        """What fills a time."""
        end = self.now + budget
        work = Workplace(backend or InProcess(threads=2), SilentProgress(), lambda: self.now)
        settings = RenderSettings(**chosen)
        return TimedRender(DefaultPasses(scene, settings, work, Metric.RELMSE, lambda: end - self.now))


def rendered(timed: TimedRender) -> Image:
    timed.begin()
    timed.finish()
    return timed.passes.average.image()


@pytest.mark.parametrize("what", ["room", "mirrored"])
def test_a_time_is_filled_with_what_a_render_by_default_chooses(
    what: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene: Scene = request.getfixturevalue(what)
    clock = Rendering(0.2, 0.05, monkeypatch)
    image = rendered(clock.of(scene, 10.0, seed=4))
    assert 8.5 <= clock.now <= 10.0
    by_default = wdpm.render(scene, spp=BEYOND_FIRST * clock.passes[0].spp, threads=2, seed=4).metadata["settings"]
    for name in ("integrator", "indirect", "photons", "caustic_photons", "light_samples"):
        assert image.metadata["settings"][name] == by_default[name], name


@pytest.mark.parametrize("chosen", [{}, {"adaptive": True, "indirect": "map"}], ids=["by default", "adaptive"])
def test_settings_of_the_image_repeat_it_to_the_bit(
    chosen: dict[str, Any], mirrored: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    image = rendered(Rendering(0.05, 0.05, monkeypatch).of(mirrored, 5.0, seed=4, **chosen))
    monkeypatch.undo()
    settings = image.metadata["settings"]
    assert len(settings["pass_samples"]) > 1
    samples = {name: settings[name] for name in ("spp", "passes", "pass_samples", "plan_samples")}
    again = wdpm.render(mirrored, RenderSettings(**samples, **chosen, seed=4), threads=1)
    assert image.layers["beauty"].tobytes() == again.layers["beauty"].tobytes()


def test_slaves_fill_a_time_with_the_same_bits(room: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    here = rendered(Rendering(0.2, 0.05, monkeypatch).of(room, 5.0, integrator="photons"))
    monkeypatch.undo()
    with wdpm.Cluster.local(2, threads=1) as cluster:
        there = rendered(Rendering(0.2, 0.05, monkeypatch, plan=0.1).of(room, 4.9, cluster, integrator="photons"))
    assert here.metadata["settings"]["pass_samples"] == there.metadata["settings"]["pass_samples"]
    assert here.layers["beauty"].tobytes() == there.layers["beauty"].tobytes()


@pytest.mark.parametrize(
    ("seconds", "side", "samples"), [(5.0, 256, 3), (60.0, 256, 45), (9e3, 64, MOST_OF_FIRST), (1, 999, 1)]
)
def test_the_first_pass_is_a_part_of_the_time(
    seconds: float, side: int, samples: int, room: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the pixels, the cores, and what a sample is likely to take."""
    scene = replace(room, camera=replace(room.camera, width=side, height=side))
    timed = Rendering(0.2, 0.05, monkeypatch).of(scene, seconds)
    assert timed.passes.samples_of_first(FIRST_SHARE) == samples
    monkeypatch.setattr("wdpm.goal.default_passes.idle_share", lambda: 0.25)
    assert timed.passes.samples_of_first(FIRST_SHARE) in (1, samples // 4, MOST_OF_FIRST), "a busy machine takes longer"


def test_many_triangles_leave_less_of_the_time(room: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Rendering(0.2, 0.05, monkeypatch)
    large = replace(room, camera=replace(room.camera, width=256, height=256))
    many = replace(large, meshes=room.meshes * 62_500)  # two million
    few, found = (clock.of(scene, 20.0).passes.samples_of_first(FIRST_SHARE) for scene in (large, many))
    assert 1 <= found < few


def test_times_that_are_told_are_of_all_passes_and_of_what_was_before(
    room: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Rendering(0.2, 0.05, monkeypatch, plan=0.4)
    asked = _render_in_time(clock.of(room, 10.0), Goal(seconds=10.0)).metadata["asked"]
    passes = sum(0.2 + 0.05 * samples for samples in asked["pass_samples"])
    assert asked["seconds"] == pytest.approx(passes)
    # Less what a compiler took, which goes by on the machine's clock, and not on this one.
    assert asked["pilot_seconds"] <= clock.now - passes + 1e-6
    assert 0.8 * asked["predicted_seconds"] < passes <= asked["predicted_seconds"]


def test_given_settings_are_kept(room: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Rendering(0.2, 0.05, monkeypatch)
    settings = rendered(clock.of(room, 3.0, integrator="path", light_samples=2)).metadata["settings"]
    assert (settings["integrator"], settings["light_samples"]) == ("path", 2)
    assert not clock.chosen


def test_a_time_of_one_pass_is_repeated_to_the_bit(room: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Planned as if more were to come, which nobody knew."""
    large = replace(room, camera=replace(room.camera, width=96, height=96))
    image = rendered(Rendering(0.2, 0.05, monkeypatch).of(large, 0.3))
    monkeypatch.undo()
    samples = {name: image.metadata["settings"][name] for name in ("spp", "passes", "pass_samples", "plan_samples")}
    assert samples["passes"] == 1
    assert image.layers["beauty"].tobytes() == wdpm.render(large, **samples).layers["beauty"].tobytes()


def test_too_short_a_time_has_one_pass(room: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    timed = Rendering(0.2, 0.05, monkeypatch).of(room, 0.3)
    assert rendered(timed).metadata["settings"]["passes"] == 1
    assert timed.ending is Ending.OUT_OF_TIME


def test_dear_photons_are_traced_for_few_passes(room: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    cheap, dear = (
        rendered(Rendering(photons, 0.05, monkeypatch).of(room, 12.0)).metadata["settings"]["passes"]
        for photons in (0.01, 2.0)
    )
    assert dear < cheap
    assert dear <= 3


def test_ctrl_c_hands_over_what_was_done_and_how_to_repeat_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    render = PassRenderer.render

    def interrupted(renderer: PassRenderer, plan: PassPlan, *samples: Allotment) -> PassResult:
        if plan.number == 1:
            raise KeyboardInterrupt
        return render(renderer, plan, *samples)

    monkeypatch.setattr(PassRenderer, "render", interrupted)
    scene = ["cornell-box", "--size", "16x16", "--threads", "2", "--integrator", "path"]
    file, again = tmp_path / "so_far.exr", tmp_path / "again.exr"
    # Time counts from the start of the process: of one that runs tests, long ago.
    assert main(["render", *scene, "--time-budget", "9h", "-o", str(file)]) == 130
    monkeypatch.undo()
    said = capsys.readouterr().out
    assert "INTERRUPTED: the image is the best so far" in said
    words = shlex.split(said.split("to repeat it to the bit: ")[1].splitlines()[0])
    assert main([*words[1:], "-q", "-o", str(again)]) == 0
    assert main(["compare", str(file), str(again), "--equal", "--flip", "none"]) == 0


def test_a_time_alone_gives_an_image(tmp_path: Path) -> None:
    file = tmp_path / "box.exr"
    assert main(["render", "cornell-box", "--size", "16x16", "--time-budget", "1s", "-q", "-o", str(file)]) == 0
    metadata = load_image(file).metadata
    assert metadata["asked"]["reached"]
    assert len(metadata["asked"]["pass_samples"]) == metadata["settings"]["passes"]


costs = st.builds(
    PassCosts.measured,
    st.integers(1, 64),
    st.floats(0.01, 100.0),
    st.fixed_dictionaries({"records": st.floats(0.0, 5.0), "render": st.floats(0.001, 50.0)}),
    st.none() | st.builds(PassCosts, st.integers(1, 64), *[st.floats(0.0, 9.0)] * 4),
)


@given(costs, st.floats(0.01, 1000.0))
def test_as_many_samples_as_there_is_time_for(known: PassCosts, seconds: float) -> None:
    found = known.samples_in(seconds, 4096)
    assert found == 0 or known.seconds(found) <= seconds
    assert found == 4096 or known.seconds(found + 1) > seconds
    assert known.seconds(known.samples) == pytest.approx(known.fixed + known.records + known.render)


def test_two_passes_tell_what_a_sample_adds() -> None:
    first = PassCosts.measured(1, 1.5, {"photons": 0.5, "render": 1.0})
    assert first.seconds(11) == pytest.approx(11.5), "all grows, as far as one pass tells"
    second = PassCosts.measured(11, 7.5, {"photons": 0.5, "render": 7.0}, first)
    assert second.seconds(21) == pytest.approx(0.5 + 7.0 + 10 * 0.6)
    alike = PassCosts.measured(12, 9.5, {"photons": 0.5, "render": 9.0}, second)
    assert alike.seconds(24) == pytest.approx(18.5), "the machine was slower, rather than the sample dearer"


def test_passes_in_words() -> None:
    assert passes_in_words((4,)) == "1 pass of 4 samples"
    assert passes_in_words((1, 1)) == "2 passes of 1 sample"
    assert passes_in_words((1, 8, 9)) == "3 passes of 1, 8 and 9 samples"
    assert passes_in_words((1, *range(2, 10))) == "9 passes of 1 to 9 samples"


@pytest.mark.parametrize(("seconds", "first"), [(3.0, 2), (1.25, 1)])
def test_what_is_chosen_on_a_busy_machine_is_for_more_samples_than_one(
    seconds: float, first: int, room: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Passes of a time have few samples where others are at work, and what suits one or two suits no others."""
    clock = Rendering(0.2, 0.05, monkeypatch)
    monkeypatch.setattr("wdpm.goal.default_passes.idle_share", lambda: 0.04)
    scene = replace(room, camera=replace(room.camera, width=64, height=64))
    timed = clock.of(scene, seconds, integrator="path")
    assert timed.passes.samples_of_first(FIRST_SHARE) <= 1
    timed.begin()
    assert [plan.spp for plan in clock.passes] == [first]
    assert timed.passes.renderer.prepared.settings.plan_samples == 4
