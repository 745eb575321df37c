"""Guided shadow rays, in rooms with a small window or beside brighter ones: known light, less noise than without."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import two_rooms
import window_room
from furnaces import Array, view
from polygon_light import polygon_irradiance

from wdpm.cluster.plan import guide_starts, guide_tiles
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process

PATH = RenderSettings(integrator=Integrator.PATH, all_effects=True, max_depth=2)
RADIANCE = 0.5
WINDOW = np.array([[-1, 0, -1], [-1, 0.5, -1], [-1, 0.5, -0.5], [-1, 0, -0.5]], np.float64)
PLACES = {
    "floor": ((0.3, -1.0, -0.2), (0.0, 1.0, 0.0)),
    "wall across": ((1.0, 0.1, -1.2), (-1.0, 0.0, 0.0)),
    "wall at the end": ((0.5, -0.4, -2.0), (0.0, 0.0, 1.0)),
}


def assert_is(image: Image, exact: Array) -> None:
    """The mean of the direct light is this, within its noise, which is below 2 %."""
    pixels = image.layers["direct"].astype(np.float64).reshape(-1, 3)
    error = pixels.std(axis=0) / np.sqrt(len(pixels))
    assert (error < 0.02 * exact).all()
    assert (np.abs(pixels.mean(axis=0) - exact) < 5 * error).all()


@pytest.mark.parametrize("place", list(PLACES))
@pytest.mark.parametrize("guided", [True, False])
def test_a_window_lights_a_patch(place: str, guided: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The camera sees about 1e-2 of a surface, over which the irradiance is linear to 1e-4."""
    if not guided:
        monkeypatch.setattr(guide_tiles, "WORTH", 0.0)
    point, normal = (np.array(given) for given in PLACES[place])
    camera = view(point + normal * 0.6 + (0.03, 0.02, 0.05), point, 1.0)
    seen = replace(window_room.room(window_room.constant_sky(RADIANCE)), camera=camera)
    image = render_in_process(seen, replace(PATH, spp=256 if guided else 1024, light_samples=4), workers=1)
    assert_is(image, np.array(window_room.ALBEDO) * RADIANCE / np.pi * polygon_irradiance(WINDOW, point, normal))


@pytest.mark.parametrize("guided", [True, False])
def test_a_lamp_lights_a_patch_beside_stronger_ones_behind_a_wall(
    guided: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not guided:
        monkeypatch.setattr(guide_starts, "WORTH", 0.0)
    point, normal = np.array((0.3, -1.0, 0.4)), np.array((0.0, 1.0, 0.0))
    camera = view(point + normal * 0.6 + (0.03, 0.02, 0.05), point, 1.0)
    image = render_in_process(replace(two_rooms.rooms(), camera=camera), replace(PATH, spp=128), workers=1)
    lamp = np.array([[-0.1, 0.98, 0.6], [0.1, 0.98, 0.6], [0.1, 0.98, 0.8], [-0.1, 0.98, 0.8]])
    exact = np.array(window_room.ALBEDO) * 4.0 / np.pi * polygon_irradiance(lamp, point, normal)
    assert_is(image, exact)


GUIDED = {
    "a map through a window": (window_room.room(size=(24, 16)), 0.6),
    "a constant sky through a window": (window_room.room(window_room.constant_sky(), (24, 16)), 0.6),
    "lamps behind a wall": (two_rooms.rooms(size=(24, 16)), 0.5),
}
"""And which share of a pixel's variance is left at most, that by the rays that go on by the surface included."""


@pytest.mark.parametrize("name", list(GUIDED))
def test_a_guide_takes_most_of_the_noise(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    what, left = GUIDED[name]

    def variance() -> float:
        images = [render_in_process(what, replace(PATH, spp=8, seed=seed), workers=1) for seed in range(3)]
        direct = np.array([image.layers["direct"].mean(axis=2) for image in images], np.float64)
        return float(direct.var(axis=0, ddof=1).mean())

    with_guide = variance()
    monkeypatch.setattr(guide_tiles, "WORTH", 0.0)
    monkeypatch.setattr(guide_starts, "WORTH", 0.0)
    assert with_guide < left * variance()
