"""The table of lights: who is in it, how triangles are wound, powers, media."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.light_table import LightTable, tabulate_lights
from wdpm.scenes.flat.material_table import NO_MEDIUM, SAME_MEDIUM
from wdpm.scenes.model.lights import DirectionalLight, Environment, Light, PointLight, SpotLight
from wdpm.scenes.model.scene import Camera, Mesh
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Texture, VertexColors

CORNERS = np.array([[[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 0, 2], [0, 1, 2], [2, 0, 2]]], np.float32)


def soup(corners: NDArray[np.float32], emitter: list[int], **more: NDArray[np.float32]) -> Triangles:
    count = len(corners)
    return Triangles(
        ids=np.arange(count, dtype=np.int32),
        positions=corners.astype(np.float32),
        normals=more.get("normals", np.zeros((count, 3, 3), np.float32)),
        uvs=more.get("uvs", np.zeros((count, 3, 2), np.float32)),
        material=np.zeros(count, np.int32),
        emitter=np.array(emitter, np.int32),
        colors=more.get("colors", np.zeros((0, 3, 3), np.float32)),
        area_before=np.zeros(count),
    )


def mesh(name: str, emission: tuple[float, float, float] | Texture = (1.0, 2.0, 3.0)) -> Mesh:
    return Mesh(name, np.zeros((0, 3)), np.zeros((0, 3), np.int64), None, None, 0, emission=emission)


def table(triangles: Triangles, meshes: list[Mesh], lights: list[Light] | None = None, **more) -> LightTable:
    textures = more.pop("textures", [])
    numbers = [next((i for i, t in enumerate(textures) if t is m.emission), -1) for m in meshes]
    return tabulate_lights(meshes, triangles, np.array(numbers, np.int32), textures, lights or [], **more)


OTHERS: list[Light] = [
    Environment("sky", np.ones((1, 1, 3), np.float32)),
    SpotLight("spot", np.eye(4), (1.0, 1.0, 1.0)),
    PointLight("point", (1.0, 2.0, 3.0), (1.0, 2.0, 3.0), 0),
    DirectionalLight("sun", (0.0, 0.0, -2.0), (1.0, 1.0, 4.0)),
]


def test_lights_are_in_the_order_of_their_kinds() -> None:
    triangles = soup(np.concatenate([CORNERS, CORNERS + 1]), [1, -1, 0, 1])
    found = table(triangles, [mesh("a"), mesh("b")], OTHERS)
    assert found.names == ("a", "b", "point", "spot", "sun", "sky")
    np.testing.assert_array_equal(found.prim, [0, 2, 3])
    np.testing.assert_array_equal(found.light, [1, 0, 1, 2, 3, 4, 5])
    np.testing.assert_array_equal(found.medium, [-1, -1, -1, 0, -1, -1, -1])
    kinds = [light.KIND.number for light in (PointLight, SpotLight, DirectionalLight)]
    np.testing.assert_array_equal(found.delta_kind, kinds)
    assert found.near == 2
    np.testing.assert_array_equal(found.delta_position[0], [1, 2, 3])
    np.testing.assert_array_equal(found.delta_axes[2, 2], [0, 0, -1])
    distance = math.sqrt((CORNERS.astype(np.float64) + 1).reshape(-1, 3).__pow__(2).sum(axis=1).max())
    assert 1.0 < found.scene_radius / distance < 1.002


def test_powers_are_those_of_the_formulas() -> None:
    found = table(soup(CORNERS, [0, 0]), [mesh("a")], OTHERS)
    cross_section = math.pi * found.scene_radius**2
    cutoff, beam = math.radians(20), math.radians(15)
    angle = np.linspace(0, cutoff, 100_001)
    falloff = np.clip((cutoff - angle) / (cutoff - beam), 0, 1)
    spot = 2 * math.pi * np.mean(falloff * np.sin(angle)) * cutoff
    expected = [
        math.pi * 0.5 * 2,
        math.pi * 1.0 * 2,
        4 * math.pi * 2,
        spot,
        cross_section * 2,
        cross_section * 4 * math.pi,
    ]
    np.testing.assert_allclose(found.power, expected, rtol=1e-4)


def test_corners_face_the_side_of_the_vertex_normals() -> None:
    down = np.zeros((2, 3, 3), np.float32)
    down[:, :, 2] = -1
    uvs = np.arange(12, dtype=np.float32).reshape(2, 3, 2)
    found = table(soup(CORNERS, [0, 0], normals=down, uvs=uvs), [mesh("a")])
    p = found.corners
    assert np.all(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])[:, 2] < 0)
    # the first was turned, the second faced down as it was; uvs stay at their corners
    np.testing.assert_array_equal(found.uvs[0], uvs[0][[0, 2, 1]])
    np.testing.assert_array_equal(found.uvs[1], uvs[1])


def test_textured_triangles_have_the_power_that_their_texture_shows() -> None:
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], np.float32)
    uvs = np.ascontiguousarray(square[..., :2])
    image = Bitmap("image", np.array([[[3, 3, 3], [0, 0, 0]], [[0, 0, 0], [0, 0, 0]]], np.float32))  # top left
    board = Checkerboard("board", (1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    colors = VertexColors("colors", 2.0)
    corner_colors = np.ones((6, 3, 3), np.float32)
    corner_colors[4:] = [[[0, 0, 0], [1, 1, 1], [0.5, 0.5, 0.5]]]
    corners = np.concatenate([square + np.array([x, 0, 0]) for x in (0, 2, 4)]).astype(np.float32)
    triangles = soup(corners, [0, 0, 1, 1, 2, 2], uvs=np.tile(uvs, (3, 1, 1)), colors=corner_colors)
    found = table(triangles, [mesh("a", image), mesh("b", board), mesh("c", colors)], textures=[image, board, colors])
    np.testing.assert_array_equal(found.emitter_texture, [0, 1, 2])
    by_light = np.bincount(found.light, found.power) / math.pi
    np.testing.assert_allclose(by_light, [3 / 4, 1 / 2, 2 * 0.5], rtol=0.02)
    # The texel is wholly in the upper triangle; the lower one is kept alive by the least share.
    assert found.power[0] == pytest.approx(1e-3 * 0.75 * math.pi / 2)


BOX_SIDES = {True: (3, 1), False: (1, 3)}


@pytest.mark.parametrize("outwards", [True, False])
def test_the_medium_around_a_light_is_that_of_the_box_that_it_is_in(outwards: bool) -> None:
    """Lights that name no medium, in a box whose walls face either way. Walls that bound nothing do not count."""
    walls = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            quad = np.zeros((4, 3))
            quad[:, (axis + 1) % 3], quad[:, (axis + 2) % 3] = [-1, 1, 1, -1], [-1, -1, 1, 1]
            quad[:, axis] = side
            order = [0, 1, 2, 3] if (side > 0) == outwards else [3, 2, 1, 0]
            q = quad[order]
            walls += [q[[0, 1, 2]], q[[0, 2, 3]]]
    box = np.array(walls)
    corners = np.concatenate([box * 2, box * 0.9, CORNERS * 0.1]).astype(np.float32)
    interior, exterior = BOX_SIDES[outwards]
    sides = np.full((len(corners), 2), SAME_MEDIUM, np.int32)
    sides[:12] = interior, exterior  # behind, before
    triangles = soup(corners, [-1] * 24 + [0, 0])
    lights: list[Light] = [
        PointLight("in", (0.1, 0.2, 0.3), (1.0, 1.0, 1.0)),
        PointLight("out", (5.0, 0.2, 0.3), (1.0, 1.0, 1.0)),
        PointLight("before the box", (-5.0, -11.5, -6.3), (1.0, 1.0, 1.0)),
        PointLight("told", (0.1, 0.2, 0.3), (1.0, 1.0, 1.0), 7),
    ]
    found = table(triangles, [mesh("lamp")], lights, sides=sides)
    inside, outside = 3, 1
    np.testing.assert_array_equal(found.medium, [inside, inside, inside, NO_MEDIUM, outside, 7])
    aside = corners[-1:] + np.float32([5, 0, 0])  # out of the box
    half_out = np.concatenate([corners[:-1], aside])
    apart = table(soup(half_out, [-1] * 24 + [0, 0]), [mesh("lamp")], sides=sides)
    np.testing.assert_array_equal(apart.medium, [inside, NO_MEDIUM])
    bounding = replace(mesh("lamp"), bounds=True, exterior=5)
    assert table(triangles, [bounding], sides=sides).medium[0] == 5
    assert table(triangles, [mesh("lamp")]).medium[0] == NO_MEDIUM


def test_lights_that_no_boundary_parts_from_the_camera_are_in_its_medium() -> None:
    """A room full of fog, which only the camera names; and the same with a thing in it that holds another medium."""
    thing = np.array([[[-1, -1, 0], [1, -1, 0], [0, 1, 0]]], np.float32) * np.float32(20.0)
    corners = np.concatenate([CORNERS, thing]).astype(np.float32)
    triangles = soup(corners, [0, 0, -1])
    foggy = Camera(np.eye(4), 40.0, 8, 8, 1e-4, 1e4, medium=4)
    lights: list[Light] = [PointLight("lamp", (0.1, 0.2, 3.0), (1.0, 1.0, 1.0))]
    none = np.full((3, 2), SAME_MEDIUM, np.int32)
    found = table(triangles, [mesh("lamp")], lights, sides=none, camera=foggy)
    np.testing.assert_array_equal(found.medium, [4, 4, 4])
    in_air = table(triangles, [mesh("lamp")], lights, sides=none, camera=replace(foggy, medium=None))
    assert (in_air.medium == NO_MEDIUM).all()
    walled = none.copy()
    walled[2] = 2, 3
    beyond = foggy.to_world.copy()
    beyond[2, 3] = 1.0
    moved = replace(foggy, to_world=beyond)
    assert (table(triangles, [mesh("lamp")], lights, sides=walled, camera=moved).medium == 4).all()
    under: list[Light] = [PointLight("lamp", (-0.2, -0.4, -0.5), (1.0, 1.0, 1.0))]
    assert table(triangles, [mesh("lamp")], under, sides=walled, camera=moved).medium[-1] in (2, 3)


def test_errors_name_the_light() -> None:
    triangles = soup(CORNERS, [-1, -1])
    one = OTHERS[0]
    with pytest.raises(SceneError, match=r'one environment.*"sky" and "sky"'):
        table(triangles, [], [one, one])
    with pytest.raises(SceneError, match='environment "thin": 4x1 pixels'):
        table(triangles, [], [Environment("thin", np.ones((1, 4, 3), np.float32))])
    image = Bitmap("image", np.ones((2, 2, 3), np.float32))
    with pytest.raises(SceneError, match='spot light "s": its texture'):
        table(triangles, [], [SpotLight("s", np.eye(4), (1.0, 1.0, 1.0), texture=image)])


def test_a_scene_without_lights_has_an_empty_table() -> None:
    found = table(soup(CORNERS, [-1, -1]), [])
    assert found.corners.shape == (0, 3, 3)
    assert found.power.shape == found.light.shape == found.medium.shape == (0,)
    assert found.environment_pixels.shape == (0, 0, 3)
