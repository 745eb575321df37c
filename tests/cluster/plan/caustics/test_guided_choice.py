"""What caustics are thought to cost path tracing is that of paths as they are rendered: guided to these."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mirrored_lamp import mirrored
from window_room import constant_sky

from wdpm.cluster.plan.caustics.guide import NO_CAUSTICS_LEARNT, CausticsLearnt, learn_caustics
from wdpm.cluster.plan.render_plan import make_render_plan
from wdpm.cluster.plan.trial.prices import LOOK_BY_GUIDE
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.kernels.compile import compile_kernels
from wdpm.kernels.launch import Launcher
from wdpm.rendering.automatic_settings import ChosenSettings, choose_settings
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.scene import Material, Scene

AUTO = RenderSettings(integrator=Integrator.AUTO, spp=4, all_effects=True)


def settled(flat: FlatScene, chosen: RenderSettings = AUTO) -> ChosenSettings:
    return choose_settings(flat, chosen, Launcher("cpu", 1), lambda features: compile_kernels("cpu", features))


def by_caustics(chosen: ChosenSettings) -> float:
    """What caustics are said to add to the error of paths; 0 if nothing is said."""
    found = re.search(r"\(relMSE \S+ (\S+) of it by caustics", chosen.chose[0])
    return float(found[1]) if found else 0.0


def plain(_flat: object, _settings: object, _view: object, _pilot: object) -> CausticsLearnt:
    return NO_CAUSTICS_LEARNT


def metal_room(side: int) -> Scene:
    """A box with a floor that is matt, and walls that are nearly mirrors."""
    metal, room = Material("metal", Conductor(alpha_u=0.03, alpha_v=0.03)), cornell_box((side, side))
    return replace(room, materials=(room.materials[0], *[metal] * (len(room.materials) - 1)))


@pytest.fixture
def scene() -> Scene:
    """A mirror that lights a floor, under a faint sky."""
    return replace(mirrored(), lights=(constant_sky(),))


def test_guided_paths_are_thought_to_find_caustics_with_less_noise(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    guided = by_caustics(settled(flatten(scene)))
    monkeypatch.setattr("wdpm.cluster.plan.integrator_trial.learn_caustics", plain)
    unguided = by_caustics(settled(flatten(scene)))
    assert 0.0 < guided < 0.2 * unguided


def test_what_guided_paths_seldom_find_of_rough_metals_is_told_by_photons(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A trial of a few thousand samples does not meet it; without a guide all of that noise is left to the trial."""
    flat = flatten(metal_room(32))
    settings = replace(AUTO, spp=2)
    monkeypatch.setattr("wdpm.cluster.plan.integrator_trial.LOOK_BY_GUIDE", 0.0)
    assert by_caustics(settled(flat, settings)) > 0.0
    monkeypatch.setattr("wdpm.cluster.plan.integrator_trial.learn_caustics", plain)
    assert by_caustics(settled(flat, settings)) == 0.0


def test_what_is_learnt_to_choose_is_what_a_render_by_paths_learns(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So a render by what was chosen has the bits of one by the same settings, and does not learn it again."""
    learnt: list[CausticsLearnt] = []

    def noted(*arguments: Any) -> CausticsLearnt:
        learnt.append(learn_caustics(*arguments))
        return learnt[-1]

    monkeypatch.setattr("wdpm.cluster.plan.integrator_trial.learn_caustics", noted)
    flat = flatten(scene)
    settled(flat)
    anew = make_render_plan(flat, replace(AUTO, integrator=Integrator.PATH), 1, Launcher("cpu", 1))
    (chosen,) = learnt
    assert len(chosen.guide)
    assert chosen.left == anew.caustics.left
    for name, column in vars(anew.caustics.guide).items():
        np.testing.assert_array_equal(getattr(chosen.guide, name), column, err_msg=name)
    given = make_render_plan(flat, replace(AUTO, integrator=Integrator.PATH), 1, Launcher("cpu", 1), caustics=chosen)
    assert given.caustics is chosen


@pytest.mark.parametrize(
    ("side", "spp", "price", "guided"),
    [(32, 2, 0.0, True), (32, 2, LOOK_BY_GUIDE, False), (64, 16, 0.0, False)],
    ids=["perhaps", "for its price", "never"],
)
def test_paths_that_cannot_pay_are_not_guided_for_nothing(
    side: int, spp: int, price: float, guided: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A guide takes a tenth of a second and more to be learnt, which counts."""
    monkeypatch.setattr("wdpm.cluster.plan.integrator_trial.LOOK_BY_GUIDE", price)
    asked: list[int] = []

    def noted(*_: object) -> CausticsLearnt:
        asked.append(1)
        return NO_CAUSTICS_LEARNT

    monkeypatch.setattr("wdpm.cluster.plan.integrator_trial.learn_caustics", noted)
    found = settled(flatten(metal_room(side)), replace(AUTO, spp=spp))
    assert found.settings.integrator is Integrator.PHOTONS
    assert bool(asked) == guided
    assert ("is expected to be at least " in found.chose[0]) == (not guided)
