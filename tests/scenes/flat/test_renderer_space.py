"""The renderer's space: the same floats for a scene in any unit, and all that has a length in it turned alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wdpm.cluster.render_settings import RenderSettings
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.dropped import CAUSES, DUPLICATE
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.renderer_space import RendererSpace, renderer_space
from wdpm.scenes.model.bounds import bounding_box
from wdpm.scenes.model.bsdfs import GREY, BumpMap, Diffuse, Mask, TwoSided
from wdpm.scenes.model.lights import DirectionalLight, Environment, PointLight, SpotLight
from wdpm.scenes.model.scene import Camera, Material, Medium, Mesh, Scene
from wdpm.scenes.model.textures import Bitmap
from wdpm.scenes.model.transforms import look_at, rotation, scaling, translation

BOX = Mesh("box", np.array([[2.0, 10, 0], [6, 10, 0], [2, 12, 1]]), np.array([[0, 1, 2]]), None, None, 0)
SPACE = renderer_space([BOX])


def test_the_longest_side_goes_from_minus_1_to_1() -> None:
    assert SPACE.unit == 2.0
    np.testing.assert_array_equal(SPACE.place(BOX.vertices), [[-1, -0.5, -0.25], [1, -0.5, -0.25], [-1, 0.5, 0.25]])


def test_the_rounding_of_a_difference_is_nothing() -> None:
    space = RendererSpace(np.zeros(3), 2.0)
    np.testing.assert_array_equal(space.place([2e-15, -2e-15, 2e-14]), [0.0, 0.0, 1e-14])


def test_a_scene_of_one_point_and_one_without_triangles() -> None:
    point = replace(BOX, vertices=np.ones((3, 3)))
    assert renderer_space([point]).unit == 1.0
    with pytest.raises(SceneError, match="no triangles"):
        renderer_space([replace(BOX, faces=np.zeros((0, 3), np.int64))])


def test_what_has_a_length_is_turned_and_nothing_else() -> None:
    camera = SPACE.camera(Camera(translation((4, 11, 2.5)), 40.0, near_clip=0.1, far_clip=100.0, aperture_radius=0.5))
    np.testing.assert_array_equal(camera.to_world, translation((0, 0, 1)))
    assert (camera.near_clip, camera.far_clip, camera.aperture_radius, camera.focus_distance) == (0.05, 50, 0.25, 0.5)
    parallel = SPACE.camera(Camera(scaling((3, 3, 1)), 40.0, orthographic=True))
    np.testing.assert_array_equal(np.diag(parallel.to_world), [1.5, 1.5, 1, 1])

    point = SPACE.light(PointLight("point", (4, 11, 2.5), (4.0, 8.0, 12.0)))
    assert point == PointLight("point", (0.0, 0.0, 1.0), (1.0, 2.0, 3.0))
    spot = SPACE.light(SpotLight("spot", translation((6, 11, 0.5)), (4.0, 8.0, 12.0)))
    assert isinstance(spot, SpotLight)
    assert spot.intensity == (1.0, 2.0, 3.0)
    np.testing.assert_array_equal(spot.to_world, translation((1, 0, 0)))
    for light in (DirectionalLight("sun", (0, 0, -1), (1, 1, 1)), Environment("sky", np.ones((1, 1, 3), np.float32))):
        assert SPACE.light(light) is light
    assert SPACE.medium(Medium("fog", (1.0, 2.0, 3.0), GREY, 0.5)) == Medium("fog", (2.0, 4.0, 6.0), GREY, 0.5)

    waves = Bitmap("waves", np.ones((2, 2, 3), np.float32))
    plain, bumps = Material("plain", Diffuse()), Material("bumps", TwoSided(Mask(BumpMap(Diffuse(), waves, 3.0), 0.5)))
    assert SPACE.material(plain) is plain
    turned = SPACE.material(bumps).bsdf
    assert isinstance(turned, TwoSided)
    assert isinstance(turned.front, Mask)
    assert isinstance(turned.front.nested, BumpMap)
    assert (turned.front.nested.scale, turned.front.nested.height) == (1.5, waves)


@given(st.floats(1e-12, 1e12))
@settings(max_examples=30, deadline=None)
def test_a_scene_is_the_same_in_any_unit(by: float) -> None:
    """One corner in 2^28 may be rounded to the next float: none here, or `by` would have to aim at it."""
    scene = cornell_box()
    to_world = scene.camera.to_world.copy()
    to_world[:3, 3] *= by
    other = flatten(
        replace(
            scene,
            meshes=tuple(replace(mesh, vertices=mesh.vertices * by) for mesh in scene.meshes),
            camera=replace(scene.camera, to_world=to_world),
        )
    )
    flat = flatten(scene)
    np.testing.assert_allclose(other.triangles.positions, flat.triangles.positions, rtol=2.0**-23, atol=0)
    assert (other.triangles.positions == flat.triangles.positions).mean() > 0.99
    assert other.unit == pytest.approx(flat.unit * by, rel=1e-15)
    np.testing.assert_allclose(other.lights.power, flat.lights.power, rtol=1e-6)


@pytest.mark.parametrize("by", [1e-6, 1e-3, 1.0, 7e5])
def test_copies_are_known_in_any_unit(by: float) -> None:
    """A wall through the middle of a room, and copies turned around by three thirds, in doubles: zeros become 1e-17."""
    room = replace(cornell_box().meshes[0], emission=None)
    low, high = bounding_box([room])
    middle = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    dark = [
        replace(room, vertices=(room.vertices - (low + high) / 2) * by),
        Mesh("middle", middle * (100.0 * by), np.array([[0, 1, 2], [0, 2, 3]]), None, None, 0),
    ]
    lamp = Mesh("lamp", middle * (50.0 * by), np.array([[0, 1, 2]]), None, None, 0, (1.0, 1.0, 1.0))
    third = rotation((1.0, 2.0, 3.0), 120.0)[:3, :3]
    copies = [replace(m, vertices=m.vertices @ third.T @ third.T @ third.T) for m in dark]
    assert (copies[1].vertices[:, 2] != 0).any()
    flat = flatten(replace(cornell_box(), meshes=(*dark, *copies, lamp)))
    assert flat.dropped == {CAUSES[DUPLICATE]: sum(len(m.faces) for m in dark)}


def test_what_a_render_tells_is_in_the_scenes_own_units() -> None:
    """A lamp of radiance 1 and 2 x 2, 8 before the camera, in a scene whose unit is no power of two."""
    lamp = Mesh(
        "lamp",
        np.array([[-1.0, -1, 5], [1, -1, 5], [1, 1, 5], [-1, 1, 5]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
        None,
        None,
        0,
        (1.0, 1.0, 1.0),
    )
    wall = Mesh("wall", np.array([[-8.0, -8, 12], [8, -8, 12], [0, 16, 12]]), np.array([[0, 1, 2]]), None, None, 0)
    scene = Scene(
        "told",
        (lamp, wall),
        (Material("grey", TwoSided(Diffuse())),),
        (),
        Camera(look_at((0.5, 0, -3), (0.5, 0, 0), (0, 1, 0)), 1.0, 4, 4),
    )
    image = render_in_process(scene, RenderSettings(photons=1000, spp=1, radius=3.0), workers=1)
    report = image.metadata["report"]
    np.testing.assert_allclose(image.layers["depth"], 8.0, rtol=1e-3)
    assert report["settings"]["gather_radius"] == pytest.approx(3.0)
    assert report["energy"]["emitted"] == pytest.approx(4 * np.pi, rel=1e-4)
    assert report["photons"]["lights"][0]["flux"] == pytest.approx(4 * np.pi, rel=1e-4)
