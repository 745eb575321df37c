"""Pictures of small glTF files against what the specification says of them, worked out anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_squares import CORNERS, FACES, UVS, Square, Wide, upwards

from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import load

EYE, LAMP = upwards(5.0), upwards(5.0, 180.0)
TEXTURE = {"index": 0}
DULL = {"KHR_materials_specular": {"specularFactor": 0.0}}
"""What makes a dielectric all diffuse."""


def matt(base: Any = (1.0, 1.0, 1.0), **more: Any) -> dict[str, Any]:
    pbr = {"baseColorFactor": [*base, 1.0], "metallicFactor": 0.0}
    return {"pbrMetallicRoughness": pbr, "extensions": DULL, **more}


def albedo(square: Square, folder: Path) -> Wide:
    """Of what is all diffuse."""
    return square.scattered(folder, EYE, LAMP) * np.pi / LAMP[2]


def linear(values: Any) -> Wide:
    share = np.asarray(values) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


QUARTERS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)
RED, GREEN, BLUE, WHITE = (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)
"""The quarters of that texture, from its upper left on."""


def quarters(square: Square, folder: Path) -> list[tuple[int, ...]]:
    """Which colours the quarters of the square have, from the upper left on."""
    pixels = square.lit(np.array([0.0, 0.0, 5.0])).seen(folder, np.array([0.0, 0.0, 5.0]), half=1.0, side=4)
    shown = pixels[[0, 0, 3, 3], [0, 3, 0, 3]] * np.pi
    return [tuple(int(channel > 0.5) for channel in colour) for colour in shown]


def test_the_first_texel_is_at_the_upper_left(tmp_path: Path) -> None:
    material = matt()
    material["pbrMetallicRoughness"]["baseColorTexture"] = TEXTURE
    assert quarters(Square(material, QUARTERS), tmp_path) == [RED, GREEN, BLUE, WHITE]


TRANSFORMS: dict[str, tuple[dict[str, Any], list[tuple[int, ...]]]] = {
    "offset": ({"offset": [0.5, 0.0]}, [GREEN, RED, WHITE, BLUE]),
    "scale": ({"scale": [-1.0, 1.0]}, [GREEN, RED, WHITE, BLUE]),
    # the coordinates counter-clockwise, the picture clockwise: its lower left comes to the upper left
    "rotation": ({"rotation": np.pi / 2.0}, [BLUE, RED, WHITE, GREEN]),
    # scaled first, turned then, moved last: as the extension's own example of a lower left quadrant that is turned
    "order": ({"offset": [0.0, 1.0], "rotation": np.pi / 2.0, "scale": [0.5, 0.5]}, [BLUE] * 4),
    "order of scale": ({"rotation": np.pi / 2.0, "scale": [0.5, 1.0]}, [BLUE, BLUE, WHITE, WHITE]),
}


@pytest.mark.parametrize("name", TRANSFORMS)
def test_texture_transforms(name: str, tmp_path: Path) -> None:
    values, expected = TRANSFORMS[name]
    material = matt()
    moved = TEXTURE | {"extensions": {"KHR_texture_transform": values}}
    material["pbrMetallicRoughness"]["baseColorTexture"] = moved
    assert quarters(Square(material, QUARTERS), tmp_path) == expected


def test_colours_are_products_and_those_of_vertices_linear(tmp_path: Path) -> None:
    material = matt((0.5, 1.0, 0.8))
    material["pbrMetallicRoughness"]["baseColorTexture"] = TEXTURE
    square = Square(material, [[[188, 255, 100]]])
    colours = np.tile(np.array([[128, 64, 255]], np.uint8), (4, 1))
    square.primitive["attributes"]["COLOR_0"] = square.add(np.pad(colours, ((0, 0), (0, 1))), normalized=True)
    expected = np.array([0.5, 1.0, 0.8]) * linear([188, 255, 100]) * np.array([128, 64, 255]) / 255.0
    np.testing.assert_allclose(albedo(square, tmp_path), expected, rtol=2e-3)


def test_occlusion_changes_nothing(tmp_path: Path) -> None:
    square = Square(matt((0.5, 0.5, 0.5), occlusionTexture=TEXTURE), [[[0, 0, 0]]])
    np.testing.assert_allclose(albedo(square, tmp_path), 0.5, rtol=2e-3)


def test_emission_is_a_product_and_its_texture_not_linear(tmp_path: Path) -> None:
    glow = {"emissiveFactor": [1.0, 0.5, 0.25], "emissiveTexture": TEXTURE}
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 3.0}}
    square = Square({**glow, "extensions": strength}, [[[188, 255, 100]]])
    seen = square.seen(tmp_path, 5.0 * EYE).mean(axis=(0, 1))
    np.testing.assert_allclose(seen, 3.0 * np.array([1.0, 0.5, 0.25]) * linear([188, 255, 100]), rtol=1e-4)


def test_what_is_unlit_has_but_its_base_colour(tmp_path: Path) -> None:
    """KHR_materials_unlit: all else is for those who do not know it; here light falls on it none the less."""
    material = matt((0.5, 0.25, 1.0), emissiveFactor=[1.0, 1.0, 1.0], normalTexture=TEXTURE)
    square = Square(material | {"extensions": {"KHR_materials_unlit": {}}}, [[[255, 128, 128]]])
    np.testing.assert_allclose(albedo(square, tmp_path), [0.5, 0.25, 1.0], rtol=2e-3)


COATED = {"metallicFactor": 1.0, "roughnessFactor": 1.0, "baseColorFactor": [0.0, 0.0, 0.0, 1.0]}


@pytest.mark.parametrize(("angle", "share"), [(0.01, 0.75), (45.0, 0.42), (60.0, 0.2)])
def test_how_strong_a_clear_coat_is(angle: float, share: float, tmp_path: Path) -> None:
    """The share of what KHR_materials_clearcoat reflects of light from all around that docs/scenes.md tells of ours."""
    reflected = []
    for values in ({}, {"KHR_materials_clearcoat": {"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.2}}):
        square = Square({"pbrMetallicRoughness": COATED, "extensions": values})
        dome = {"attributes": {"POSITION": square.add(CORNERS * 400.0)}, "indices": square.add(FACES.reshape(-1))}
        square.document["meshes"].append({"primitives": [dome | {"material": 1}]})
        square.document["materials"].append({"emissiveFactor": [1.0, 1.0, 1.0], "doubleSided": True})
        square.document["nodes"].append({"mesh": 1, "translation": [0.0, 0.0, 8.0]})
        seen = square.seen(tmp_path, 5.0 * upwards(angle), half=0.1, spp=4096, max_depth=3)
        reflected.append(seen.mean())
    asked = 0.04 + 0.96 * (1.0 - np.cos(np.radians(angle))) ** 5
    assert (reflected[1] - reflected[0]) / asked == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize("double", [False, True])
def test_sides(double: bool, tmp_path: Path) -> None:
    square = Square(matt((0.5, 0.5, 0.5), doubleSided=double))
    np.testing.assert_allclose(albedo(square, tmp_path), 0.5, rtol=2e-3)
    behind = square.scattered(tmp_path, -EYE, -LAMP) * np.pi / LAMP[2]
    np.testing.assert_allclose(behind, 0.5 if double else 0.0, rtol=2e-3)


@pytest.mark.parametrize("green", [64, 192])
@pytest.mark.parametrize("scale", [0.5, 1.0])
def test_normal_maps_have_red_to_the_right_and_green_upwards(green: int, scale: float, tmp_path: Path) -> None:
    """The specification, 3.9.3: normalize((texel * 2 - 1) * (scale, scale, 1))."""
    texel = np.array([96, green, 230])
    square = Square(matt(normalTexture=TEXTURE | {"scale": scale}), [[texel]])
    bent = (texel / 255.0 * 2.0 - 1.0) * [scale, scale, 1.0]
    bent /= np.linalg.norm(bent)
    for lamp in (upwards(20.0, 90.0), upwards(25.0, 200.0)):
        seen = square.scattered(tmp_path, EYE, lamp) * np.pi
        np.testing.assert_allclose(seen, bent @ lamp, rtol=0.01)


MAPPINGS = {
    "mirrored": (UVS * [-1, 1] + [1, 0], [-1.0, 0.0], [0.0, 1.0]),
    "upside down": (UVS * [1, -1] + [0, 1], [1.0, 0.0], [0.0, -1.0]),
    "turned": (UVS[:, ::-1], [0.0, -1.0], [-1.0, 0.0]),
}
"""Texture coordinates, and where red and green lean to on the square."""


@pytest.mark.parametrize("mapping", MAPPINGS)
def test_normal_maps_follow_the_texture(mapping: str, tmp_path: Path) -> None:
    """Red leans to where u grows, green to where v falls, also where both are no right-handed pair."""
    uvs, red, green = MAPPINGS[mapping]
    texel = np.array([160, 200, 230])
    square = Square(matt(normalTexture=TEXTURE), [[texel]])
    square.attribute("TEXCOORD_0", uvs.astype("<f4"))
    x, y, z = texel / 255.0 * 2.0 - 1.0
    bent = np.array([*(x * np.array(red) + y * np.array(green)), z])
    for lamp in (upwards(20.0, 90.0), upwards(25.0, 200.0)):
        seen = square.scattered(tmp_path, EYE, lamp) * np.pi
        np.testing.assert_allclose(seen, bent / np.linalg.norm(bent) @ lamp, rtol=0.01)


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("normals", [False, True])
@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (1, 1, -1), (-1, -1, -1), (-1, -1, 1)])
def test_the_front_stays_the_front_where_a_node_mirrors(
    scale: tuple[int, int, int], normals: bool, shared: bool, tmp_path: Path
) -> None:
    """The specification, 3.7.4: a negative determinant turns the order of corners around."""
    square = Square(matt())
    if normals:
        square.attribute("NORMAL", np.tile(np.array([[0, 0, 1]], "<f4"), (4, 1)))
    square.document["nodes"][0]["scale"] = list(scale)
    if shared:
        square.document["nodes"].append({"mesh": 0, "translation": [50.0, 0.0, 0.0]})
    front = np.array([1.0, 1.0, scale[2]])
    assert square.scattered(tmp_path, front * EYE, front * LAMP).min() > 0.2
    assert square.scattered(tmp_path, -front * EYE, -front * LAMP).max() == 0.0


@pytest.mark.parametrize(("inner", "outer"), [(0.0, np.pi / 4.0), (0.3, 0.6), (0.5, np.pi / 2.0)])
def test_spots(inner: float, outer: float, tmp_path: Path) -> None:
    """KHR_lights_punctual: candelas within the inner cone, then the square of a line in the cosine."""
    spot = {"type": "spot", "intensity": 8.0, "spot": {"innerConeAngle": inner, "outerConeAngle": outer}}
    square = Square(matt()).lit(np.array([0.0, 0.0, 1.0]), **spot)
    pixels = square.seen(tmp_path, np.array([0.0, 0.0, 5.0]), half=1.0, side=32, spp=64)[:, :, 0]
    middle = (np.arange(256) + 0.5) / 128.0 - 1.0  # eight places a pixel
    off = np.hypot(middle[:, None], middle[None, :])
    cosine = 1.0 / np.sqrt(1.0 + off**2)
    line = np.clip((cosine - np.cos(outer)) / (np.cos(inner) - np.cos(outer)), 0.0, 1.0)
    expected = (8.0 * line**2 * cosine**3 / np.pi).reshape(32, 8, 32, 8).mean(axis=(1, 3))
    np.testing.assert_allclose(pixels, expected, rtol=0.02, atol=0.02)


LENSES = {
    "perspective": {"yfov": 2.0 * np.arctan(0.5), "aspectRatio": 2.0, "znear": 0.1},
    "orthographic": {"xmag": 4.0, "ymag": 2.0, "znear": 0.1, "zfar": 10.0},
}
"""What sees 4 in height at a distance of 4, and twice as much in width."""


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("size", [(40, 20), (20, 20), (16, 32)])
def test_a_camera_sees_its_height(size: tuple[int, int], lens: str, tmp_path: Path) -> None:
    """`yfov` is the vertical field of view, whatever the aspect ratio of the picture is."""
    square = Square({"emissiveFactor": [1.0, 1.0, 1.0]})
    square.document["cameras"] = [{"type": lens, lens: LENSES[lens]}]
    square.document["nodes"].append({"camera": 0, "translation": [0.0, 0.0, 4.0]})
    file = square.written(tmp_path)
    assert (load(file).camera.width, load(file).camera.height) == (1024, 512)
    settings = RenderSettings(integrator=Integrator.PATH, spp=16, all_effects=True)
    lit = render_in_process(load(file, size=size), settings, workers=1).pixels[:, :, 0] > 0.5
    rows, columns = np.flatnonzero(lit.any(axis=1)), np.flatnonzero(lit.any(axis=0))
    height = size[1]  # of which the square has half
    assert (rows[0], rows[-1]) == (height // 4, 3 * height // 4 - 1)
    assert columns[-1] - columns[0] + 1 == min(size[0], height // 2)
