"""Scenes that are reached by links: what they name lies beside the link, or beside the file that it stands for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

from wdpm.scenes.errors import SceneError
from wdpm.scenes.load import load
from wdpm.scenes.model.bsdfs import walk
from wdpm.scenes.model.scene import Scene
from wdpm.scenes.model.textures import Bitmap

LIGHT = '<emitter type="point"><rgb name="intensity" value="9"/></emitter>'
INCLUDING = f'<scene version="3.0.0">{LIGHT}<path value="shapes"/><include filename="ball.xml"/></scene>'
BALL = """<scene version="3.0.0"><shape type="sphere"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
    <string name="filename" value="paint.png"/></texture></bsdf></shape></scene>"""
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
GLTF = {
    "asset": {"version": "2.0"},
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"byteLength": 36, "uri": "triangle.bin"}],
}
OBJ = "mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl paint\nf 1/1 2/1 3/1\n"

pytestmark = pytest.mark.skipif(not hasattr(Path, "symlink_to"), reason="there are no links")


def paint(folder: Path, value: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    Pillow.fromarray(np.full((2, 2, 3), value, np.uint8)).save(folder / "paint.png")


@pytest.fixture
def places(tmp_path: Path) -> tuple[Path, Path]:
    """Where scenes lie, and where links to them do."""
    for name in ("there", "here"):
        (tmp_path / name).mkdir()
    return tmp_path / "there", tmp_path / "here"


def linked(places: tuple[Path, Path], name: str, text: str, link: str = "") -> Path:
    there, here = places
    (there / name).write_text(text)
    (here / (link or name)).symlink_to(Path("..", there.name, name))
    return here / (link or name)


def texture_of(scene: Scene) -> Bitmap:
    found = [
        value
        for material in scene.materials
        for node in walk(material.bsdf)
        for value in vars(node).values()
        if isinstance(value, Bitmap)
    ]
    assert len(found) == 1
    return found[0]


def brightness(scene: Scene) -> float:
    return float(texture_of(scene).pixels.mean())


def test_mitsuba_files_find_folders_includes_and_pictures(places: tuple[Path, Path]) -> None:
    file = linked(places, "scene.xml", INCLUDING)
    paint(places[0] / "shapes", 128)
    (places[0] / "shapes" / "ball.xml").write_text(BALL)
    assert brightness(load(file)) == pytest.approx(0.2159, abs=1e-3)


def test_gltf_files_find_their_buffers(places: tuple[Path, Path]) -> None:
    file = linked(places, "scene.gltf", json.dumps(GLTF))
    (places[0] / "triangle.bin").write_bytes(TRIANGLE.tobytes())
    assert "node 0" in [mesh.name for mesh in load(file).meshes]


@pytest.mark.parametrize("library", ["paint.mtl", "C:\\\\models\\\\paint.mtl", "no.mtl"])
def test_obj_files_find_libraries_and_these_their_pictures(library: str, places: tuple[Path, Path]) -> None:
    """Named, named as on another machine, and of the name that the model has where it lies."""
    file = linked(places, "paint.obj", OBJ.format(library), "model.obj")
    paint(places[0], 128)
    (places[0] / "paint.mtl").write_text("newmtl paint\nmap_Kd paint.png\n")
    assert brightness(load(file)) == pytest.approx(0.2159, abs=1e-3)


def test_what_lies_beside_a_link_comes_first(places: tuple[Path, Path]) -> None:
    file = linked(places, "scene.xml", BALL.replace("<shape", LIGHT + "<shape", 1))
    paint(places[0], 0)
    paint(places[1], 255)
    assert brightness(load(file)) == 1.0


def test_what_is_missing_is_missing_in_both(places: tuple[Path, Path]) -> None:
    with pytest.raises(SceneError, match=r"\"paint.png\" not found \(looked in .*here, .*there\)"):
        load(linked(places, "scene.xml", BALL))


def test_a_scene_root_is_held(places: tuple[Path, Path]) -> None:
    file = linked(places, "scene.xml", BALL)
    with pytest.raises(SceneError, match="outside of the scene root"):
        load(file, root=places[1])
