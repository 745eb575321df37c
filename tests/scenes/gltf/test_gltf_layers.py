"""Textures of glTF's layers, and what lets light through a sheet: parameters of the materials that stand for them."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from test_gltf_extensions import square, uri

from wdpm.scenes import SceneError, load
from wdpm.scenes.model.bsdfs import Blend, Bsdf, Principled, RoughPane, ThinDielectric, Translucent
from wdpm.scenes.model.textures import Bitmap

TEXELS = np.array([[[255, 102, 0, 51], [0, 255, 255, 204]]], np.uint8)
TEXTURE = {"index": 0}


def layers(folder: Path, name: str, values: dict[str, Any], mode: str = "RGBA", **pbr: Any) -> tuple[Bsdf, str]:
    buffer = io.BytesIO()
    PIL.Image.fromarray(TEXELS).convert(mode).save(buffer, "PNG")
    name = f"KHR_materials_{name}"
    material = {"pbrMetallicRoughness": pbr, "extensions": {name: values}}
    pictures = {"textures": [{"source": 0}], "images": [{"uri": uri(buffer.getvalue())}]}
    scene = load(square(folder, extensionsRequired=[name], materials=[material], **pictures))
    return scene.materials[scene.meshes[0].material].bsdf, " ".join(scene.warnings)


def shown(texture: object) -> list[float]:
    """The first channel of both texels."""
    assert isinstance(texture, Bitmap)
    return texture.pixels[0, :, 0].tolist()


def test_gloss_of_a_coat_follows_its_roughness(tmp_path: Path) -> None:
    values = {"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.5, "clearcoatRoughnessTexture": TEXTURE}
    bsdf, said = layers(tmp_path, "clearcoat", values)
    assert isinstance(bsdf, Principled)
    # alpha is the square of the roughness, 0.2 and 0.5; Disney's is 0.1 at gloss 0 and 0.001 at 1
    assert shown(bsdf.clearcoat_gloss) == pytest.approx([(0.1 - 0.04) / 0.099, 0.0])
    assert "clearcoatRoughnessTexture" not in said


def test_sheen_is_the_mean_of_its_colours(tmp_path: Path) -> None:
    bsdf, _ = layers(tmp_path, "sheen", {"sheenColorFactor": [0.9, 0.0, 0.3], "sheenColorTexture": TEXTURE})
    assert isinstance(bsdf, Principled)
    assert shown(bsdf.sheen) == pytest.approx([0.3, 0.1])


def test_a_texture_of_strength_blends_with_what_hardly_reflects(tmp_path: Path) -> None:
    bsdf, _ = layers(tmp_path, "specular", {"specularTexture": TEXTURE}, metallicFactor=0.0)
    assert isinstance(bsdf, Blend)
    assert isinstance(bsdf.first, Principled)
    assert isinstance(bsdf.second, Principled)
    assert (bsdf.first.eta, bsdf.second.eta) == (1.001, 1.5)
    assert shown(bsdf.weight) == pytest.approx([0.2, 0.8])


def test_colours_of_faint_reflections_are_grey(tmp_path: Path) -> None:
    values = {"specularColorFactor": [0.9, 0.3, 0.3], "specularFactor": 0.5}
    bsdf, said = layers(tmp_path, "specular", values, metallicFactor=0.0)
    assert isinstance(bsdf, Blend)
    assert isinstance(bsdf.second, Principled)
    assert bsdf.weight == 0.5
    assert ((bsdf.second.eta - 1) / (bsdf.second.eta + 1)) ** 2 == pytest.approx(0.5 * 0.04)
    assert "the colour of its reflection is taken as grey" in said
    with pytest.raises(SceneError, match="specularColorFactor must not be negative"):
        layers(tmp_path, "specular", {"specularColorFactor": [-1, 0, 0]}, metallicFactor=0.0)


def test_sheets_are_rough_where_the_surface_is(tmp_path: Path) -> None:
    rough, said = layers(tmp_path, "transmission", {"transmissionFactor": 0.5}, roughnessFactor=0.3, metallicFactor=0)
    assert isinstance(rough, Blend)
    assert isinstance(rough.second, RoughPane)
    assert (rough.second.roughness, rough.second.eta, rough.weight) == (0.3, 1.5, 0.5)
    assert "blurred" not in said
    smooth, _ = layers(tmp_path, "transmission", {"transmissionFactor": 0.5}, roughnessFactor=0.0, metallicFactor=0)
    assert isinstance(smooth, Blend)
    assert isinstance(smooth.second, ThinDielectric)


@pytest.mark.parametrize(("mode", "weights"), [("RGBA", [0.1, 0.4]), ("RGB", None)])
def test_light_goes_diffusely_through(mode: str, weights: list[float] | None, tmp_path: Path) -> None:
    values = {
        "diffuseTransmissionFactor": 0.5,
        "diffuseTransmissionTexture": TEXTURE,
        "diffuseTransmissionColorFactor": [0.1, 0.2, 0.3],
    }
    bsdf, _ = layers(tmp_path, "diffuse_transmission", values, mode, metallicFactor=0.0)
    assert isinstance(bsdf, Blend)
    assert isinstance(bsdf.second, Blend)  # of which 4 % reflect as the surface does
    assert bsdf.second.weight == pytest.approx(0.04)
    assert isinstance(bsdf.second.first, Translucent)
    assert bsdf.second.first.transmittance == (0.1, 0.2, 0.3)
    if weights is None:
        assert bsdf.weight == 0.5
    else:
        assert shown(bsdf.weight) == pytest.approx(weights)
