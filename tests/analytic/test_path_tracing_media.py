"""Path tracing in participating media: equilibrium, single scattering by quadrature, Beer's law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fog import INSIDE, WHITE, foggy, foggy_furnace, single_scattering
from furnaces import box, quad, rendered, scene, view
from path_traced import PATH, mean_and_deviation, over_seeds

from wdpm.scenes.model.bsdfs import Null
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Camera, Material, Medium


@pytest.mark.parametrize(
    ("sigma_t", "g"),
    [((0.5,) * 3, 0.0), ((3.0,) * 3, -0.6), ((3.0,) * 3, 0.9), ((10.0,) * 3, 0.0), ((0.3, 1.0, 3.0), 0.4)],
    ids=["thin", "backward", "forward", "dense", "coloured"],
)
def test_white_fog_in_a_furnace_is_not_seen(sigma_t: tuple[float, float, float], g: float) -> None:
    """What scatters is in equilibrium with the walls, whatever its depth, phase function and colour."""
    image = rendered(foggy_furnace(Medium("milk", sigma_t, WHITE, g)), spp=256, **PATH)
    mean, deviation = mean_and_deviation(image.pixels)
    assert (np.abs(mean - 2.0) <= 4 * deviation).all(), (mean, deviation)
    assert (deviation < 0.05).all()
    assert image.layers["volume"].mean() > 0.3


def test_white_fog_without_end_under_a_sky_is_not_seen() -> None:
    """No ray from the camera meets a surface: paths collide on their way out of the scene."""
    behind = box((0.1, 0.1, 0.1), (0, 0, -2.0))
    what = replace(
        scene([behind], INSIDE, WHITE, ()),
        lights=(Environment("sky", np.ones((1, 1, 3), np.float32)),),
        media=(Medium("milk", (0.5, 0.8, 1.1), WHITE, 0.3),),
    )
    image = rendered(what, spp=256, **PATH)
    mean, deviation = mean_and_deviation(image.pixels)
    assert (np.abs(mean - 1.0) <= 4 * deviation).all(), (mean, deviation)
    assert (deviation < 0.05).all()
    assert not image.layers["indirect"].any() or image.layers["indirect"].mean() < 0.01
    assert (image.layers["depth"] == 0).all()


@pytest.mark.parametrize("g", [0.0, 0.6, -0.4])
def test_single_scattering_is_that_of_quadrature(g: float) -> None:
    what = foggy(Medium("haze", (0.2, 0.5, 1.0), (0.9, 0.8, 0.6), g), 0.0)
    mean, deviation = over_seeds(what, "volume", spp=64, max_depth=2, **PATH)
    exact = single_scattering(what)
    # Of six seeds the deviation itself is uncertain by a third.
    assert (np.abs(mean - exact) <= 5 * deviation).all(), (mean, exact, deviation)
    assert (deviation < 0.015 * exact).all()


def test_a_medium_that_scatters_nothing_takes_its_share_exactly() -> None:
    """Beer's law, without noise: no path has a choice to make."""
    lamp = quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), 0, (5.0, 5.0, 5.0))
    camera: Camera = replace(view((0, 0, -0.9), (0, 0, 1), 0.01), medium=0)
    for sigma in (1e-6, 0.5, 20.0):
        what = replace(scene([lamp], camera, (0.0,) * 3), media=(Medium("soot", (sigma, sigma / 2, 0.0), (0.0,) * 3),))
        seen = rendered(what, spp=1, **PATH).pixels.astype(np.float64)
        exact = 5.0 * np.exp(-(1.9 - camera.near_clip) * np.array([sigma, sigma / 2, 0.0]))
        np.testing.assert_allclose(seen, np.broadcast_to(exact, seen.shape), rtol=1e-5)


def test_a_box_of_white_fog_in_a_furnace_is_not_seen() -> None:
    """A boundary that is nothing: shadow rays and paths go through it, into and out of the medium."""
    smoke = replace(box((0.4, 0.3, 0.35)), material=1, interior=0, bounds=True)
    wall = box((1, 1, 1), inside=True, emission=WHITE)
    what = scene([wall, smoke], view((0, 0, -0.9), (0, 0, 1), 40), (0.5,) * 3)
    what = replace(
        what, materials=(*what.materials, Material("nothing", Null())), media=(Medium("milk", (4.0,) * 3, WHITE, 0.2),)
    )
    image = rendered(what, spp=256, **PATH)
    mean, deviation = mean_and_deviation(image.pixels)
    assert (np.abs(mean - 2.0) <= 4 * deviation).all(), (mean, deviation)
    assert (deviation < 0.05).all()
