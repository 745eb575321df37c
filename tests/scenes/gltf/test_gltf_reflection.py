"""What glTF's materials reflect, seen in pictures, against the specification's formulas, written down anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_squares import Square, Wide, upwards

EYE, LAMP = upwards(30.0), upwards(20.0, 180.0)
METAL = {"baseColorFactor": [0.9, 0.6, 0.3, 1.0], "roughnessFactor": 0.5}

NOTHING: dict[str, dict[str, Any]] = {
    "specularFactor": {"KHR_materials_specular": {"specularFactor": 0.0}},
    "specularColorFactor": {"KHR_materials_specular": {"specularColorFactor": [0.0, 0.0, 0.0]}},
    "ior": {"KHR_materials_ior": {"ior": 1.0}},
}
"""Ways to say that a dielectric reflects nothing."""


@pytest.mark.parametrize("way", NOTHING)
def test_metals_reflect_whatever_is_said_of_dielectrics(way: str, tmp_path: Path) -> None:
    """KHR_materials_specular: the metal BRDF is not affected by the parameter."""
    plain = Square({"pbrMetallicRoughness": METAL}).scattered(tmp_path, EYE, LAMP)
    assert plain.min() > 0.1
    seen = Square({"pbrMetallicRoughness": METAL, "extensions": NOTHING[way]}).scattered(tmp_path, EYE, LAMP)
    np.testing.assert_allclose(seen, plain, rtol=1e-5)


@pytest.mark.parametrize("way", NOTHING)
def test_so_does_what_is_metal_by_half(way: str, tmp_path: Path) -> None:
    material = {"pbrMetallicRoughness": METAL | {"metallicFactor": 0.5}, "extensions": NOTHING[way]}
    metal = Square({"pbrMetallicRoughness": METAL}).scattered(tmp_path, EYE, LAMP)
    matt = np.array(METAL["baseColorFactor"][:3]) / np.pi * LAMP[2]  # type: ignore[index]
    np.testing.assert_allclose(Square(material).scattered(tmp_path, EYE, LAMP), 0.5 * (metal + matt), rtol=1e-3)


def schlick(head_on: Wide, cosine: float) -> Wide:
    return head_on + (1.0 - head_on) * (1.0 - cosine) ** 5


def fresnel(eta: float, cosine: float) -> float:
    """What Schlick's is an approximation of."""
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / eta**2)
    across = (cosine - eta * inside) / (cosine + eta * inside)
    along = (eta * cosine - inside) / (eta * cosine + inside)
    return 0.5 * float(across**2 + along**2)


def half_way(a: Wide, b: Wide) -> Wide:
    half: Wide = (a + b) / np.linalg.norm(a + b)
    return half


def glossy(roughness: float, a: Wide, b: Wide) -> float:
    """Appendix B.2.3: V D times the cosine of b."""
    alpha2 = roughness**4
    h = half_way(a, b)[2]
    density = alpha2 / (np.pi * (h * h * (alpha2 - 1.0) + 1.0) ** 2)

    def visible(c: float) -> float:
        return 1.0 / float(c + np.sqrt(alpha2 + (1.0 - alpha2) * c * c))

    return float(density * visible(a[2]) * visible(b[2]) * b[2])


def dielectric(base: Any, mirrored: Any, roughness: float, a: Wide, b: Wide) -> Wide:
    """A diffuse surface beneath a gloss that reflects so much at facets half way; times the cosine."""
    shown = np.broadcast_to(mirrored, 3)
    diffuse: Wide = (1.0 - shown.max()) * np.asarray(base) / np.pi * b[2]
    return diffuse + shown * glossy(roughness, a, b)


BASE = (0.2, 0.4, 0.6)
ANGLES = {"steep": (EYE, LAMP), "grazing": (upwards(75.0), upwards(70.0, 160.0))}


def matt(roughness: float = 0.5, metallic: float = 0.0) -> dict[str, Any]:
    return {"baseColorFactor": [*BASE, 1.0], "roughnessFactor": roughness, "metallicFactor": metallic}


def specular(ior: float = 1.5, **values: Any) -> dict[str, Any]:
    extensions = {"KHR_materials_specular": values, "KHR_materials_ior": {"ior": ior}}
    return {"pbrMetallicRoughness": matt(), "extensions": extensions}


@pytest.mark.parametrize("angles", ANGLES)
@pytest.mark.parametrize("strength", [0.0, 0.4, 1.0])
def test_a_strength_scales_reflection_at_all_angles(strength: float, angles: str, tmp_path: Path) -> None:
    """KHR_materials_specular: the layer is weighted with weight * fresnel, the base with 1 less that."""
    a, b = ANGLES[angles]
    seen = Square(specular(specularFactor=strength)).scattered(tmp_path, a, b, spp=256)
    expected = dielectric(BASE, strength * fresnel(1.5, half_way(a, b) @ a), 0.5, a, b)
    np.testing.assert_allclose(seen, expected, rtol=0.01)


@pytest.mark.parametrize("angles", ANGLES)
@pytest.mark.parametrize("color", [(1.0, 0.77, 0.34), (0.6, 0.2, 0.05), (0.9, 0.9, 0.9), (0.5, 0.05, 0.3)])
def test_a_colour_head_on_turns_white_towards_grazing_angles(
    color: tuple[float, float, float], angles: str, tmp_path: Path
) -> None:
    """With an ior of 0, which stands for an infinite one, the colour is the reflection head-on."""
    a, b = ANGLES[angles]
    seen = Square(specular(0.0, specularColorFactor=color)).scattered(tmp_path, a, b, spp=256)
    expected = dielectric(BASE, schlick(np.array(color), half_way(a, b) @ a), 0.5, a, b)
    np.testing.assert_allclose(seen, expected, rtol=0.06)


def test_an_ior_of_0_reflects_everything(tmp_path: Path) -> None:
    white = Square({"pbrMetallicRoughness": {"roughnessFactor": 0.5}}).scattered(tmp_path, EYE, LAMP)
    np.testing.assert_allclose(Square(specular(0.0)).scattered(tmp_path, EYE, LAMP), white, rtol=1e-6)


def test_a_great_index_takes_its_colour(tmp_path: Path) -> None:
    """As tools write that turn specular-glossiness into this."""
    seen = Square(specular(1000.0, specularColorFactor=[1.0, 0.77, 0.34])).scattered(tmp_path, EYE, LAMP, spp=256)
    mirrored = schlick(np.array([1.0, 0.77, 0.34]), half_way(EYE, LAMP) @ EYE)
    np.testing.assert_allclose(seen, dielectric(BASE, mirrored, 0.5, EYE, LAMP), rtol=0.02)


TEXELS = np.array([[[255, 220, 120, 255], [60, 60, 60, 128]]], np.uint8)
"""A metal and a dielectric."""


def linear(values: Any) -> Wide:
    share = np.asarray(values) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def seen_of_halves(square: Square, folder: Path, spp: int = 256) -> tuple[Wide, Wide]:
    """Of the left and of the right half of the square."""
    pixels = square.lit(5.0 * LAMP).seen(folder, 5.0 * EYE, half=0.6, side=8, spp=spp)
    return pixels[:, :3].mean(axis=(0, 1)), pixels[:, 5:].mean(axis=(0, 1))


def test_a_texture_of_reflections_tells_metals_from_dielectrics(tmp_path: Path) -> None:
    material = specular(0.0, specularColorTexture={"index": 0}, specularTexture={"index": 0})
    halves = seen_of_halves(Square(material, TEXELS), tmp_path)
    for texel, strength, seen in zip(linear(TEXELS[0, :, :3]), (1.0, 128 / 255), halves, strict=True):
        mirrored = strength * schlick(texel, half_way(EYE, LAMP) @ EYE)
        np.testing.assert_allclose(seen, dielectric(BASE, mirrored, 0.5, EYE, LAMP), rtol=0.03)


def test_specular_glossiness_is_its_own_successor(tmp_path: Path) -> None:
    """KHR_materials_specular, Conversions: a lossless mapping. Its texture has sRGB colours and a linear glossiness."""
    values = {"diffuseFactor": [*BASE, 1.0], "specularGlossinessTexture": {"index": 0}, "glossinessFactor": 0.5}
    material = {"extensions": {"KHR_materials_pbrSpecularGlossiness": values}}
    halves = seen_of_halves(Square(material, TEXELS), tmp_path)
    for texel, glossiness, seen in zip(linear(TEXELS[0, :, :3]), (0.5, 64 / 255), halves, strict=True):
        mirrored = schlick(texel, half_way(EYE, LAMP) @ EYE)
        np.testing.assert_allclose(seen, dielectric(BASE, mirrored, 1.0 - glossiness, EYE, LAMP), rtol=0.03)
