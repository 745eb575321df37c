"""What maps show too much is told by paths: light of the next room that gathers bring in, and no noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from two_rooms import rooms

from wdpm.cluster.plan import integrator_trial
from wdpm.cluster.plan.integrator_trial import OVER_WIDE
from wdpm.cluster.plan.trial.bias import REGION, SURE, _beyond_noise
from wdpm.cluster.plan.trial.figures import Trial
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.kernels.compile import compile_kernels
from wdpm.kernels.launch import Launcher
from wdpm.rendering.automatic_settings import choose_settings
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import Scene

SHAPE = (8 * REGION, 8 * REGION)


def noisy(seed: int, scale: float) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, scale, SHAPE)


def test_what_both_halves_differ_by_is_bias_and_noise_is_none() -> None:
    alike = _beyond_noise([0.5 + noisy(1, 0.1), 0.5 + noisy(2, 0.1)])
    assert alike.mean() == pytest.approx(0.25, rel=0.05)
    of_means = 1.0 / (2 * REGION**2)
    assert _beyond_noise([noisy(3, 1.0), noisy(4, 1.0)]).mean() < 0.2 * of_means
    assert len(alike) == 64


def test_what_is_shown_too_little_is_left_to_those_who_count_surface() -> None:
    assert _beyond_noise([noisy(1, 0.1) - 0.5, noisy(2, 0.1) - 0.5]).max() == 0.0


def test_one_bright_sample_is_no_bias() -> None:
    bright = np.zeros(SHAPE)
    bright[5, 7] = 1e4
    assert _beyond_noise([bright, np.zeros(SHAPE)]).max() == 0.0


def test_noise_that_is_alike_in_a_region_is_told_by_the_halves() -> None:
    """As that of the photons of a map, which its pixels have in common."""
    means = np.array([1.0, -0.2]).repeat(REGION)
    half = np.tile(means, (REGION, 1))
    assert SURE >= 1.0
    assert _beyond_noise([half, -half]).max() == 0.0


def test_images_smaller_than_a_region_are_one() -> None:
    assert _beyond_noise([np.ones((2, 3)), np.ones((2, 3))]) == pytest.approx([1.0])


def tried(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> Trial:
    """The trial of a scene, in `auto` by default."""
    trials: list[Trial] = []
    ask_photons: Callable[..., Trial] = integrator_trial._ask_photons

    def noted(*arguments: Any) -> Trial:
        trials.append(ask_photons(*arguments))
        return trials[-1]

    monkeypatch.setattr(integrator_trial, "_ask_photons", noted)
    monkeypatch.setattr(integrator_trial, "_surely_by_paths", lambda *_: None)
    settings = RenderSettings(integrator=Integrator.AUTO, spp=16)
    choose_settings(flatten(scene), settings, Launcher("cpu", 1), lambda features: compile_kernels("cpu", features))
    return trials[0]


def beside_others(lamp: float) -> Scene:
    """Behind a wall six lamps of radiance 40, before it one that is weaker."""
    scene = rooms(size=(64, 64))
    meshes = [replace(mesh, emission=(lamp,) * 3) if mesh.emission == (4.0,) * 3 else mesh for mesh in scene.meshes]
    return replace(scene, meshes=tuple(meshes))


def test_light_of_the_next_room_is_seen_and_a_room_by_itself_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall that is thinner than gathers are wide, behind which it is many times as bright."""
    beside, alone = tried(beside_others(0.4), monkeypatch), tried(cornell_box((64, 64)), monkeypatch)
    assert beside.bias > OVER_WIDE * beside.by_paths.indirect
    assert alone.bias < 0.1 * OVER_WIDE * alone.by_paths.indirect
