"""Outlines of lamps: which pixels they cross, by what is drawn here by hand, and what their samples are worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import wdpm
from wdpm.cluster.allotment import NO_LAMP_OUTLINES
from wdpm.cluster.plan import render_plan
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.photon_pilot import fly_pilot
from wdpm.cluster.plan.render_plan import lamp_outlines
from wdpm.cluster.plan.view import view_of
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.kernels.launch import Launcher
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.meshes.primitives import rectangle
from wdpm.scenes.model.bsdfs import Diffuse
from wdpm.scenes.model.scene import Camera, Material, Mesh, Scene

PATHS = RenderSettings(integrator=Integrator.PATH, spp=1)
CAMERA = Camera(np.eye(4), 90.0, 20, 20)
"""At distance 10 a pixel is a unit wide; +x is to the left and +y is up, so x is column 10 - x, and y row 10 - y."""


def square(x: float, y: float, z: float, half: float, *, shines: bool = True, away: bool = False) -> Mesh:
    """Facing the camera, or away from it."""
    data = rectangle()
    faces = data.faces if away else data.faces[:, ::-1]
    return Mesh(
        "square", data.vertices * half + (x, y, z), faces, None, data.uvs, 0, (5.0, 5.0, 5.0) if shines else None
    )


def seen(*meshes: Mesh, camera: Camera = CAMERA) -> NDArray[np.int32]:
    """As many times the samples of others each pixel takes, shape [height, width]."""
    scene = Scene("outlines", meshes, (Material("grey", Diffuse((0.5, 0.5, 0.5))),), (), camera)
    flat = flatten(scene)
    pilot = fly_pilot(flat, features_of(flat, PATHS), PATHS, Launcher("cpu", 1))
    pilot.worker.set_view(view_of(flat, PATHS, 1))
    outlines = lamp_outlines(flat, pilot.cell)
    pixels = np.arange(camera.width * camera.height)
    return outlines.times_of(pixels).reshape(camera.height, camera.width)


def ring() -> NDArray[np.bool_]:
    """The pixels that the outline of LAMP crosses."""
    image = np.zeros((20, 20), bool)
    image[7:14, 7:14] = True
    image[8:13, 8:13] = False
    return image


LAMP = square(-0.5, -0.5, 10.0, 3.0)


def test_an_outline_is_the_edge_of_a_lamp_without_the_diagonal_of_its_triangles() -> None:
    times = seen(LAMP)
    np.testing.assert_array_equal(times > 1, ring())


def test_what_faces_away_is_hidden_or_behind_the_camera_has_none() -> None:
    assert (seen(square(-0.5, -0.5, 10.0, 3.0, away=True)) == 1).all()
    assert (seen(square(-0.5, -0.5, -10.0, 3.0)) == 1).all()
    wall = square(0.0, 0.0, 5.0, 4.0, shines=False)
    assert (seen(LAMP, wall) == 1).all()
    half = square(2.5, 0.0, 5.0, 2.5, shines=False)  # from x = 0 on: columns up to 10
    np.testing.assert_array_equal((seen(LAMP, half) > 1)[:, 11:], ring()[:, 11:])
    assert (seen(LAMP, half) == 1)[:, :9].all()


def test_lamps_that_reach_past_the_image_and_past_the_camera_have_outlines_where_they_are_seen() -> None:
    vertices = np.array([[-500.0, -2.5, -500], [500, -2.5, -500], [500, -2.5, 500], [-500, -2.5, 500]])
    floor = replace(square(0, 0, 0, 1), vertices=vertices, faces=np.array([[0, 2, 1], [0, 3, 2]]))
    times = seen(floor)
    assert (times[[9, 10]] > 1).any(axis=0).all()  # the far edge, all along; the others are behind or beside
    assert (times[:9] == 1).all()
    assert (times[11:] == 1).all()


def test_parallel_cameras_and_crops_have_outlines_too() -> None:
    scale = np.diag([10.0, 10.0, 1.0, 1.0])
    parallel = replace(CAMERA, to_world=scale, orthographic=True)
    np.testing.assert_array_equal(seen(LAMP, camera=parallel) > 1, ring())
    crop = replace(CAMERA, width=9, height=6, crop=(4, 5, 9, 6), full_size=(20, 20))
    np.testing.assert_array_equal(seen(LAMP, camera=crop), seen(LAMP)[5:11, 4:13])


@pytest.mark.parametrize(("focus", "found"), [(10.0, True), (6.0, True), (2.0, False)])
def test_an_outline_that_is_far_out_of_focus_is_none(focus: float, found: bool) -> None:
    camera = replace(CAMERA, width=200, height=200)
    times = seen(LAMP, camera=replace(camera, aperture_radius=1.0, focus_distance=focus))
    assert bool((times > 1).any()) is found


def test_an_outline_out_of_focus_is_as_wide_as_its_blur() -> None:
    camera = replace(CAMERA, width=100, height=100)
    sharp = seen(LAMP, camera=camera) > 1
    wide = seen(LAMP, camera=replace(camera, aperture_radius=1.0, focus_distance=6.0)) > 1
    # A point at distance 10 becomes a disc of radius 1 (1 / 6 - 1 / 10) in units of which the image is 2.
    blur = (1.0 / 6.0 - 1.0 / 10.0) * 50.0
    row = 52
    assert np.flatnonzero(sharp[row])[0] - np.flatnonzero(wide[row])[0] == pytest.approx(blur, abs=1.0)


def test_many_lamps_everywhere_are_left_alone() -> None:
    lamps = [square(x + 0.5, y + 0.5, 10.0, 0.3) for x in range(-10, 10) for y in range(-10, 10)]
    assert (seen(*lamps) == 1).all()


def test_pixels_on_outlines_have_the_samples_of_a_render_with_more(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, settings = cornell_box((32, 32)), replace(PATHS, spp=2, passes=2, max_depth=3)
    with_more = wdpm.render(scene, settings)
    told = [line for line in with_more.metadata["report"]["chose"] if "outlines" in line]
    assert len(told) == 1
    times = int(told[0].split(" take ")[1].split()[0])
    monkeypatch.setattr(render_plan, "lamp_outlines", lambda *_: NO_LAMP_OUTLINES)
    without = wdpm.render(scene, settings)
    as_many = wdpm.render(scene, replace(settings, spp=2 * times))
    differ = (with_more.pixels != without.pixels).any(axis=2)
    assert 0 < differ.sum() < 0.1 * differ.size
    np.testing.assert_array_equal(with_more.pixels[differ], as_many.pixels[differ])
