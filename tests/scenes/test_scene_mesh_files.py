"""OBJ, MTL, PLY, STL and serialized files, sound and broken."""

from __future__ import annotations

import contextlib
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wdpm.scenes import Dielectric, Diffuse, SceneError, TwoSided, flatten, load
from wdpm.scenes.meshes.mesh_data import MeshData, merge_corners
from wdpm.scenes.meshes.mtl import read_mtl
from wdpm.scenes.meshes.obj import read_obj
from wdpm.scenes.meshes.off import read_off
from wdpm.scenes.meshes.ply import read_ply
from wdpm.scenes.meshes.polygons.cutting import triangulate_fans
from wdpm.scenes.meshes.stl import read_stl
from wdpm.scenes.mitsuba.serialized import read_serialized


def area(mesh: MeshData) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def obj(folder: Path, text: str) -> Path:
    (folder / "m.obj").write_text(text)
    return folder / "m.obj"


ROOM = [  # five sides of a box, each with vertices of its own
    [(0, 0, 0), (2, 0, 0), (2, 0, 3), (0, 0, 3)],
    [(0, 1, 0), (0, 1, 3), (2, 1, 3), (2, 1, 0)],
    [(0, 0, 0), (0, 1, 0), (2, 1, 0), (2, 0, 0)],
    [(0, 0, 0), (0, 0, 3), (0, 1, 3), (0, 1, 0)],
    [(2, 0, 0), (2, 1, 0), (2, 1, 3), (2, 0, 3)],
]


def test_negative_indices_count_back_from_the_face(tmp_path: Path) -> None:
    negative, absolute = "", ""
    for number, side in enumerate(ROOM):
        lines = "".join(f"v {x} {y} {z}\n" for x, y, z in side)
        negative += lines + "f -4 -3 -2 -1\n"
        absolute += lines + f"f {4 * number + 1} {4 * number + 2} {4 * number + 3} {4 * number + 4}\n"
    first, second = read_obj(obj(tmp_path, negative)).mesh, read_obj(obj(tmp_path, absolute)).mesh
    np.testing.assert_array_equal(first.vertices[first.faces], second.vertices[second.faces])
    assert area(first) == pytest.approx(2 * 6 + 2 + 2 * 3)


def test_negative_texture_and_normal_indices(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 2\nf -3/-3/-1 -2/-2/-1 -1/-1/-1\n"
    mesh = read_obj(obj(tmp_path, text)).mesh
    assert mesh.uvs is not None
    assert mesh.normals is not None
    np.testing.assert_array_equal(mesh.uvs[mesh.faces[0]], [[0, 0], [1, 0], [0, 1]])
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1]] * 3)


def test_obj_oddities(tmp_path: Path) -> None:
    text = "# a comment\nv 0 0 0 1.0\nv 1 0 \\\n 0\nv 0 1 0 nan nan nan\ng x\nl 1 2\nf 1 2 3 # end\nwhat 3\n"
    found = read_obj(obj(tmp_path, text.replace("\n", "\r\n")))
    assert len(found.mesh.faces) == 1
    assert len(found.warnings) == 1
    assert 'm.obj:9: unknown keyword "what"' in found.warnings[0]


@pytest.mark.parametrize("end", ["", "f 1 \\\n 2 3\n"], ids=["by arrays", "by lines"])
def test_a_byte_order_mark_hides_no_vertex_and_no_material(tmp_path: Path, end: str) -> None:
    """Counted back from a face, the vertex behind it was missed without an error: the face had others' corners."""
    text = "v 5 0 0\nv 0 0 0\nv 1 0 0\nv 0 1 0\nmtllib m.mtl\nusemtl red\nf 1 2 3\nf -1 -3 -4\n" + end
    mark = "\N{ZERO WIDTH NO-BREAK SPACE}"
    (tmp_path / "m.mtl").write_text(f"{mark}newmtl red\nKd 1 0 0\n", encoding="utf-8")
    (tmp_path / "m.obj").write_text(mark + text, encoding="utf-8")
    found = read_obj(tmp_path / "m.obj")
    assert not found.warnings
    np.testing.assert_array_equal(found.mesh.vertices[found.mesh.faces[1]], [[0, 1, 0], [0, 0, 0], [5, 0, 0]])
    assert read_mtl(tmp_path / "m.mtl", []).keys() == {"red"}


def test_obj_corner_without_normal_makes_its_triangle_flat(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nf 1//1 2//1 3\nf 3//1 2//1 4//1\n"
    normals = flatten(load(obj(tmp_path, text))).triangles.normals
    assert not normals[0].any()
    np.testing.assert_array_equal(normals[1], [[0, 0, 1]] * 3)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("v 0 0\n", 1, '"v" needs 3 numbers'),
        ("v 0 0 0\nv 0 zero 0\nf 1 1 1\n", 2, 'expected a number, got "zero"'),
        ("v 0 0 0\nv nan 0 0\nf 1 1 1\n", 2, "is not finite"),
        ("v 0 0 0\nv 0 inf 0\nf 1 1 1\n", 2, "is not finite"),
        ("v 0 0 0\nv 0 0 0\nf 1 2\n", 3, "at least 3 corners"),
        ("v 0 0 0\nf 1 1 2\n", 2, "there is no v 2"),
        ("v 0 0 0\nf 1 1 0\n", 2, "there is no v 0"),
        ("v 0 0 0\nf -1 -1 -2\nv 0 0 0\n", 2, "there is no v -2"),
        ("v 0 0 0\nf 1/1 1/1 1/1\n", 2, "there is no vt 1"),
        ("v 0 0 0\nf 1//1 1//1 1//1\n", 2, "there is no vn 1"),
        ("v 0 0 0\nf 1 1 a\n", 2, "not of the form"),
        ("v 0 0 0\nf 1 1 1/1/1/1\n", 2, "not of the form"),
        ("v 0 0 0\n", None, "no faces"),
    ],
)
def test_broken_obj(tmp_path: Path, text: str, line: int | None, message: str) -> None:
    with pytest.raises(SceneError, match=message.replace("(", "\\(")) as caught:
        load(obj(tmp_path, text))
    assert caught.value.line == line
    assert caught.value.file is not None


def test_mtl(tmp_path: Path) -> None:
    (tmp_path / "m.mtl").write_text(
        "newmtl red\nKd 1 0 0\nKs 0 0 0\nNs 10\nillum 2\n"
        "newmtl lamp\nKd 0.5 0.5 0.5\nKe 3 2 1\n"
        "newmtl glass\nKd 0.1 0.1 0.1\nillum 7\nNi 1.5\nmap_Kd nowhere.png\n"
    )
    quad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    faces = "usemtl red\nf 1 2 3\nusemtl lamp\nf 1 2 3\nusemtl glass\nf 1 3 4\nusemtl other\nf 1 3 4\n"
    scene = load(obj(tmp_path, f"mtllib models/m.mtl\n{quad}{faces}"))
    sides = [material.bsdf.front for material in scene.materials[:2] if isinstance(material.bsdf, TwoSided)]
    assert [side.reflectance for side in sides if isinstance(side, Diffuse)] == [(1, 0, 0), (0.5, 0.5, 0.5)]
    assert isinstance(scene.materials[2].bsdf, Dielectric)
    assert [mesh.emission for mesh in scene.meshes] == [None, (3, 2, 1), None, None]
    text = "\n".join(scene.warnings)
    assert 'texture "nowhere.png"' in text
    assert 'material "other" is in no library' in text
    assert '"red"' not in text


def test_broken_mtl(tmp_path: Path) -> None:
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 1 0\n")
    with pytest.raises(SceneError, match=r'm\.mtl:2: "Kd" must be 1 or 3 numbers'):
        load(obj(tmp_path, "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"))


PLY_HEADER = (
    "ply\nformat {} 1.0\ncomment made by a test\nelement vertex 4\nproperty {t} x\nproperty {t} y\nproperty {t} z\n"
    "property {t} nx\nproperty {t} ny\nproperty {t} nz\nproperty {t} s\nproperty {t} t\n"
    "element face 2\nproperty uchar red\nproperty list uchar int vertex_indices\n"
    "element edge 1\nproperty int a\nend_header\n"
)
ROWS = [(0, 0, 0, 0, 0, 1, 0, 0), (1, 0, 0, 0, 0, 1, 1, 0), (1, 1, 0, 0, 0, 1, 1, 1), (0, 1, 0, 0, 0, 1, 0, 1)]


def ply_bytes(order: str, real: str) -> bytes:
    """A quadrilateral and a triangle over the same four vertices."""
    names = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}
    header = PLY_HEADER.format(names[order], t={"f": "float", "d": "double"}[real]).encode()
    if order == "":
        rows = "\n".join(" ".join(map(str, row)) for row in ROWS)
        return header + f"{rows}\n7 4 0 1 2 3\n7 3 0 1 2\n5\n".encode()
    body = b"".join(struct.pack(f"{order}8{real}", *row) for row in ROWS)
    return header + body + struct.pack(f"{order}BB4iBB3ii", 7, 4, 0, 1, 2, 3, 7, 3, 0, 1, 2, 5)


def test_lists_of_vertices_are_no_empty_mesh(tmp_path: Path) -> None:
    file = tmp_path / "m.ply"
    file.write_bytes(ply_bytes("", "f").replace(b"element face", b"property list uchar int junk\nelement face"))
    with pytest.raises(SceneError, match=r"m\.ply: its vertices have lists \(property list\), which are not read"):
        read_ply(file)


@pytest.mark.parametrize("order", ["<", ">", ""])
@pytest.mark.parametrize("real", ["f", "d"])
def test_ply(tmp_path: Path, order: str, real: str) -> None:
    file = tmp_path / "m.ply"
    file.write_bytes(ply_bytes(order, real))
    mesh = read_ply(file)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]
    assert mesh.normals is not None
    assert mesh.uvs is not None
    np.testing.assert_array_equal(mesh.uvs, [row[6:] for row in ROWS])


@pytest.mark.parametrize("order", ["<", ""])
def test_truncated_ply(tmp_path: Path, order: str) -> None:
    """A file cut anywhere inside vertices or faces is one clear error."""
    data = ply_bytes(order, "f")
    file = tmp_path / "m.ply"
    begin = data.index(b"end_header") + len("end_header\n")
    for end in range(len(b"ply"), len(data) - 6, 3):
        file.write_bytes(data[:end])
        with pytest.raises(SceneError, match="truncated|end_header|not a number" if end >= begin else "end_header"):
            read_ply(file)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"ply\n", b"plx\n", "not a PLY file"),
        (b"format ascii", b"format morse", "header line not understood"),
        (b"property list uchar int", b"property list float int", "property not understood"),
        (b"\n7 3 0 1 2", b"\n7 3 0 1 9", "names vertex 9"),
        (b"\n7 3 0 1 2", b"\n7 2 0 1", "has 2 corners"),
        (b"element vertex 4", b"element vertex 0", "not a whole number|no vertices|names vertex"),
        (b"0 1 0 0 0 1 0 1\n", b"0 nan 0 0 0 1 0 1\n", "vertex 3 is .0, nan, 0., 1 not finite"),
        (b"element face", b"element tristrips", r"in strips \(tristrips\), which are not read"),
    ],
)
def test_broken_ply(tmp_path: Path, old: bytes, new: bytes, message: str) -> None:
    file = tmp_path / "m.ply"
    file.write_bytes(ply_bytes("", "f").replace(old, new, 1))
    with pytest.raises(SceneError, match=message):
        load(file)


def stl_bytes(triangles: np.ndarray) -> bytes:
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in triangles)
    return b"solid but binary".ljust(80) + struct.pack("<I", len(triangles)) + rows


def test_stl(tmp_path: Path) -> None:
    triangles = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1], [0, 1, 1], [1, 0, 1]]], dtype=np.float64)
    file = tmp_path / "m.stl"
    file.write_bytes(stl_bytes(triangles))
    mesh = read_stl(file)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], triangles)
    facets = "".join(
        "facet normal 0 0 0\n outer loop\n"
        + "".join(f"  vertex {x} {y} {z}\n" for x, y, z in triangle)
        + " endloop\nendfacet\n"
        for triangle in triangles
    )
    file.write_text(f"solid a\n{facets}endsolid a\n")
    mesh = read_stl(file)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], triangles)


def test_broken_stl(tmp_path: Path) -> None:
    file = tmp_path / "m.stl"
    whole = stl_bytes(np.zeros((3, 3, 3)))
    for data, message in (
        (whole[:-7], "announces 3 facets, but ends after 2"),
        (b"no", "too short"),
        (b"solid a\nfacet\nvertex 0 0 0\nendfacet\n", "a facet has 1 vertices"),
        (b"solid a\nfacet\nvertex 0 zero 0\n", '"vertex" needs 3 numbers'),
        (b"solid a\nendsolid\n", "no facets"),
    ):
        file.write_bytes(data.replace(b"solid but", b"binary so") if data is not whole else data)
        with pytest.raises(SceneError, match=message):
            read_stl(file)


def test_off(tmp_path: Path) -> None:
    file = tmp_path / "m.off"
    file.write_text("OFF\n# a square\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n")
    mesh = read_off(file)
    assert len(mesh.faces) == 2
    p = mesh.vertices[mesh.faces]
    assert np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])[:, 2].sum() == 2.0  # twice the area, all facing up


@pytest.mark.parametrize("full", ["255", "1.0"])
def test_colours_of_an_off_file(tmp_path: Path, full: str) -> None:
    file = tmp_path / "m.off"
    rows = [f"0 0 0 {full} 0 0 {full}", f"1 0 0 0 {full} 0 {full}", f"1 1 0 0 0 {full} {full}"]
    file.write_text("COFF\n3 1 0\n" + "\n".join(rows) + "\n3 0 1 2\n")
    scene = load(file)
    np.testing.assert_allclose(scene.meshes[0].colors, np.eye(3))
    assert not any("colour" in warning for warning in scene.warnings)
    file.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2 255 0 0\n")
    assert any("colours of faces are ignored" in warning for warning in load(file).warnings)


def test_bytes_of_any_encoding_in_an_off_file(tmp_path: Path) -> None:
    """In comments they say nothing; anywhere else they are no numbers."""
    file = tmp_path / "m.off"
    file.write_bytes(b"OFF\n# W\xfcrfel\n3 1 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n")
    assert len(read_off(file).faces) == 1
    file.write_bytes(b"OFF\n3 1 0\n0 0 \xfc\n1 0 0\n1 1 0\n3 0 1 2\n")
    with pytest.raises(SceneError, match="not an OFF file, or truncated"):
        read_off(file)


@pytest.mark.parametrize(
    "text",
    [
        "OFF\n4 1 0\n0 0 0\n1 0 0\n",
        "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n",
        "OFF 3 2 0\n0 0 0\n1 0 0\n0 1 0\n\n3 0 1 2 # one of two\n",
        "OFF\n0 0 0\n",
        "nothing of the kind",
        "",
    ],
    ids=["truncated", "index out of range", "a face is missing", "empty", "no OFF", "no bytes"],
)
def test_broken_off(tmp_path: Path, text: str) -> None:
    file = tmp_path / "m.off"
    file.write_text(text)
    with pytest.raises(SceneError, match=r"m\.off"):
        read_off(file)


def serialized_bytes(version: int, real: str, meshes: int = 2, vertex_count: int | None = None) -> bytes:
    flags = (0x1000 if real == "f" else 0x2000) | 0x1 | 0x2
    data, offsets = b"", []
    for number in range(meshes):
        offsets.append(len(data))
        vertices = np.array([[0, 0, number], [1, 0, number], [0, 1, number]], dtype={"f": "<f4", "d": "<f8"}[real])
        normals = np.tile([0, 0, 1], (3, 1))
        uvs = vertices[:, :2]
        body = struct.pack("<I", flags) + (b"name\0" if version == 4 else b"")
        body += struct.pack("<QQ", vertex_count or 3, 1) + vertices.tobytes() + normals.astype(vertices.dtype).tobytes()
        body += uvs.tobytes() + struct.pack("<3I", 0, 1, 2)
        data += struct.pack("<HH", 0x041C, version) + zlib.compress(body)
    code = "Q" if version == 4 else "I"
    return data + struct.pack(f"<{meshes}{code}I", *offsets, meshes)


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize("real", ["f", "d"])
def test_serialized_round_trip(tmp_path: Path, version: int, real: str) -> None:
    file = tmp_path / "m.serialized"
    file.write_bytes(serialized_bytes(version, real))
    for number in range(2):
        mesh = read_serialized(file, number)
        np.testing.assert_array_equal(mesh.vertices, [[0, 0, number], [1, 0, number], [0, 1, number]])
        np.testing.assert_array_equal(mesh.normals, [[0, 0, 1]] * 3)
        np.testing.assert_array_equal(mesh.uvs, [[0, 0], [1, 0], [0, 1]])
    with pytest.raises(SceneError, match="there is no mesh 2: the file has 2"):
        read_serialized(file, 2)


def test_broken_serialized(tmp_path: Path) -> None:
    file = tmp_path / "m.serialized"
    whole = serialized_bytes(4, "f", meshes=1)
    for data, message in (
        (b"", "too short"),
        (b"abcdefgh", "not a serialized mesh file"),
        (whole[:-3], "truncated|broken"),
        (serialized_bytes(4, "f", 1, vertex_count=1 << 60), "announces"),
        (serialized_bytes(4, "f", 1, vertex_count=40), "ends too early"),
        (whole[:20] + b"\xff\xff\xff" + whole[23:], "broken compressed data|ends too early|neither|names vertex"),
    ):
        file.write_bytes(data)
        with pytest.raises(SceneError, match=message):
            read_serialized(file, 0)


@given(st.lists(st.integers(3, 9), min_size=1, max_size=20))
def test_fans_have_n_minus_2_triangles_and_begin_at_the_first_corner(counts: list[int]) -> None:
    corners, polygon = triangulate_fans(np.array(counts))
    starts = np.concatenate([[0], np.cumsum(counts)])
    assert len(corners) == sum(counts) - 2 * len(counts)
    np.testing.assert_array_equal(corners[:, 0], starts[polygon])
    assert (corners < starts[polygon + 1][:, None]).all()
    assert (np.diff(corners, axis=1) > 0).all()


@given(st.lists(st.tuples(st.integers(-1, 5), st.integers(-1, 5), st.integers(0, 1 << 40)), min_size=1, max_size=40))
def test_merged_corners_are_equal_exactly_where_their_indices_are(rows: list[tuple[int, int, int]]) -> None:
    table = np.array(rows, dtype=np.int64)
    first, vertex = merge_corners(table[:, 0], table[:, 1], table[:, 2])
    np.testing.assert_array_equal(table[first][vertex], table)
    assert len(first) == len(set(rows))
    assert (np.diff(first) > 0).all()


@pytest.mark.shared
def test_mcguires_cornell_box_has_its_area(scenes_dir: Path) -> None:
    mesh = read_obj(scenes_dir / "mcguire-cornell" / "CornellBox-Original.obj").mesh
    assert area(mesh) == pytest.approx(26.55, abs=0.01)


@pytest.mark.shared
def test_hard_meshes_load_or_say_why(scenes_dir: Path) -> None:
    read = (".obj", ".ply", ".stl", ".glb", ".off")
    files = [f for f in (scenes_dir / "hard-meshes").rglob("*") if f.suffix.lower() in read]
    assert len(files) > 20
    for file in files:
        with contextlib.suppress(SceneError):  # anything else, a crash, fails the test
            assert len(flatten(load(file)).triangles) > 0
