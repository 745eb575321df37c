"""Pictures of a Mitsuba scene are decoded beside its other files: the same pixels, and the same errors."""

from __future__ import annotations

import json
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from wdpm.scenes import Bitmap, SceneError, load
from wdpm.scenes.gltf.container import GltfFile
from wdpm.scenes.gltf.textures import images_of
from wdpm.scenes.images.ahead import Ahead
from wdpm.scenes.images.read import read_texture
from wdpm.scenes.mitsuba.document import read_document
from wdpm.scenes.mitsuba.textures import pictures_of, read_picture
from wdpm.scenes.model.bsdfs import textures_of

TEXTURE = '<texture type="bitmap" name="reflectance"><string name="filename" value="{}"/>{}</texture>'
RAW = '<boolean name="raw" value="true"/>'


def bsdf(id_: str, file: str, more: str = "") -> str:
    return f'<bsdf type="diffuse" id="{id_}">{TEXTURE.format(file, more)}</bsdf>'


def shape(inner: str) -> str:
    return f'<shape type="rectangle">{inner}</shape>'


def scene(folder: Path, *parts: str) -> Path:
    lamp = shape('<emitter type="area"/>')
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{"".join(parts)}{lamp}</scene>')
    return folder / "scene.xml"


@pytest.fixture
def three(tmp_path: Path) -> Path:
    """A scene with one picture twice, another raw, a third that no shape uses, and one that is named and not there."""
    for number, name in enumerate(("a.png", "b.png")):
        pixels = np.random.default_rng(number).integers(0, 256, (5, 7, 3), dtype=np.uint8)
        imageio.imwrite(tmp_path / name, pixels)
    (tmp_path / "broken.png").write_bytes(b"no picture")
    bsdfs = (bsdf("unused", "broken.png"), bsdf("missing", "missing.png"), bsdf("a", "a.png"))
    shapes = (shape(bsdf("b", "b.png", RAW)), shape('<ref id="a"/>'), shape(bsdf("c", "a.png")))
    return scene(tmp_path, *bsdfs, *shapes)


def test_what_shapes_use_is_read_ahead_once(three: Path) -> None:
    found = list(dict.fromkeys(pictures_of(read_document(three, {}))))
    assert found == [((three.parent / "b.png").resolve(), True), ((three.parent / "a.png").resolve(), False)]


def test_pixels_are_those_of_the_files(three: Path) -> None:
    loaded = load(three)
    found = {}
    for material in loaded.materials:
        for texture in textures_of(material.bsdf):
            assert isinstance(texture, Bitmap)
            found[texture.name] = texture.pixels
    for name, raw in (("a.png", False), ("b.png", True)):
        np.testing.assert_array_equal(found[name], read_texture(three.parent / name, raw=raw))


def test_a_broken_picture_is_told_when_it_is_used(three: Path) -> None:
    file = scene(three.parent, bsdf("x", "broken.png"), shape('<ref id="x"/>'))
    with pytest.raises(SceneError, match=r"broken\.png: cannot be read as an image"):
        load(file)


@pytest.mark.parametrize("threads", [1, 3])
def test_any_number_of_threads(three: Path, threads: int) -> None:
    file = three.parent / "a.png"
    broken = three.parent / "broken.png"
    with Ahead(read_picture, [(file, False), (file, True), (broken, False)], threads) as pictures:
        for raw in (True, False, False):
            np.testing.assert_array_equal(pictures.get((file, raw)), read_texture(file, raw=raw))
        with pytest.raises(SceneError, match="cannot be read as an image"):
            pictures.get((broken, False))


def test_images_of_a_gltf_file_that_are_read_ahead(tmp_path: Path) -> None:
    materials = [
        {"occlusionTexture": {"index": 3}},
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 2}}, "emissiveTexture": {"index": 9}},
        {"extensions": {"KHR_materials_sheen": {"sheenColorTexture": {"index": 1}}}, "normalTexture": {"index": 0}},
    ]
    document = {
        "asset": {"version": "2.0"},
        "materials": materials,
        "textures": [{"source": 5}, {"source": 4}, {"source": 3}, {"source": 6}],
        "meshes": [{"primitives": [{"material": 2}, {"material": 1}, {"material": 7}, {}]}, {"primitives": None}],
    }
    (tmp_path / "m.gltf").write_text(json.dumps(document))
    assert set(images_of(GltfFile(tmp_path / "m.gltf"))) == {5, 4, 3}  # no mesh uses the first material
