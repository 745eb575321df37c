"""Times that are spent as a render by default would spend them."""

from __future__ import annotations

from dataclasses import replace

import pytest

import wdpm
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.goal.by_default import is_matt
from wdpm.goal.goal import Goal
from wdpm.goal.schedule import Schedule, plain
from wdpm.goal.trial import Trial
from wdpm.goal.trial_pilot import TrialPilot, Workplace
from wdpm.progress import SilentProgress
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.pass_plan import PassPlan, PassResult
from wdpm.rendering.passes import PassRenderer
from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.scene import Material, Medium, Scene


@pytest.fixture(scope="module")
def room() -> Scene:
    scene = wdpm.load("cornell-box")
    return replace(scene, camera=replace(scene.camera, width=96, height=96))


def with_mirror(scene: Scene) -> Scene:
    return replace(scene, materials=(*scene.materials, Material("mirror", Conductor())))


def test_what_is_matt(room: Scene) -> None:
    assert is_matt(room)
    assert not is_matt(with_mirror(room))
    assert not is_matt(replace(room, media=(Medium("fog", (1.0,) * 3, (0.5,) * 3),)))


def test_a_time_for_a_matt_scene_is_spent_as_by_default(room: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """By records of a few passes of many samples, if there is time to choose; else as other scenes are."""
    now, late = 0.0, 0.0
    render, prepare = PassRenderer.render, InProcess.prepare

    def timed(renderer: PassRenderer, plan: PassPlan, *samples: object) -> PassResult:
        nonlocal now
        seconds = {"photons": 0.5, "render": 0.05 * plan.spp}
        now += sum(seconds.values())
        return replace(render(renderer, plan, *samples), seconds=seconds)  # type: ignore[arg-type]

    def slow(self: InProcess, *given: object) -> object:
        nonlocal now
        now += late
        return prepare(self, *given)  # type: ignore[arg-type]

    monkeypatch.setattr(PassRenderer, "render", timed)
    monkeypatch.setattr(InProcess, "prepare", slow)
    work = Workplace(InProcess(threads=2), SilentProgress(), lambda: now)

    def chosen(what: Scene, budget: float) -> Schedule:
        nonlocal now
        now = 0.0
        pilot = TrialPilot(what, RenderSettings(), frozenset(), work)
        pilot.run(Goal(seconds=budget), lambda: budget - now)
        return pilot.best(Goal(seconds=budget), budget - now)[0]

    for budget in (10.0, 100.0):
        by_default = chosen(room, budget)
        assert by_default.settings.indirect is Indirect.CACHE
        assert by_default.settings.photons == RenderSettings().photons
        assert by_default.samples >= 16
        assert by_default.seconds <= budget
    assert chosen(with_mirror(room), 10.0).settings.photons < RenderSettings().photons
    late = 2.0
    assert chosen(room, 10.0).settings.photons < RenderSettings().photons


def test_a_plain_schedule_begins_with_half_the_time_at_most() -> None:
    trial = Trial(RenderSettings(), 0.5, 1.0, 0.2, 0.0, 0.0, 0.0, measured=False)
    found = plain(trial, 20.0)
    assert (found.samples, found.passes) == (32, 2)  # 0.5 + 1 + 32 x 0.2 = 7.9, and 7.4 once more; 64 would take 14.3
    assert found.seconds <= 20.0
    assert plain(trial, 0.1).settings.spp == 1
