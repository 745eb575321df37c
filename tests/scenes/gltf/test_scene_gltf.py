"""glTF files made by hand."""

from __future__ import annotations

import base64
import io
import json
import struct
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import pytest

from wdpm.scenes import (
    Bitmap,
    Blend,
    Bsdf,
    Interpolation,
    Mask,
    NormalMap,
    PointLight,
    Principled,
    SceneError,
    ThinDielectric,
    TwoSided,
    Wrap,
    load,
)

POSITIONS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype="<f4")
INDICES = np.array([0, 1, 2, 0, 2, 3], dtype="<u2")
BLOB = POSITIONS.tobytes() + INDICES.tobytes() + POSITIONS[:, :2].tobytes()


def document(**changes: Any) -> dict[str, Any]:
    """A unit square in the plane z = 0."""
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "square"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 12},
            {"buffer": 0, "byteOffset": 60, "byteLength": 32},
        ],
        "buffers": [{"byteLength": len(BLOB), "uri": "data:;base64," + base64.b64encode(BLOB).decode()}],
        **changes,
    }


def write(folder: Path, content: dict[str, Any]) -> Path:
    file = folder / "m.gltf"
    file.write_text(json.dumps(content))
    return file


def glb(content: dict[str, Any]) -> bytes:
    content = {**content, "buffers": [{"byteLength": len(BLOB)}]}
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(BLOB), 0x004E4942) + BLOB
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def test_gltf_and_glb_hold_the_same(tmp_path: Path) -> None:
    first = load(write(tmp_path, document()))
    (tmp_path / "m.glb").write_bytes(glb(document()))
    second = load(tmp_path / "m.glb")
    np.testing.assert_array_equal(first.meshes[0].vertices, POSITIONS)
    np.testing.assert_array_equal(first.meshes[0].vertices, second.meshes[0].vertices)
    np.testing.assert_array_equal(first.meshes[0].faces, [[0, 1, 2], [0, 2, 3]])
    assert any("no camera and no lights" in warning for warning in first.warnings)


def test_nodes_camera_and_light(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    nodes = [
        {"children": [1], "translation": [10, 0, 0], "scale": [2, 2, 2]},
        {"mesh": 0, "rotation": [0, 0, half, half]},
        {"camera": 0, "translation": [0, 0, 5]},
        {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 7, 0]},
    ]
    lights = [{"type": "point", "intensity": 100, "color": [1, 0.5, 0.25]}]
    camera = {"type": "perspective", "perspective": {"yfov": 1.0, "aspectRatio": 2.0, "znear": 0.1}}
    scene = load(
        write(
            tmp_path,
            document(
                nodes=nodes,
                scenes=[{"nodes": [0, 2, 3]}],
                cameras=[camera],
                extensions={"KHR_lights_punctual": {"lights": lights}},
            ),
        )
    )
    np.testing.assert_allclose(scene.meshes[0].vertices[1], [10, 2, 0], atol=1e-12)
    assert (scene.camera.width, scene.camera.height) == (1024, 512)
    assert np.tan(np.radians(scene.camera.fov_x) / 2) == pytest.approx(2 * np.tan(0.5))
    np.testing.assert_allclose(scene.camera.to_world[:3], [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 5]], atol=1e-12)
    (light,) = scene.lights
    assert isinstance(light, PointLight)
    assert light.position == (0.0, 7.0, 0.0)
    assert light.intensity == (100.0, 50.0, 25.0)
    assert scene.exposure is None  # nobody says how bright a hundred candela are meant to look


def test_material(tmp_path: Path) -> None:
    pixels = np.zeros((2, 2, 3), dtype=np.uint8)
    pixels[0, 0] = 255
    png = io.BytesIO()
    imageio.imwrite(png, pixels, extension=".png")
    content = document(
        materials=[
            {
                "name": "painted",
                "doubleSided": True,
                "emissiveFactor": [1, 0.5, 0],
                "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}},
                "pbrMetallicRoughness": {
                    "metallicFactor": 0,
                    "baseColorFactor": [0.5, 1, 1, 1],
                    "baseColorTexture": {"index": 0},
                },
            }
        ],
        textures=[{"source": 0, "sampler": 0}],
        samplers=[{"wrapS": 33648, "wrapT": 33648, "magFilter": 9728}],
        images=[{"uri": "data:image/png;base64," + base64.b64encode(png.getvalue()).decode()}],
    )
    content["meshes"][0]["primitives"][0]["material"] = 0
    scene = load(write(tmp_path, content))
    bsdf = scene.materials[0].bsdf
    assert isinstance(bsdf, TwoSided)
    assert isinstance(bsdf.front, Principled)
    assert (bsdf.front.metallic, bsdf.front.roughness, bsdf.front.eta) == (0.0, 1.0, 1.5)
    bitmap = bsdf.front.base_color
    assert isinstance(bitmap, Bitmap)
    np.testing.assert_allclose(bitmap.pixels[0, 0], [0.5, 1, 1])
    np.testing.assert_allclose(bitmap.to_uv @ [0, 0, 1], [0, 1, 1])  # glTF's v = 0 is the top, our v = 1
    assert (bitmap.wrap, bitmap.interpolation) == (Wrap.MIRROR, Interpolation.NEAREST)
    assert scene.meshes[0].emission == (4.0, 2.0, 0.0)


@pytest.mark.parametrize(
    ("mode", "expected"),
    [(4, [[0, 1, 2], [0, 2, 3]]), (5, [[0, 1, 2], [1, 0, 0], [0, 2, 2], [0, 2, 3][::1]]), (6, None)],
)
def test_primitive_modes(tmp_path: Path, mode: int, expected: list[list[int]] | None) -> None:
    content = document()
    content["meshes"][0]["primitives"][0]["mode"] = mode
    faces = load(write(tmp_path, content)).meshes[0].faces.tolist()
    strip = [[0, 1, 2], [2, 1, 0], [2, 0, 2], [2, 0, 3]]
    fan = [[0, 1, 2], [0, 2, 0], [0, 0, 2], [0, 2, 3]]
    assert faces == {4: expected, 5: strip, 6: fan}[mode]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"asset": {"version": "1.0"}}, "expected glTF version 2"),
        ({"asset": {"version": "2.0", "minVersion": "3.0"}}, "asks for a reader of glTF 3.0 in asset.minVersion"),
        ({"extensionsRequired": ["KHR_texture_basisu"]}, "KHR_texture_basisu"),
        ({"nodes": [{"mesh": 3}]}, r"there is no meshes\[3\]"),
        ({"nodes": [{"mesh": 0, "children": [0]}]}, "its own ancestor"),
        ({"buffers": [{"byteLength": 1000, "uri": "data:;base64,AAAA"}]}, "truncated"),
        ({"buffers": [{"byteLength": 92, "uri": "http://example.org/a.bin"}]}, "nothing is fetched"),
        ({"buffers": [{"byteLength": 92, "uri": "none.bin"}]}, '"none.bin" cannot be read'),
        ({"buffers": [{"byteLength": 92, "uri": "a%00.bin"}]}, "'a%00.bin' can be no name of a file"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 9999}]}, "beyond the end"),
        ({"nodes": [{"mesh": 0, "scale": [1, 0, 1]}]}, "flattens space"),
        ({"nodes": [{"mesh": 0, "scale": "big"}]}, '"scale" is "big"'),
        ({"nodes": []}, r"there is no nodes\[0\]"),
    ],
)
def test_broken_gltf(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    content = document(**changes)
    if "scale" in str(changes):
        content["accessors"].append(content["accessors"][0])
        content["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 0
    with pytest.raises(SceneError, match=message):
        load(write(tmp_path, content))


def test_index_out_of_range(tmp_path: Path) -> None:
    blob = bytearray(BLOB)
    blob[48:50] = b"\x09\x00"
    uri = "data:;base64," + base64.b64encode(bytes(blob)).decode()
    with pytest.raises(SceneError, match="an index is out of range"):
        load(write(tmp_path, document(buffers=[{"byteLength": len(blob), "uri": uri}])))


def test_truncated_glb(tmp_path: Path) -> None:
    data = glb(document())
    file = tmp_path / "m.glb"
    for end in range(4, len(data) - 1, 37):
        file.write_bytes(data[:end])
        with pytest.raises(SceneError, match=r"truncated|too short"):
            load(file)


def test_broken_json(tmp_path: Path) -> None:
    file = tmp_path / "m.gltf"
    file.write_text("{\n  broken\n}")
    with pytest.raises(SceneError, match=r"m\.gltf:2: broken JSON"):
        load(file)


def image_uri(pixels: np.ndarray) -> str:
    png = io.BytesIO()
    imageio.imwrite(png, pixels, extension=".png")
    return "data:image/png;base64," + base64.b64encode(png.getvalue()).decode()


def material_of(folder: Path, material: dict[str, Any], *images: np.ndarray) -> Bsdf:
    """How a material scatters light; texture n shows image n."""
    content = document(
        materials=[material],
        textures=[{"source": number} for number in range(len(images))],
        images=[{"uri": image_uri(pixels)} for pixels in images],
    )
    content["meshes"][0]["primitives"][0]["material"] = 0
    return load(write(folder, content)).materials[0].bsdf


def test_metallic_roughness(tmp_path: Path) -> None:
    """Roughness is the texture's green channel and metallic its blue one, times their factors, never decoded."""
    pixels = np.zeros((2, 2, 3), dtype=np.uint8)
    pixels[:] = (9, 102, 204)
    pbr = {"metallicFactor": 0.5, "roughnessFactor": 0.5, "metallicRoughnessTexture": {"index": 0}}
    bsdf = material_of(tmp_path, {"pbrMetallicRoughness": pbr}, pixels)
    assert isinstance(bsdf, Principled)
    assert isinstance(bsdf.roughness, Bitmap)
    assert isinstance(bsdf.metallic, Bitmap)
    np.testing.assert_allclose(bsdf.roughness.pixels, 0.2, rtol=1e-6)
    np.testing.assert_allclose(bsdf.metallic.pixels, 0.4, rtol=1e-6)
    plain = material_of(tmp_path, {})
    assert isinstance(plain, Principled)
    assert (plain.base_color, plain.metallic, plain.roughness) == ((1.0, 1.0, 1.0), 1.0, 1.0)
    assert plain.layered


@pytest.mark.parametrize(
    ("mode", "expected"),
    [({"alphaMode": "BLEND"}, 0.4), ({"alphaMode": "MASK"}, 0.0), ({"alphaMode": "MASK", "alphaCutoff": 0.3}, 1.0)],
)
def test_alpha(tmp_path: Path, mode: dict[str, Any], expected: float) -> None:
    pixels = np.full((2, 2, 4), 255, dtype=np.uint8)
    pixels[0, 0, 3] = 204
    pixels[1, 1, 3] = 0
    pbr = {"baseColorFactor": [1, 1, 1, 0.5], "baseColorTexture": {"index": 0}}
    bsdf = material_of(tmp_path, {**mode, "pbrMetallicRoughness": pbr}, pixels)
    assert isinstance(bsdf, Mask)
    assert isinstance(bsdf.opacity, Bitmap)
    shown = bsdf.opacity.pixels[0, 0, 0]
    assert (float(shown >= bsdf.cutoff) if bsdf.cutoff else shown) == pytest.approx(expected)
    assert bsdf.opacity.pixels[1, 1, 0] == 0.0
    factor = material_of(tmp_path, {**mode, "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.4]}})
    assert (factor.opacity if isinstance(factor, Mask) else 1.0) == pytest.approx(expected)
    assert isinstance(material_of(tmp_path, {"pbrMetallicRoughness": pbr}, pixels), Principled)  # opaque by default


def test_normal_texture(tmp_path: Path) -> None:
    pixels = np.zeros((2, 2, 3), dtype=np.uint8)
    pixels[:] = (255, 128, 255)
    bsdf = material_of(tmp_path, {"doubleSided": True, "normalTexture": {"index": 0, "scale": 0.5}}, pixels)
    assert isinstance(bsdf, TwoSided)
    assert isinstance(bsdf.front, NormalMap)
    assert isinstance(bsdf.front.normals, Bitmap)
    x, y, z = bsdf.front.normals.pixels[0, 0] * 2.0 - 1.0
    assert (x / z, y / z) == pytest.approx((0.5, 0.5 / 255), rel=1e-4)


def extended(**extensions: Any) -> dict[str, Any]:
    pbr = {"metallicFactor": 0, "roughnessFactor": 0, "baseColorFactor": [0.5, 0.6, 0.7, 1]}
    return {"pbrMetallicRoughness": pbr, "extensions": {f"KHR_materials_{k}": v for k, v in extensions.items()}}


def test_thin_and_solid_glass(tmp_path: Path) -> None:
    thin = material_of(tmp_path, extended(transmission={"transmissionFactor": 0.75}, ior={"ior": 1.3}))
    assert isinstance(thin, Blend)
    assert thin.weight == 0.75
    assert isinstance(thin.second, ThinDielectric)
    assert thin.second.specular_transmittance == (0.5, 0.6, 0.7)
    side = ((thin.second.eta - 1) / (thin.second.eta + 1)) ** 2
    assert 2 * side / (1 + side) == pytest.approx((0.3 / 2.3) ** 2)  # both sides reflect as one surface of the index
    solid = material_of(
        tmp_path, extended(transmission={"transmissionFactor": 1}, volume={"thicknessFactor": 1}, ior={"ior": 1.3})
    )
    assert isinstance(solid, Principled)
    assert (solid.spec_trans, solid.eta) == (1.0, 1.3)


def test_specular_and_clear_coat(tmp_path: Path) -> None:
    weaker = material_of(tmp_path, extended(specular={"specularFactor": 0.25}))
    assert isinstance(weaker, Blend)
    assert isinstance(weaker.first, Principled)
    assert isinstance(weaker.second, Principled)
    assert (weaker.weight, weaker.first.eta, weaker.second.eta) == (0.25, 1.001, 1.5)
    coated = material_of(tmp_path, extended(clearcoat={"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.1}))
    assert isinstance(coated, Principled)
    assert coated.clearcoat == 0.5
    assert 0.1 + (0.001 - 0.1) * coated.clearcoat_gloss == pytest.approx(0.1**2)  # the microfacets' alpha


def test_emissive_texture(tmp_path: Path) -> None:
    content = document(
        materials=[{"emissiveFactor": [1, 2, 0], "emissiveTexture": {"index": 0}}],
        textures=[{"source": 0}],
        images=[{"uri": image_uri(np.full((2, 2, 3), 255, dtype=np.uint8))}],
    )
    content["meshes"][0]["primitives"][0]["material"] = 0
    emission = load(write(tmp_path, content)).meshes[0].emission
    assert isinstance(emission, Bitmap)
    np.testing.assert_allclose(emission.pixels[0, 0], [1, 2, 0])


@pytest.mark.parametrize(
    ("material", "message"),
    [
        ({"pbrMetallicRoughness": {"roughnessFactor": 1.5}}, "roughnessFactor must lie between 0 and 1"),
        ({"alphaMode": "SHINY"}, 'alphaMode "SHINY"'),
        (extended(ior={"ior": 0.5}), "ior must be 0 or at least 1"),
    ],
)
def test_broken_materials(tmp_path: Path, material: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        material_of(tmp_path, material)
