"""Projectors, and which way up lights show their pictures."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from light_rig import emitted, table_of
from mitsuba_xml import emitter, number, read_body

from wdpm.scenes.model.lights import ProjectorLight, SpotLight

read = partial(read_body, after='<shape type="rectangle"/>')


def test_projector(tmp_path: Path) -> None:
    """A white one is 90 degrees wide here; of a picture, the shape is that of its pixels."""
    place = '<transform name="to_world"><lookat origin="0 0 5" target="0 0 0" up="0 1 0"/></transform>'
    (white,) = read(tmp_path, emitter("projector", place + number("fov", 90) + number("scale", 2))).lights
    assert isinstance(white, ProjectorLight)
    assert (white.fov, white.aspect, white.texture) == (90.0, 1.0, None)
    np.testing.assert_allclose(white.intensity, [2 * np.pi] * 3)
    np.testing.assert_allclose(white.to_world[:3, 3], [0.0, 0.0, 5.0])
    imageio.imwrite(tmp_path / "slide.png", np.full((2, 6, 3), 255, np.uint8))
    texture = '<texture type="bitmap" name="irradiance"><string name="filename" value="slide.png"/></texture>'
    (slide,) = read(tmp_path, emitter("projector", texture + '<string name="fov_axis" value="y"/>')).lights
    assert isinstance(slide, ProjectorLight)
    assert slide.texture is not None
    assert slide.aspect == 3.0


@pytest.mark.parametrize(("kind", "name"), [("spot", "texture"), ("projector", "irradiance")])
def test_pictures_of_lights_are_the_way_up_that_mitsuba_has_them(kind: str, name: str, tmp_path: Path) -> None:
    """A picture's first row is Mitsuba's v = 0. A spot's v grows along its y, a projector's against it."""
    rows = np.array([[[100] * 3], [[200] * 3]], np.uint8)
    imageio.imwrite(tmp_path / "rows.png", rows)
    texture = f'<texture type="bitmap" name="{name}"><string name="filename" value="rows.png"/></texture>'
    (light,) = read(tmp_path, emitter(kind, texture + (number("fov", 60) if kind == "projector" else ""))).lights
    assert isinstance(light, SpotLight | ProjectorLight)
    photons = emitted(table_of(others=[light], textures=[light.texture]), 512, [light.texture])
    height = photons.direction[:, 1]
    upper, lower = photons.flux[height > 0, 0].mean(), photons.flux[height < 0, 0].mean()
    assert (upper > lower) == (kind == "spot")
