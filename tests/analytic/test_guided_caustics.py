"""Paths guided to caustics: a mirror's image of a lamp lights a patch as Lambert says, and a rough metal's with less
noise and the same mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import view
from mirrored_lamp import ALBEDO, IMAGE, RADIANCE, mirrored
from polygon_light import polygon_irradiance

from wdpm.cluster.plan.caustics import guide
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Scene

PATH = RenderSettings(integrator=Integrator.PATH, all_effects=True, max_depth=3)


@pytest.mark.parametrize("place", [(0.5, -0.3), (-0.6, 0.4), (1.5, 1.2)])
def test_a_mirrored_lamp_lights_a_patch(place: tuple[float, float]) -> None:
    """The camera sees about 1e-2 of the floor. Without a guide one sample in a thousand finds the lamp."""
    point, normal = np.array((place[0], 0.0, place[1])), np.array((0.0, 1.0, 0.0))
    camera = view(point + np.array((0.03, 0.6, 0.05)), point, 1.0)
    image = render_in_process(mirrored(camera=camera), replace(PATH, spp=256), workers=1)
    pixels = image.layers["indirect"].astype(np.float64).reshape(-1, 3)
    error = pixels.std(axis=0) / np.sqrt(len(pixels))
    exact = np.array(ALBEDO) * RADIANCE / np.pi * polygon_irradiance(IMAGE, point, normal)
    assert (error < 0.02 * exact).all(), error / exact
    assert (np.abs(pixels.mean(axis=0) - exact) < 5 * error).all(), (pixels.mean(axis=0) - exact) / error


def under_a_point(alpha: float) -> Scene:
    """The same wall of metal under a light without extent, which shadow rays find from there."""
    scene = mirrored(alpha)
    return replace(scene, meshes=scene.meshes[:2], lights=(PointLight("point", (-0.2, 1.0, 0.0), (1.0, 1.0, 1.0)),))


def indirect(scene: Scene, seeds: int, spp: int) -> np.ndarray:
    """Of several renders, mean of RGB, shape [seeds, height, width]."""
    images = [render_in_process(scene, replace(PATH, spp=spp, seed=s), workers=1) for s in range(seeds)]
    return np.array([image.layers["indirect"].mean(axis=2) for image in images], np.float64)


@pytest.mark.parametrize(
    "scene", [mirrored(0.02), mirrored(0.08), under_a_point(0.08)], ids=["nearly a mirror", "rough", "point"]
)
def test_a_rough_metal_has_the_same_mean_and_less_noise(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    guided = indirect(scene, 4, 16)
    monkeypatch.setattr(guide, "WORTH", 0.0)
    plain = indirect(scene, 8, 256)
    deviation = np.hypot(*(made.mean(axis=(1, 2)).std(ddof=1) / np.sqrt(len(made)) for made in (guided, plain)))
    assert abs(guided.mean() - plain.mean()) < 4.5 * deviation
    assert deviation < 0.1 * plain.mean()
    assert 16 * guided.var(axis=0, ddof=1).mean() < 0.2 * 256 * plain.var(axis=0, ddof=1).mean()
