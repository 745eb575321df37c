"""OBJ files whose materials a scene of Mitsuba 0.6 gives bsdfs to, by their names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wdpm.scenes.errors import SceneError
from wdpm.scenes.mitsuba.read import read_mitsuba
from wdpm.scenes.model.bsdfs import Conductor, Diffuse
from wdpm.scenes.model.scene import Scene

OBJ = """v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
usemtl matRed
f 1 2 3
usemtl chrome 2
f 1 2 4
usemtl matRed
f 1 3 4
"""
RED = '<bsdf type="diffuse" name="matRed"><rgb name="reflectance" value="0.8 0.1 0.1"/></bsdf>'


def read(folder: Path, bsdfs: str, version: str = "0.6.0") -> Scene:
    (folder / "parts.obj").write_text(OBJ)
    file = folder / "scene.xml"
    file.write_text(
        f'''<scene version="{version}"><bsdf type="conductor" id="metal"/>
<shape type="obj" id="parts"><string name="filename" value="parts.obj"/>{bsdfs}</shape>
<emitter type="constant"/></scene>'''
    )
    return read_mitsuba(file, {})


def test_each_material_becomes_a_mesh_with_its_bsdf(tmp_path: Path) -> None:
    scene = read(tmp_path, RED + '<ref id="metal" name="chrome 2"/>')
    assert [mesh.name for mesh in scene.meshes] == ["parts matRed", "parts chrome 2"]
    assert [len(mesh.faces) for mesh in scene.meshes] == [2, 1]
    red, metal = (scene.materials[mesh.material].bsdf for mesh in scene.meshes)
    assert isinstance(red, Diffuse)
    assert red.reflectance == (0.8, 0.1, 0.1)
    assert isinstance(metal, Conductor)
    corners = scene.meshes[0].vertices[scene.meshes[0].faces]
    np.testing.assert_array_equal(corners, [[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [0, 1, 0], [0, 0, 1]]])


def test_what_has_no_bsdf_of_its_own_takes_the_one_without_a_name(tmp_path: Path) -> None:
    scene = read(tmp_path, RED + '<bsdf type="conductor"/>')
    assert isinstance(scene.materials[scene.meshes[1].material].bsdf, Conductor)
    assert not any("no bsdf" in warning for warning in scene.warnings)


def test_names_that_do_not_meet_are_told(tmp_path: Path) -> None:
    scene = read(tmp_path, RED + '<bsdf type="conductor" name="glass"/>')
    text = " ".join(scene.warnings)
    assert 'its file has no material "glass" (it has "matRed", "chrome 2"): nothing shows it' in text
    assert 'no bsdf for the material "chrome 2" of its file: it is grey' in text


def test_two_for_one_material_and_several_in_mitsuba_3_are_errors(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r'scene.xml:2: .*two bsdfs for the material "mat_red"'):
        read(tmp_path, RED + RED)
    with pytest.raises(SceneError, match=r"scene.xml:2: .*takes one bsdf, got 2"):
        read(tmp_path, RED + '<bsdf type="conductor"/>', "3.0.0")
