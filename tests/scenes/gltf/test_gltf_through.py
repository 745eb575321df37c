"""What glTF's materials let through, seen in pictures, against the extensions' formulas, written down anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_squares import CORNERS, FACES, Square, Wide, upwards

EYE, LAMP = upwards(8.0), upwards(10.0, 180.0)
BASE = np.array([0.2, 0.4, 0.6])
HEAD_ON = 0.04
"""Reflection of an index of 1.5, which at 9 degrees is the same to four places."""

TRANSMISSION, DIFFUSE = "KHR_materials_transmission", "KHR_materials_diffuse_transmission"


def material(extension: str, metallic: float = 0.0, roughness: float = 0.5, **values: Any) -> dict[str, Any]:
    pbr = {"baseColorFactor": [*BASE, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness}
    return {"pbrMetallicRoughness": pbr, "extensions": {extension: values}}


def gloss(roughness: float) -> float:
    """V D cos for EYE and LAMP, whose half vector is one degree off the normal (appendix B.2.3)."""
    alpha2 = roughness**4
    cosine = np.cos(np.radians(1.0))
    density = alpha2 / (np.pi * (cosine**2 * (alpha2 - 1.0) + 1.0) ** 2)
    first, second = (1.0 / (w[2] + np.sqrt(alpha2 + (1.0 - alpha2) * w[2] ** 2)) for w in (EYE, LAMP))
    return float(density * first * second * LAMP[2])


@pytest.mark.parametrize("share", [0.25, 0.9, 1.0])
def test_what_lets_light_diffusely_through_reflects_as_before(share: float, tmp_path: Path) -> None:
    """KHR_materials_diffuse_transmission: it takes from what is not specularly reflected."""
    values = {"diffuseTransmissionFactor": share, "diffuseTransmissionColorFactor": [0.9, 0.5, 0.1]}
    square = Square(material(DIFFUSE, **values))
    seen = square.scattered(tmp_path, EYE, LAMP, spp=1024)
    expected = HEAD_ON * gloss(0.5) + (1.0 - HEAD_ON) * (1.0 - share) * BASE / np.pi * LAMP[2]
    np.testing.assert_allclose(seen, expected, rtol=0.03)
    beneath = square.scattered(tmp_path, EYE, -LAMP, spp=256)
    through = (1.0 - HEAD_ON) * share * np.array([0.9, 0.5, 0.1]) / np.pi * LAMP[2]
    np.testing.assert_allclose(beneath, through, rtol=0.02)


@pytest.mark.parametrize("values", [{"transmissionFactor": 0.8}, {"diffuseTransmissionFactor": 0.8}])
@pytest.mark.parametrize("metallic", [0.5, 1.0])
def test_metals_let_nothing_through(values: dict[str, float], metallic: float, tmp_path: Path) -> None:
    """KHR_materials_transmission: of a metal the factor does not matter."""
    name = TRANSMISSION if "transmissionFactor" in values else DIFFUSE
    seen = Square(material(name, metallic, **values)).scattered(tmp_path, EYE, LAMP, spp=1024)
    diffuse = (1.0 - HEAD_ON) * 0.2 * BASE / np.pi * LAMP[2]
    expected = metallic * BASE * gloss(0.5) + (1.0 - metallic) * (HEAD_ON * gloss(0.5) + diffuse)
    np.testing.assert_allclose(seen, expected, rtol=0.03)


def before_a_lamp(square: Square) -> Square:
    """With a wall behind it that shines with radiance 1."""
    document = square.document
    wall = {"attributes": {"POSITION": square.add(CORNERS * 5.0)}, "indices": square.add(FACES.reshape(-1))}
    document["meshes"].append({"primitives": [wall | {"material": 1}]})
    document["materials"].append({"emissiveFactor": [1.0, 1.0, 1.0]})
    document["nodes"].append({"mesh": 1, "translation": [0.0, 0.0, -2.0]})
    return square


def seen_through(square: Square, folder: Path) -> Wide:
    pixels = before_a_lamp(square).seen(folder, 5.0 * EYE, spp=256, max_depth=4)
    mean: Wide = pixels.mean(axis=(0, 1))
    return mean


@pytest.mark.parametrize("share", [0.6, 1.0])
@pytest.mark.parametrize("roughness", [0.0, 0.05])
def test_a_thin_wall_is_tinted_and_reflects_as_one_surface(roughness: float, share: float, tmp_path: Path) -> None:
    """Beneath the gloss a mixture of a diffuse surface and one that lets light through, times the base colour."""
    square = Square(material(TRANSMISSION, roughness=roughness, transmissionFactor=share))
    np.testing.assert_allclose(seen_through(square, tmp_path), (1.0 - HEAD_ON) * share * BASE, rtol=0.01)


@pytest.mark.parametrize("lamp", [upwards(10.0, 180.0), upwards(35.0, 120.0)])
def test_a_thin_wall_blurs_by_the_lobe_of_its_reflection(lamp: Wide, tmp_path: Path) -> None:
    """KHR_materials_transmission: that of the reflection, sampled along the line of sight; times the base colour."""
    square = Square(material(TRANSMISSION, roughness=0.5, transmissionFactor=1.0))
    seen = square.scattered(tmp_path, EYE, lamp * [1.0, 1.0, -1.0], spp=64)
    half = (EYE + lamp) / np.linalg.norm(EYE + lamp)
    alpha2 = 0.5**4
    density = alpha2 / (np.pi * (half[2] ** 2 * (alpha2 - 1.0) + 1.0) ** 2)
    first, second = (1.0 / (w[2] + np.sqrt(alpha2 + (1.0 - alpha2) * w[2] ** 2)) for w in (EYE, lamp))
    np.testing.assert_allclose(seen, (1.0 - HEAD_ON) * BASE * density * first * second * lamp[2], rtol=0.01)


def test_specular_and_ior_of_a_thin_wall(tmp_path: Path) -> None:
    walls = {"KHR_materials_ior": {"ior": 2.0}, "KHR_materials_specular": {"specularFactor": 0.5}}
    thin = material(TRANSMISSION, roughness=0.0, transmissionFactor=1.0)
    thin["extensions"] |= walls
    expected = (1.0 - 0.5 / 9.0) * BASE
    np.testing.assert_allclose(seen_through(Square(thin), tmp_path), expected, rtol=0.01)


@pytest.mark.parametrize("mode", ["MASK", "BLEND"])
def test_coverage(mode: str, tmp_path: Path) -> None:
    """The specification, 3.9.4: BLEND is as opaque as its alpha says, MASK hides all from its cutoff on."""
    texels = [[[255, 255, 255, 102], [255, 255, 255, 204]]]
    pbr = {"baseColorFactor": [0.0, 0.0, 0.0, 0.75], "baseColorTexture": {"index": 0}}
    square = Square({"pbrMetallicRoughness": pbr, "alphaMode": mode, "alphaCutoff": 0.6}, texels)
    pixels = before_a_lamp(square).seen(tmp_path, np.array([0.0, 0.0, 5.0]), half=0.6, side=8, spp=256, max_depth=4)
    shown = {"MASK": (1.0, 0.0), "BLEND": (0.7, 0.4)}[mode]
    found = pixels[:, :3].mean(), pixels[:, 5:].mean()
    np.testing.assert_allclose(found, shown, atol=0.01)


@pytest.mark.parametrize("cutoff", [0.2, 0.5, 0.8])
def test_a_mask_cuts_what_lies_between_texels(cutoff: float, tmp_path: Path) -> None:
    """Its edge is where the interpolated opacity is the cutoff, and sharp."""
    pbr = {"baseColorFactor": [0.0, 0.0, 0.0, 1.0], "baseColorTexture": {"index": 0}}
    square = Square(
        {"pbrMetallicRoughness": pbr, "alphaMode": "MASK", "alphaCutoff": cutoff}, [[[9, 9, 9, 0], [9, 9, 9, 255]]]
    )
    square.document["samplers"] = [{}]
    pixels = before_a_lamp(square).seen(tmp_path, np.array([0.0, 0.0, 5.0]), half=0.5, side=20, spp=64, max_depth=4)
    edge = 10.0 + 20.0 * (cutoff - 0.5)  # from one texel's middle to the other's, a pixel a twentieth
    expected = np.clip(edge - np.arange(20), 0.0, 1.0)
    np.testing.assert_allclose(pixels[:, :, 0], np.tile(expected, (20, 1)), atol=0.05)


def test_a_filled_solid_absorbs_and_is_tinted_once(tmp_path: Path) -> None:
    """KHR_materials_volume: c to the way over the distance; the base colour here by its root at either surface."""
    square = Square(material(TRANSMISSION, roughness=0.0, transmissionFactor=1.0))
    square.document["materials"][0]["extensions"]["KHR_materials_volume"] = {
        "thicknessFactor": 1.0,
        "attenuationColor": [0.5, 0.8, 0.9],
        "attenuationDistance": 2.0,
    }
    slab = np.array([[x, y, z] for z in (0, -1) for x, y in ((-9, -9), (9, -9), (9, 9), (-9, 9))], "<f4")
    front = np.array([[0, 1, 2], [0, 2, 3]])
    sides = [[[b, a, a + 4], [b, a + 4, b + 4]] for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))]
    faces = np.concatenate([front, front[:, ::-1] + 4, *np.array(sides)]).astype("<u4")
    square.primitive["attributes"] = {"POSITION": square.add(slab)}
    square.primitive["indices"] = square.add(faces.reshape(-1))
    seen = seen_through(square, tmp_path)
    inside = 1.0 / np.cos(np.arcsin(np.sin(np.radians(8.0)) / 1.5))
    passed = np.array([0.5, 0.8, 0.9]) ** (inside / 2.0)
    np.testing.assert_allclose(seen, (1.0 - HEAD_ON) ** 2 * BASE * passed, rtol=0.02)
