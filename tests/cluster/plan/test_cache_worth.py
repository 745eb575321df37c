"""`--indirect auto` with photons: an irradiance cache, also where few photons come to what is seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from two_rooms import rooms

import wdpm
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.images.comparison import compare
from wdpm.kernels.compile import compile_kernels
from wdpm.kernels.launch import Launcher
from wdpm.rendering.automatic_settings import ChosenSettings, choose_settings
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import Scene

MOST_BLOTCHES = 0.03
"""Root mean square of the relative error that is wider than 16 pixels, of 16 samples a pixel. Records that read photons
straight from the lamp, with as many rays each, had 0.036 to 0.050, and as many path tracing samples have 0.1."""


def lit_from_above(size: tuple[int, int] = (512, 512)) -> Scene:
    """The Cornell box: its lamp shines into the room."""
    return cornell_box(size)


def lit_by_its_ceiling(size: tuple[int, int] = (512, 512)) -> Scene:
    """The same with a small lamp below the ceiling that shines at it: most photons land in one patch at first."""
    scene = cornell_box(size)
    lamp = scene.meshes[-1]
    middle = lamp.vertices.mean(axis=0)
    small = (lamp.vertices - middle) * 0.2 + middle - (0.0, 60.0, 0.0)
    up = replace(lamp, vertices=small, faces=lamp.faces[:, ::-1], normals=None, emission=(5e3, 3.5e3, 1.2e3))
    return replace(scene, meshes=(*scene.meshes[:-1], up))


def lit_next_door(size: tuple[int, int] = (512, 512)) -> Scene:
    """Two rooms: the camera is in one, whose lamp is dim, and nearly all photons are in the other."""
    scene = rooms(size=size)
    dim = [
        replace(mesh, emission=(0.4, 0.4, 0.4)) if mesh.emission == (4.0, 4.0, 4.0) else mesh for mesh in scene.meshes
    ]
    return replace(scene, meshes=tuple(dim))


def settled(scene: Scene, **chosen: Any) -> ChosenSettings:
    settings, launcher = RenderSettings(integrator=Integrator.PHOTONS, **chosen), Launcher("cpu", 1)
    return choose_settings(flatten(scene), settings, launcher, lambda features: compile_kernels("cpu", features))


@pytest.mark.parametrize("scene", [lit_from_above, lit_by_its_ceiling, lit_next_door])
def test_a_cache_is_chosen_wherever_the_photons_are(scene: Callable[[], Scene]) -> None:
    found = settled(scene())
    assert found.settings.indirect is Indirect.CACHE
    assert found.chose[0].startswith("indirect light: cache, since ")


def test_what_few_photons_reach_is_better_told_by_rays_that_go_on_than_by_a_map() -> None:
    """Such a scene had the map, in which the few photons are blotches, and what they do not reach is black."""
    scene = lit_next_door((48, 48))
    truth = wdpm.render(scene, RenderSettings(integrator=Integrator.PATH, spp=1024, seed=100)).pixels
    photons = RenderSettings(integrator=Integrator.PHOTONS, spp=16, photons=60_000)
    by_map, by_cache = (
        wdpm.render(scene, replace(photons, indirect=kind)).pixels for kind in (Indirect.MAP, Indirect.CACHE)
    )
    wrong_map, wrong_cache = (float(((pixels - truth) ** 2).mean()) for pixels in (by_map, by_cache))
    assert wrong_cache < 0.5 * wrong_map


def test_a_room_lit_by_its_ceiling_has_no_blotches() -> None:
    """With photons straight from the lamp among the others, and records of a fixed number of rays, it had."""
    scene = lit_by_its_ceiling((64, 64))
    truth = wdpm.render(scene, RenderSettings(indirect=Indirect.GATHER, spp=512, photons=60_000, seed=100))
    for seed in range(2):
        image = wdpm.render(scene, RenderSettings(indirect=Indirect.CACHE, spp=16, photons=60_000, seed=seed))
        found = compare(image, truth)
        assert found.blotches is not None
        assert found.blotches.error < MOST_BLOTCHES
        assert np.allclose(found.ratio, 1.0, atol=0.01)


def test_what_was_asked_for_is_not_tried() -> None:
    for kind in (Indirect.CACHE, Indirect.GATHER, Indirect.MAP):
        found = settled(lit_next_door(), indirect=kind)
        assert found.settings.indirect is kind
        assert (found.chose, found.pilot) == ((), None)


def test_a_pilot_that_was_flown_to_choose_changes_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The image is that of the way that was chosen, asked for by name, in one cell and in several."""
    monkeypatch.setattr("wdpm.cluster.integrators.indirect_choice.SAMPLES_TO_REPAY", 1)
    scene, settings = cornell_box((16, 16)), RenderSettings(spp=2, photons=20_000)
    chosen = wdpm.render(scene, settings)
    assert chosen.metadata["settings"]["indirect"] == "cache"
    by_name = wdpm.render(scene, replace(settings, indirect=Indirect.CACHE))
    assert chosen.digest() == by_name.digest()
    assert render_in_process(scene, settings, workers=2, cells=2).digest() == chosen.digest()
