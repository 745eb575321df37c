"""Lamps in any unit: what is decided, and the picture, do not depend on it where a picture needs an exposure anyway."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wdpm.cluster.plan.small_view import BRIGHTEST, DIMMEST, RELMSE_EPSILON, relmse_epsilon
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.kernels.compile import compile_kernels
from wdpm.kernels.launch import Launcher
from wdpm.rendering.automatic_settings import choose_settings
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import Scene


def lit(scene: Scene, times: float) -> Scene:
    """The same with lamps so many times as strong."""
    meshes = tuple(
        mesh if mesh.emission is None else replace(mesh, emission=tuple(times * value for value in mesh.emission))
        for mesh in scene.meshes
    )
    return replace(scene, meshes=meshes)


@pytest.mark.parametrize("radiance", [DIMMEST, 0.2, BRIGHTEST])
def test_a_picture_that_can_be_looked_at_is_weighed_as_relative_errors_are(radiance: float) -> None:
    assert relmse_epsilon(np.full((4, 6, 3), radiance)) == pytest.approx(RELMSE_EPSILON)


@pytest.mark.parametrize("radiance", [1e-9, DIMMEST / 10, 10 * BRIGHTEST, 1e9])
def test_others_are_weighed_as_with_their_exposure(radiance: float) -> None:
    image = radiance * np.array([0.25, 1.0, 4.0])[None, :, None] * np.ones((5, 3, 3))
    image[0, 1] = 0.0
    further = 1024.0 if radiance > BRIGHTEST else 1.0 / 1024.0
    assert relmse_epsilon(further * image) == pytest.approx(relmse_epsilon(image) * further**2)
    shown = BRIGHTEST if radiance > BRIGHTEST else DIMMEST
    assert relmse_epsilon(image) == pytest.approx(RELMSE_EPSILON * (radiance / shown) ** 2)


def test_black_is_weighed_as_ever() -> None:
    assert relmse_epsilon(np.zeros((2, 2, 3))) == RELMSE_EPSILON


def test_weak_lamps_of_any_unit_lead_to_the_same_decisions() -> None:
    def chosen(scene: Scene) -> tuple[RenderSettings, tuple[str, ...]]:
        settings = RenderSettings(integrator=Integrator.AUTO)
        found = choose_settings(
            flatten(scene), settings, Launcher("cpu", 1), lambda features: compile_kernels("cpu", features)
        )
        return found.settings, tuple(found.chose)

    box = cornell_box((256, 256))
    weak, weaker = (chosen(lit(box, 2.0**-power)) for power in (9, 19))
    assert weak == weaker
    assert weak[0].integrator is Integrator.PHOTONS
    assert weak[0].photons == chosen(box)[0].photons
