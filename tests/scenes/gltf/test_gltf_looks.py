"""Extensions of glTF's materials that become other parameters here: anisotropy, specular-glossiness, variants."""

from __future__ import annotations

import io
import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from test_gltf_extensions import square, uri

from wdpm.scenes import Bitmap, SceneError, load
from wdpm.scenes.model.bsdfs import Blend, Bsdf, Principled

GLOSSY = "KHR_materials_pbrSpecularGlossiness"


def looks(folder: Path, extension: str, values: dict[str, Any], **pbr: Any) -> tuple[Bsdf, tuple[str, ...]]:
    material = {"pbrMetallicRoughness": pbr, "extensions": {extension: values}}
    scene = load(square(folder, extensionsUsed=[extension], extensionsRequired=[extension], materials=[material]))
    return scene.materials[scene.meshes[0].material].bsdf, scene.warnings


@pytest.mark.parametrize("strength", [0.0, 0.3, 0.5])
def test_both_roughnesses_are_the_extensions(tmp_path: Path, strength: float) -> None:
    """The extension: alpha along is mix(roughness², 1, strength²), alpha across is roughness²."""
    bsdf, _ = looks(tmp_path, "KHR_materials_anisotropy", {"anisotropyStrength": strength}, roughnessFactor=0.7)
    assert isinstance(bsdf, Principled)
    assert isinstance(bsdf.roughness, float)
    assert isinstance(bsdf.anisotropic, float)
    aspect = math.sqrt(1.0 - 0.9 * bsdf.anisotropic)
    assert bsdf.roughness**2 / aspect == pytest.approx(0.49 + 0.51 * strength**2)
    assert bsdf.roughness**2 * aspect == pytest.approx(0.49)


def test_more_anisotropy_than_disneys_is_said(tmp_path: Path) -> None:
    values = {"anisotropyStrength": 1.0, "anisotropyRotation": 1.0, "anisotropyTexture": {"index": 0}}
    bsdf, warnings = looks(tmp_path, "KHR_materials_anisotropy", values, roughnessFactor=0.2)
    assert isinstance(bsdf, Principled)
    assert bsdf.anisotropic == 1.0
    said = " ".join(warnings)
    assert all(word in said for word in ("lowered to Disney's largest", "anisotropyRotation", "anisotropyTexture"))


def test_extensions_beside_materials_that_are_not_read_are_told_of(tmp_path: Path) -> None:
    used = ["EXT_lights_image_based", "KHR_texture_transform", "KHR_materials_iridescence", "KHR_audio_emitter"]
    warnings = load(square(tmp_path, extensionsUsed=used)).warnings
    (said,) = [warning for warning in warnings if "extensions that are not read" in warning]
    assert said.endswith("left out: EXT_lights_image_based, KHR_audio_emitter")


def colored_square(folder: Path, **changes: Any) -> Path:
    """A rectangle with colours of vertices, half opaque."""
    file = square(folder, **changes)
    document = json.loads(file.read_text())
    colours = [1.0, 0.5, 0.0, 0.5] * 4
    blob = struct.pack("<16f", *colours)
    document["accessors"].append({"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC4"})
    document["bufferViews"].append({"buffer": 1, "byteLength": len(blob)})
    document["buffers"].append({"byteLength": len(blob), "uri": uri(blob)})
    document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 2
    file.write_text(json.dumps(document))
    return file


@pytest.mark.parametrize("mode", ["OPAQUE", "MASK", "BLEND"])
def test_opacity_of_vertex_colours_is_told_of_where_it_matters(tmp_path: Path, mode: str) -> None:
    file = colored_square(tmp_path, materials=[{"alphaMode": mode}])
    assert any("the opacity in its COLOR_0" in warning for warning in load(file).warnings) == (mode != "OPAQUE")


def test_a_base_colour_is_factor_times_texture_times_vertex_colour(tmp_path: Path) -> None:
    """The specification, section 3.9.2."""
    texel = io.BytesIO()
    PIL.Image.new("RGB", (1, 1), (255, 0, 255)).save(texel, "PNG")
    pbr = {"baseColorFactor": [0.5, 1.0, 0.25, 1.0], "baseColorTexture": {"index": 0}}
    images = {"images": [{"uri": uri(texel.getvalue())}], "textures": [{"source": 0}]}
    scene = load(colored_square(tmp_path, materials=[{"pbrMetallicRoughness": pbr}], **images))
    bsdf = scene.materials[scene.meshes[0].material].bsdf
    assert isinstance(bsdf, Principled)
    base = bsdf.base_color
    assert isinstance(base, Bitmap)
    assert base.tinted
    np.testing.assert_allclose(base.pixels, [[[0.5, 0.0, 0.25]]])
    assert scene.meshes[0].colors is not None
    np.testing.assert_allclose(scene.meshes[0].colors, [[1.0, 0.5, 0.0]] * 4)


def test_a_grey_gloss_is_a_dielectrics(tmp_path: Path) -> None:
    values = {"diffuseFactor": [0.2, 0.4, 0.6, 1.0], "specularFactor": [0.04, 0.04, 0.04], "glossinessFactor": 0.75}
    bsdf, _ = looks(tmp_path, GLOSSY, values)
    assert isinstance(bsdf, Principled)
    assert (bsdf.base_color, bsdf.roughness) == ((0.2, 0.4, 0.6), 0.25)
    assert bsdf.eta == pytest.approx(1.5)


def test_a_coloured_gloss_is_a_metals_beside_what_it_leaves_to_the_diffuse_colour(tmp_path: Path) -> None:
    values = {"diffuseFactor": [1.0, 0.5, 0.0, 1.0], "specularFactor": [0.2, 0.6, 0.2], "glossinessFactor": 0.5}
    bsdf, _ = looks(tmp_path, GLOSSY, values)
    assert isinstance(bsdf, Blend)
    assert isinstance(bsdf.first, Principled)
    assert isinstance(bsdf.second, Principled)
    assert isinstance(bsdf.weight, float)
    assert (bsdf.first.base_color, bsdf.first.metallic, bsdf.second.metallic) == ((1.0, 0.5, 0.0), 0.0, 1.0)
    grey = ((bsdf.first.eta - 1) / (bsdf.first.eta + 1)) ** 2
    assert (1.0 - bsdf.weight) * (1.0 - grey) == pytest.approx(0.4)  # head-on
    reflected = [(1.0 - bsdf.weight) * grey + bsdf.weight * channel for channel in bsdf.second.base_color]  # type: ignore[union-attr]
    assert reflected == pytest.approx([0.2, 0.6, 0.2])
    assert (bsdf.first.roughness, bsdf.second.roughness) == (0.5, 0.5)


def test_a_gloss_out_of_range(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="specularFactor must lie between 0 and 1"):
        looks(tmp_path, GLOSSY, {"specularFactor": [2.0, 0.0, 0.0]})


def test_variants_are_left_to_the_default(tmp_path: Path) -> None:
    _, warnings = looks(tmp_path, "KHR_materials_variants", {})
    assert sum("variants of materials" in warning for warning in warnings) == 1
