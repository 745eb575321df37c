"""Attributes of faces in PLY files, and the texture that shows them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.ply import read_ply
from wdpm.scenes.mitsuba.read import read_mitsuba

CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
FACES = [(0, 1, 2), (0, 2, 3)]
COLORS = [(255, 0, 51), (0, 102, 204)]
WEIGHTS = [0.25, 0.75]

HEADER = """ply
format {order} 1.0
element vertex 4
property float x
property float y
property float z
element face {faces}
property uchar red
property list uchar int vertex_indices
property uchar green
property uchar blue
property float load_x
property float flag
end_header
"""


def write(file: Path, *, binary: bool) -> None:
    header = HEADER.format(order="binary_little_endian" if binary else "ascii", faces=len(FACES))
    rows = [(*face, *color, weight) for face, color, weight in zip(FACES, COLORS, WEIGHTS, strict=True)]
    if binary:
        body = b"".join(struct.pack("<3f", *corner) for corner in CORNERS)
        body += b"".join(struct.pack("<BB3iBB2f", r, 3, a, b, c, g, blue, w, 9.0) for a, b, c, r, g, blue, w in rows)
        file.write_bytes(header.encode() + body)
    else:
        lines = [" ".join(map(str, corner)) for corner in CORNERS]
        lines += [f"{r} 3 {a} {b} {c} {g} {blue} {w} 9" for a, b, c, r, g, blue, w in rows]
        file.write_text(header + "\n".join(lines) + "\n")


@pytest.mark.parametrize("binary", [True, False])
def test_attributes_are_read_beside_the_corners(binary: bool, tmp_path: Path) -> None:
    write(tmp_path / "faces.ply", binary=binary)
    mesh = read_ply(tmp_path / "faces.ply")
    np.testing.assert_array_equal(mesh.faces, FACES)
    assert mesh.attributes == {}
    assert set(mesh.face_attributes) == {"face_color", "face_load"}
    np.testing.assert_allclose(mesh.face_attributes["face_color"].values, np.array(COLORS) / 255)
    np.testing.assert_allclose(mesh.face_attributes["face_load"].values[:, 0], WEIGHTS)


def test_polygons_hand_theirs_to_their_triangles(tmp_path: Path) -> None:
    header = HEADER.format(order="ascii", faces=1)
    corners = "\n".join(" ".join(map(str, corner)) for corner in CORNERS)
    (tmp_path / "quad.ply").write_text(f"{header}{corners}\n255 4 0 1 2 3 0 51 0.5 9\n")
    mesh = read_ply(tmp_path / "quad.ply")
    np.testing.assert_allclose(mesh.face_attributes["face_color"].values, [[1.0, 0.0, 0.2]] * 2)


def scene(folder: Path, name: str) -> Path:
    file = folder / "scene.xml"
    texture = f'<texture type="mesh_attribute" name="reflectance"><string name="name" value="{name}"/></texture>'
    file.write_text(f"""<scene version="3.0.0"><shape type="ply"><string name="filename" value="faces.ply"/>
<bsdf type="diffuse">{texture}</bsdf></shape><emitter type="constant"/></scene>""")
    return file


def test_a_face_shows_its_own_colour_to_its_edges(tmp_path: Path) -> None:
    write(tmp_path / "faces.ply", binary=True)
    (mesh,) = read_mitsuba(scene(tmp_path, "face_color"), {}).meshes
    np.testing.assert_allclose(mesh.colors[mesh.faces], np.repeat(np.array(COLORS)[:, None] / 255, 3, axis=1))
    np.testing.assert_allclose(mesh.vertices[mesh.faces], np.array(CORNERS, float)[FACES])
    np.testing.assert_allclose(mesh.normals, [[0.0, 0.0, 1.0]] * 6, atol=1e-12)  # smooth ones, from before
    (weighed,) = read_mitsuba(scene(tmp_path, "face_load"), {}).meshes
    np.testing.assert_allclose(weighed.colors[weighed.faces][:, 0], np.repeat(np.array(WEIGHTS)[:, None], 3, axis=1))


def test_an_attribute_that_faces_lack_is_named_with_those_that_they_have(tmp_path: Path) -> None:
    write(tmp_path / "faces.ply", binary=True)
    with pytest.raises(SceneError, match=r'scene.xml:1: .*no attribute "face_flag" \(it has face_color, face_load\)'):
        read_mitsuba(scene(tmp_path, "face_flag"), {})


def test_mitsuba_has_the_same_attributes(tmp_path: Path) -> None:
    """Of whole numbers it takes 255 for 255, with a warning; so its colours count here as shares of that."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    level = mi.logger().log_level()
    mi.set_log_level(mi.LogLevel.Error)
    write(tmp_path / "faces.ply", binary=False)
    theirs = mi.traverse(mi.load_dict({"type": "ply", "filename": str(tmp_path / "faces.ply")}))
    mi.set_log_level(level)
    ours = read_ply(tmp_path / "faces.ply").face_attributes
    np.testing.assert_allclose(np.array(theirs["face_load"]), ours["face_load"].values[:, 0], atol=1e-6)
    np.testing.assert_allclose(np.array(theirs["face_color"]) / 255, ours["face_color"].values.reshape(-1), atol=1e-6)
