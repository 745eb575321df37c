"""glTF extensions: compressed meshes, volumes that absorb, sheen, WebP textures; what is refused and how."""

from __future__ import annotations

import base64
import io
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from wdpm.scenes import Bitmap, Principled, Scene, SceneError, load

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0]], "<f4")
FACES = np.array([[0, 1, 2], [0, 2, 3]], "<u4")
DRACO = "KHR_draco_mesh_compression"


def uri(data: bytes) -> str:
    return "data:;base64," + base64.b64encode(data).decode()


def square(folder: Path, **changes: Any) -> Path:
    """A rectangle of 1 x 2."""
    blob = CORNERS.tobytes() + FACES.tobytes()
    document = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": CORNERS.nbytes},
            {"buffer": 0, "byteOffset": CORNERS.nbytes, "byteLength": FACES.nbytes},
        ],
        "buffers": [{"byteLength": len(blob), "uri": uri(blob)}],
        **changes,
    }
    file = folder / "square.gltf"
    file.write_text(json.dumps(document))
    return file


def compressed(folder: Path, data: bytes, number: int = 0, count: int = 4) -> Path:
    """The same, its mesh in a buffer that Draco has compressed."""
    extension = {DRACO: {"bufferView": 0, "attributes": {"POSITION": number}}}
    return square(
        folder,
        extensionsRequired=[DRACO],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "extensions": extension}]}],
        accessors=[
            {"componentType": 5126, "count": count, "type": "VEC3"},
            {"componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        bufferViews=[{"buffer": 0, "byteLength": len(data)}],
        buffers=[{"byteLength": len(data), "uri": uri(data)}],
    )


def triangles(scene: Scene) -> set[tuple[tuple[float, ...], ...]]:
    """Of the first mesh, each from its least corner on, so that the order of corners in the file does not matter."""
    found = set()
    for face in scene.meshes[0].faces:
        corners = [tuple(round(float(axis), 3) for axis in scene.meshes[0].vertices[vertex]) for vertex in face]
        first = corners.index(min(corners))
        found.add(tuple(corners[first:] + corners[:first]))
    return found


def test_draco(tmp_path: Path) -> None:
    library = pytest.importorskip("DracoPy", reason="DracoPy is not installed: see the extra draco")
    data = library.encode(CORNERS, FACES)
    number = library.decode(data).attributes[0]["unique_id"]
    plain = triangles(load(square(tmp_path)))
    assert triangles(load(compressed(tmp_path, data, number))) == plain
    with pytest.raises(SceneError, match=r"accessors\[0\] is of shape \(4, 3\), expected \(9, 3\)"):
        load(compressed(tmp_path, data, number, count=9))
    with pytest.raises(SceneError, match='Draco has no attribute 77 for "POSITION"'):
        load(compressed(tmp_path, data, 77))
    for broken in (data[: len(data) // 2], b"DRACO" + bytes(30), b"x"):
        with pytest.raises(SceneError, match="broken glTF: Draco"):
            load(compressed(tmp_path, broken, number))


def test_draco_without_its_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(SceneError, match=r"compressed by Draco: pip install 'wdpm\[draco\]' reads them"):
        load(compressed(tmp_path, b"anything"))


def test_meshopt_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"unpack them first, as `gltf-transform copy square.gltf unpacked.glb` does"):
        load(square(tmp_path, extensionsRequired=["EXT_meshopt_compression"]))


def volume(**values: Any) -> list[dict[str, Any]]:
    extensions = {
        "KHR_materials_transmission": {"transmissionFactor": 1},
        "KHR_materials_volume": {"thicknessFactor": 1, **values},
    }
    return [{"name": "jade", "extensions": extensions}]


def test_volumes_absorb(tmp_path: Path) -> None:
    """Light becomes the attenuation's colour over its distance."""
    scene = load(square(tmp_path, materials=volume(attenuationColor=[0.5, 1, 0.1], attenuationDistance=2)))
    (medium,) = scene.media
    passed = [math.exp(-sigma * 2) for sigma in medium.sigma_t]
    assert passed == pytest.approx([0.5, 1.0, 0.1])
    assert medium.albedo == (0.0, 0.0, 0.0)
    assert (scene.meshes[0].interior, scene.meshes[0].exterior, scene.meshes[0].bounds) == (0, None, True)


@pytest.mark.parametrize("values", [{}, {"attenuationColor": [0.5, 0.5, 0.5]}, {"attenuationDistance": 2}])
def test_volumes_that_absorb_nothing_have_no_medium(tmp_path: Path, values: dict[str, Any]) -> None:
    scene = load(square(tmp_path, materials=volume(**values)))
    assert scene.media == ()
    assert not scene.meshes[0].bounds


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"attenuationColor": [2, 0, 0], "attenuationDistance": 1}, "attenuationColor must lie between 0 and 1"),
        ({"attenuationColor": [0.5, 0, 0], "attenuationDistance": 0}, "attenuationDistance must be above 0"),
        ({"attenuationColor": [0.5, 0]}, "must be 3 numbers"),
    ],
)
def test_volumes_that_cannot_be(tmp_path: Path, values: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        load(square(tmp_path, materials=volume(**values)))


def test_sheen(tmp_path: Path) -> None:
    sheen = {"KHR_materials_sheen": {"sheenColorFactor": [0.9, 0.6, 0.3], "sheenRoughnessFactor": 0.4}}
    scene = load(square(tmp_path, materials=[{"extensions": sheen}]))
    bsdf = scene.materials[scene.meshes[0].material].bsdf
    assert isinstance(bsdf, Principled)
    assert bsdf.sheen == pytest.approx(0.6)
    assert any("sheen is Disney's" in warning for warning in scene.warnings)


def textured(folder: Path, texture: dict[str, Any], image: bytes) -> Path:
    corners = CORNERS.tobytes() + FACES.tobytes() + CORNERS[:, :2].tobytes()
    file = square(folder)
    document = json.loads(file.read_text())
    document["buffers"] = [{"byteLength": len(corners), "uri": uri(corners)}]
    document["bufferViews"].append({"buffer": 0, "byteOffset": 72, "byteLength": 32})
    document["accessors"].append({"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2"})
    document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = 2
    document["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    document |= {"textures": [texture], "images": [{"uri": uri(image)}]}
    file.write_text(json.dumps(document))
    return file


def test_textures_in_webp(tmp_path: Path) -> None:
    data = io.BytesIO()
    PIL.Image.new("RGB", (4, 4), (255, 0, 0)).save(data, "WEBP", lossless=True)
    scene = load(textured(tmp_path, {"extensions": {"EXT_texture_webp": {"source": 0}}}, data.getvalue()))
    bsdf = scene.materials[scene.meshes[0].material].bsdf
    assert isinstance(bsdf, Principled)
    assert isinstance(bsdf.base_color, Bitmap)
    np.testing.assert_allclose(bsdf.base_color.pixels[1, 1], [1, 0, 0], atol=1e-6)


def test_textures_in_ktx2_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"no PNG, JPEG or WebP source \(it is in KHR_texture_basisu\)"):
        load(textured(tmp_path, {"extensions": {"KHR_texture_basisu": {"source": 0}}}, b""))
