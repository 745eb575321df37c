"""Pictures of glTF files against Mitsuba's of the same square in the materials that they stand for.

A square that one light shines on, from before or from behind, seen at a slant by parallel rays. A light of one
direction and paths of two edges leave no noise, so pixels agree as far as float32 does.
"""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from numpy.typing import NDArray
from test_gltf_extensions import uri

from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import load

pytestmark = pytest.mark.slow

SIDE = 16
EYE = np.array([0.6, -0.8, 1.0])
BEFORE, BEHIND = np.array([-0.5, 0.4, 1.0]), np.array([0.3, 0.5, -1.0])
STRENGTH = (1.0, 0.5, 0.25)
COLOR = (0.8, 0.5, 0.2)
# The lower half of the unit square shows the second row.
TEXELS = np.array([[[255, 128, 64, 255], [0, 255, 128, 128]], [[64, 32, 255, 64], [200, 100, 0, 192]]], np.uint8)


def look_from(place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes and origin of what looks along its -z from a place to the origin, shape [4, 4]."""
    back = place / np.linalg.norm(place)
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = right, np.cross(back, right), back, place
    return matrix


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
        "buffers": [{"byteLength": offsets[-1], "uri": uri(b"".join(parts))}],
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


def texels(mi: Any, values: NDArray[np.floating]) -> dict[str, Any]:
    """A texture of Mitsuba's, of linear values, shape [2, 2, 3] or [2, 2]."""
    pixels = np.ascontiguousarray(values if values.ndim == 3 else values[:, :, None], np.float32)
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True, "filter_type": "nearest"}


def linear(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


RGBA = TEXELS / 255.0
TEXTURE = {"index": 0}
MATT = {"metallicFactor": 0.0, "baseColorFactor": [*COLOR, 1.0]}


def principled(**values: Any) -> dict[str, Any]:
    return {"type": "principled", "base_color": {"type": "rgb", "value": list(COLOR)}, "eta": 1.5, **values}


def gloss(roughness: Any) -> Any:
    return np.clip((0.1 - roughness**2) / 0.099, 0.0, 1.0)


def cases(mi: Any) -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Materials of glTF, and of Mitsuba."""
    colours = linear(RGBA[:, :, :3])
    base = texels(mi, colours)
    sheet = {"type": "principledthin", "base_color": {"type": "rgb", "value": list(COLOR)}, "spec_trans": 1.0}
    textured = {"metallicFactor": 1.0, "baseColorTexture": TEXTURE, "metallicRoughnessTexture": TEXTURE}
    metal = {"metallic": texels(mi, RGBA[:, :, 2]), "roughness": texels(mi, RGBA[:, :, 1])}
    return {
        "matt": ({"pbrMetallicRoughness": MATT}, principled(roughness=1.0)),
        "metallic and roughness textures": (
            {"pbrMetallicRoughness": textured},
            principled(**metal) | {"base_color": base},
        ),
        "ior": extended("KHR_materials_ior", {"ior": 1.8}, principled(roughness=1.0, eta=1.8)),
        "clearcoat textures": extended(
            "KHR_materials_clearcoat",
            {
                "clearcoatFactor": 0.8,
                "clearcoatTexture": TEXTURE,
                "clearcoatRoughnessFactor": 0.5,
                "clearcoatRoughnessTexture": TEXTURE,
            },
            principled(
                roughness=1.0,
                clearcoat=texels(mi, 0.8 * RGBA[:, :, 0]),
                clearcoat_gloss=texels(mi, gloss(0.5 * RGBA[:, :, 1])),
            ),
        ),
        "sheen texture": extended(
            "KHR_materials_sheen",
            {"sheenColorFactor": [1.0, 0.5, 0.2], "sheenColorTexture": TEXTURE},
            principled(roughness=1.0, sheen=texels(mi, (colours * [1.0, 0.5, 0.2]).mean(axis=2))),
        ),
        "specular texture": extended(
            "KHR_materials_specular",
            {"specularTexture": TEXTURE},
            {
                "type": "blendbsdf",
                "weight": texels(mi, RGBA[:, :, 3]),
                "first": principled(roughness=1.0, eta=1.001),
                "second": principled(roughness=1.0),
            },
        ),
        "specular colour texture": extended(
            "KHR_materials_specular",
            {"specularColorTexture": TEXTURE},
            {
                "type": "blendbsdf",
                "weight": texels(mi, colours.mean(axis=2)),
                "first": principled(roughness=1.0, eta=1.001),
                "second": principled(roughness=1.0),
            },
        ),
        "rough transmission": extended(
            "KHR_materials_transmission",
            {"transmissionFactor": 0.7},
            {
                "type": "blendbsdf",
                "weight": 0.7,
                "first": principled(roughness=0.6),
                "second": sheet | {"roughness": 0.6},
            },
            roughnessFactor=0.6,
        ),
        "diffuse transmission": extended(
            "KHR_materials_diffuse_transmission",
            {
                "diffuseTransmissionFactor": 0.9,
                "diffuseTransmissionTexture": TEXTURE,
                "diffuseTransmissionColorFactor": [0.5, 0.6, 1.0],
                "diffuseTransmissionColorTexture": TEXTURE,
            },
            {
                "type": "blendbsdf",
                "weight": texels(mi, 0.9 * RGBA[:, :, 3]),
                "first": principled(roughness=1.0),
                "second": {
                    "type": "principledthin",
                    "base_color": texels(mi, colours * [0.5, 0.6, 1.0]),
                    "diff_trans": 2.0,
                },
            },
        ),
    }


def extended(
    name: str, values: dict[str, Any], bsdf: dict[str, Any], **pbr: Any
) -> tuple[dict[str, Any], dict[str, Any]]:
    return {"pbrMetallicRoughness": MATT | pbr, "extensions": {name: values}}, bsdf


NAMES = (
    "matt",
    "metallic and roughness textures",
    "ior",
    "clearcoat textures",
    "sheen texture",
    "specular texture",
    "specular colour texture",
    "rough transmission",
    "diffuse transmission",
)


@pytest.mark.parametrize("lamp", [BEFORE, BEHIND], ids=["lit", "lit from behind"])
@pytest.mark.parametrize("name", NAMES)
def test_materials_look_as_mitsubas_that_they_stand_for(name: str, lamp: NDArray[np.float64], tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    material, bsdf = cases(mi)[name]
    scene = load(gltf(tmp_path, material, lamp), size=(SIDE, SIDE))
    chosen = "transmission" in name  # which of two materials a path meets is chosen at random
    spp = 512 if chosen else 16
    settings = RenderSettings(integrator=Integrator.PATH, spp=spp, max_depth=2, all_effects=True)
    ours = render_in_process(scene, settings, workers=1).pixels.astype(np.float64)
    expected = theirs(mi, bsdf, lamp)
    if lamp is BEHIND and not chosen:
        np.testing.assert_array_equal(ours, 0.0)
        return
    assert expected.mean() > 1e-3
    np.testing.assert_allclose(ours.mean(axis=(0, 1)), expected.mean(axis=(0, 1)), rtol=0.01)
    if not chosen:
        close = np.isclose(ours, expected, rtol=0.01, atol=1e-3).all(axis=2)
        assert close.mean() > 0.7  # pixels on borders hold more than one texel
