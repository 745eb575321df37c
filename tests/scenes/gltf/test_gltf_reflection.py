"""What glTF's materials reflect, seen in pictures, against the specification's formulas, written down anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_squares import Square, upwards

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
