"""Pictures of glTF files against Mitsuba's of the same square in the materials that they stand for.

A square that one light shines on, from before or from behind, seen at a slant by parallel rays. A light of one
direction and paths of two edges leave no noise, so pixels agree as far as float32 does. Mitsuba has no diffuse part and
no panes as glTF's, so here the squares have Disney's; what glTF's are, test_layered.py and test_gltf_through.py have.
"""

from __future__ import annotations

import base64
import io
import json
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from gltf_squares import look_from
from numpy.typing import NDArray

from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import load
from wdpm.scenes.model.bsdfs import Bsdf, Principled, RoughPane
from wdpm.scenes.model.scene import Scene

pytestmark = pytest.mark.slow

SIDE = 16
EYE = np.array([0.6, -0.8, 1.0])
BEFORE, BEHIND = np.array([-0.5, 0.4, 1.0]), np.array([0.3, 0.5, -1.0])
STRENGTH = (1.0, 0.5, 0.25)
COLOR = (0.8, 0.5, 0.2)
# The lower half of the unit square shows the second row.
TEXELS = np.array([[[255, 128, 64, 255], [0, 255, 128, 128]], [[64, 32, 255, 64], [200, 100, 0, 192]]], np.uint8)


def png(mode: str) -> bytes:
    buffer = io.BytesIO()
    PIL.Image.fromarray(TEXELS).convert(mode).save(buffer, "PNG")
    return buffer.getvalue()


def gltf(folder: Path, material: dict[str, Any], lamp: NDArray[np.float64]) -> Path:
    """The square from -1 to 1, with Mitsuba's texture coordinates."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "<f4")
    uvs, faces = ((corners[:, :2] + 1) / 2).astype("<f4"), np.array([[0, 1, 2], [0, 2, 3]], "<u4")
    parts = [corners.tobytes(), uvs.tobytes(), faces.tobytes(), png("RGBA")]
    offsets = np.cumsum([0, *map(len, parts)]).tolist()
    used = sorted({"KHR_lights_punctual", *material.get("extensions", {})})
    light = {"type": "directional", "intensity": 3.0, "color": STRENGTH}
    view = {"matrix": look_from(EYE).T.reshape(-1).tolist(), "camera": 0}
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": used,
        "nodes": [
            {"mesh": 0},
            view,
            {"matrix": look_from(lamp).T.reshape(-1).tolist(), "extensions": {"KHR_lights_punctual": {"light": 0}}},
        ],
        "cameras": [{"type": "orthographic", "orthographic": {"xmag": 0.9, "ymag": 0.9, "znear": 0.01, "zfar": 100}}],
        "extensions": {"KHR_lights_punctual": {"lights": [light]}},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [material],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"magFilter": 9728}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": offset, "byteLength": len(part)}
            for offset, part in zip(offsets, parts, strict=False)
        ],
        "buffers": [{"byteLength": offsets[-1], "uri": "data:;base64," + base64.b64encode(b"".join(parts)).decode()}],
    }
    file = folder / "square.gltf"
    file.write_text(json.dumps(document))
    return file


def theirs(mi: Any, bsdf: dict[str, Any], lamp: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mitsuba's picture. Its cameras look along +z and have +x to the left."""
    to_world = look_from(EYE) @ np.diag([-0.9, 0.9, -1.0, 1.0])
    square = {"type": "rectangle", "bsdf": bsdf}
    irradiance = {"type": "rgb", "value": [3.0 * channel for channel in STRENGTH]}
    light = {"type": "directional", "direction": (-lamp).tolist(), "irradiance": irradiance}
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}}
    sensor = {"type": "orthographic", "to_world": mi.ScalarTransform4f(to_world), "film": film, "near_clip": 1e-3}
    scene = mi.load_dict({"type": "scene", "square": square, "sensor": sensor, "light": light})
    return np.array(mi.render(scene, spp=16, integrator=mi.load_dict({"type": "path", "max_depth": 2})), np.float64)


def with_disneys(bsdf: Bsdf) -> Bsdf:
    """The same with Disney's diffuse part, and Disney's blur of panes, in place of glTF's."""
    if isinstance(bsdf, RoughPane):
        return replace(bsdf, blur=0.0)
    if isinstance(bsdf, Principled):
        assert bsdf.layered
        return replace(bsdf, layered=False)
    inner = {part.name: getattr(bsdf, part.name) for part in fields(bsdf)}
    return replace(bsdf, **{name: with_disneys(each) for name, each in inner.items() if isinstance(each, Bsdf)})


def as_mitsuba_can(scene: Scene) -> Scene:
    return replace(scene, materials=tuple(replace(each, bsdf=with_disneys(each.bsdf)) for each in scene.materials))


def linear(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


RGBA = TEXELS / 255.0
TEXTURE = {"index": 0}
MATT = {"metallicFactor": 0.0, "baseColorFactor": [*COLOR, 1.0]}


def principled(**values: Any) -> dict[str, Any]:
    return {"type": "principled", "base_color": {"type": "rgb", "value": list(COLOR)}, "eta": 1.5, **values}


@dataclass(frozen=True, eq=False)
class Picture:
    """A texture of Mitsuba's, of linear values, shape [2, 2, 3] or [2, 2], after a map of texture coordinates."""

    values: NDArray[np.float64]
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


def of_mitsuba(mi: Any, value: Any) -> Any:
    """What its load_dict takes."""
    if isinstance(value, dict):
        return {key: of_mitsuba(mi, each) for key, each in value.items()}
    if not isinstance(value, Picture):
        return value
    pixels = np.ascontiguousarray(value.values if value.values.ndim == 3 else value.values[:, :, None], np.float32)
    to_uv = mi.ScalarTransform4f().translate([*value.offset, 0.0]).scale([*value.scale, 1.0])
    picture = {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True, "filter_type": "nearest"}
    return picture | {"to_uv": to_uv}


COLORS = linear(RGBA[:, :, :3])
TEXTURED = {"metallicFactor": 1.0, "baseColorTexture": TEXTURE, "metallicRoughnessTexture": TEXTURE}
MOVED = {"index": 0, "extensions": {"KHR_texture_transform": {"offset": [0.3, 0.1], "scale": [1.5, 0.5]}}}
SHEET = {"type": "principledthin", "base_color": {"type": "rgb", "value": list(COLOR)}, "spec_trans": 1.0}


def blend(weight: Any, first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    return {"type": "blendbsdf", "weight": weight, "first": first, "second": second}


def extended(
    name: str, values: dict[str, Any], bsdf: dict[str, Any], **pbr: Any
) -> tuple[dict[str, Any], dict[str, Any]]:
    return {"pbrMetallicRoughness": MATT | pbr, "extensions": {f"KHR_materials_{name}": values}}, bsdf


CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "matt": ({"pbrMetallicRoughness": MATT}, principled(roughness=1.0)),
    "metallic and roughness textures": (
        {"pbrMetallicRoughness": TEXTURED},
        principled(metallic=Picture(RGBA[:, :, 2]), roughness=Picture(RGBA[:, :, 1])) | {"base_color": Picture(COLORS)},
    ),
    "a texture that is moved": (
        {"pbrMetallicRoughness": {"metallicFactor": 0.0, "baseColorTexture": MOVED}},
        principled(roughness=1.0) | {"base_color": Picture(COLORS, (1.5, 0.5), (0.3, 0.1))},
    ),
    "alpha mask": (
        {
            "pbrMetallicRoughness": {"metallicFactor": 0.0, "baseColorTexture": TEXTURE},
            "alphaMode": "MASK",
            "alphaCutoff": 0.4,
        },
        {
            "type": "mask",
            "opacity": Picture((RGBA[:, :, 3] >= 0.4) * 1.0),
            "bsdf": principled(roughness=1.0) | {"base_color": Picture(COLORS)},
        },
    ),
    "ior": extended("ior", {"ior": 1.8}, principled(roughness=1.0, eta=1.8)),
    "anisotropy": extended(
        "anisotropy",
        {"anisotropyStrength": 0.5},
        principled(metallic=1.0, roughness=(0.6175 * 0.49) ** 0.25, anisotropic=(1.0 - 0.49 / 0.6175) / 0.9),
        roughnessFactor=0.7,
        metallicFactor=1.0,
    ),
    "clearcoat textures": extended(
        "clearcoat",
        {
            "clearcoatFactor": 0.8,
            "clearcoatTexture": TEXTURE,
            "clearcoatRoughnessFactor": 0.5,
            "clearcoatRoughnessTexture": TEXTURE,
        },
        principled(
            roughness=1.0,
            clearcoat=Picture(0.8 * RGBA[:, :, 0]),
            clearcoat_gloss=Picture(np.clip((0.1 - (0.5 * RGBA[:, :, 1]) ** 2) / 0.099, 0.0, 1.0)),
        ),
    ),
    "sheen texture": extended(
        "sheen",
        {"sheenColorFactor": [1.0, 0.5, 0.2], "sheenColorTexture": TEXTURE},
        principled(roughness=1.0, sheen=Picture((COLORS * [1.0, 0.5, 0.2]).mean(axis=2))),
    ),
    "specular texture": extended(
        "specular",
        {"specularTexture": TEXTURE},
        blend(Picture(RGBA[:, :, 3]), principled(roughness=1.0, eta=1.001), principled(roughness=1.0)),
    ),
    "specular colour texture": extended(
        "specular",
        {"specularColorTexture": TEXTURE},
        blend(Picture(COLORS.mean(axis=2)), principled(roughness=1.0, eta=1.001), principled(roughness=1.0)),
    ),
    "rough transmission": extended(
        "transmission",
        {"transmissionFactor": 0.7},
        blend(0.7, principled(roughness=0.6), SHEET | {"roughness": 0.6}),
        roughnessFactor=0.6,
    ),
    "diffuse transmission": extended(
        "diffuse_transmission",
        {
            "diffuseTransmissionFactor": 0.9,
            "diffuseTransmissionTexture": TEXTURE,
            "diffuseTransmissionColorFactor": [0.5, 0.6, 1.0],
            "diffuseTransmissionColorTexture": TEXTURE,
        },
        blend(
            Picture(0.9 * RGBA[:, :, 3]),
            principled(roughness=1.0),
            blend(
                0.04,
                {"type": "principledthin", "base_color": Picture(COLORS * [0.5, 0.6, 1.0]), "diff_trans": 2.0},
                {"type": "principled", "base_color": 1.0, "metallic": 1.0, "roughness": 1.0},
            ),
        ),
    ),
}


@pytest.mark.parametrize("lamp", [BEFORE, BEHIND], ids=["lit", "lit from behind"])
@pytest.mark.parametrize("name", CASES)
def test_materials_look_as_mitsubas_that_they_stand_for(name: str, lamp: NDArray[np.float64], tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    material, bsdf = CASES[name]
    scene = as_mitsuba_can(load(gltf(tmp_path, material, lamp), size=(SIDE, SIDE)))
    chosen = "transmission" in name  # which of two materials a path meets is chosen at random
    spp = 512 if chosen else 16
    settings = RenderSettings(integrator=Integrator.PATH, spp=spp, max_depth=2, all_effects=True)
    ours = render_in_process(scene, settings, workers=1).pixels.astype(np.float64)
    expected = theirs(mi, of_mitsuba(mi, bsdf), lamp)
    if lamp is BEHIND and not chosen:
        np.testing.assert_array_equal(ours, 0.0)
        return
    assert expected.mean() > 1e-3
    np.testing.assert_allclose(ours.mean(axis=(0, 1)), expected.mean(axis=(0, 1)), rtol=0.01)
    if not chosen:
        close = np.isclose(ours, expected, rtol=0.01, atol=1e-3).all(axis=2)
        assert close.mean() > 0.6  # pixels on borders hold more than one texel
