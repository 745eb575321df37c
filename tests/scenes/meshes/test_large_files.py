"""Files are read by whole arrays: what that finds is what reading line by line finds, and it needs little memory."""

from __future__ import annotations

import json
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wdpm.scenes import SceneError
from wdpm.scenes.gltf.read import read_gltf
from wdpm.scenes.meshes.mesh_data import MeshData, merge_corners
from wdpm.scenes.meshes.obj import read_by_lines, read_obj
from wdpm.scenes.meshes.obj_file import ObjFile
from wdpm.scenes.meshes.obj_plain import read_plain_obj
from wdpm.scenes.meshes.ply import read_ply
from wdpm.scenes.meshes.several import at_numbers
from wdpm.scenes.model.scene import Mesh

SIDE = 300  # vertices along a side of the grid of the memory tests: 90,000


def assert_same_mesh(first: MeshData, second: MeshData) -> None:
    for name in ("vertices", "faces", "normals", "uvs"):
        one, other = getattr(first, name), getattr(second, name)
        assert (one is None) == (other is None), name
        if one is not None:
            assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes()), name
    assert list(first.attributes) == list(second.attributes)
    for name, attribute in first.attributes.items():
        assert np.array_equal(attribute.values, second.attributes[name].values), name


def assert_same(first: ObjFile, second: ObjFile) -> None:
    assert_same_mesh(first.mesh, second.mesh)
    assert first.face_material.tolist() == second.face_material.tolist()
    assert (first.materials, first.libraries, first.warnings) == (second.materials, second.libraries, second.warnings)
    assert first.partly_colored == second.partly_colored


number = st.floats(-1e6, 1e6).map(lambda x: f"{x:.6f}") | st.sampled_from(["0", "-1", "1e-5", "3.25", ".5"])


def vertex_line(word: str, least: int, most: int) -> st.SearchStrategy[str]:
    return st.lists(number, min_size=least, max_size=most).map(lambda row: " ".join([word, *row]))


COUNT = 6  # of each kind of vertex at the begin of a file, so that faces have something to name
index = st.integers(-COUNT, COUNT).filter(bool).map(str)
corner = st.one_of(
    index,
    st.tuples(index, index).map("/".join),
    st.tuples(index, index).map("//".join),
    st.tuples(index, index, index).map("/".join),
)
line = st.one_of(
    vertex_line("v", 3, 6),
    vertex_line("vt", 1, 3),
    vertex_line("vn", 3, 3),
    st.lists(corner, min_size=3, max_size=5).map(lambda row: " ".join(["f", *row])),
    st.lists(index, min_size=3, max_size=3).map(lambda row: " ".join(["f", *row])),
    st.sampled_from(
        ["", "# a/b 1.5", "usemtl red", "usemtl blue/1", "g x", "s off", "mtllib a.mtl", "what 1", "  f  1 2   3 "]
    ),
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(st.lists(line, max_size=60), st.sampled_from([40, 200, 1 << 18]), st.sampled_from(["\n", "\r\n"]))
def test_by_arrays_as_by_lines(tmp_path: Path, lines: list[str], piece: int, end: str) -> None:
    head = [f"{word} {i}.5 {i} {i * i}" for word in ("v", "vt", "vn") for i in range(COUNT)]
    (tmp_path / "m.obj").write_bytes(end.join([*head, *lines, "f 1 2 3"]).encode())
    plain = read_plain_obj(tmp_path / "m.obj", piece)
    assert plain is not None
    assert_same(plain, read_by_lines(tmp_path / "m.obj"))


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    "text",
    [
        TRIANGLE + "f 1 2 \\\n3\n",
        TRIANGLE + "f 1 2 3 # the only one\n",
        TRIANGLE + "fo 1 2 3\n",
        TRIANGLE + "v 1 1 1 red green blue\nf 1 2 3\n",
    ],
)
def test_what_few_programs_write_is_read_by_lines(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.obj").write_text(text)
    assert read_plain_obj(tmp_path / "m.obj") is None
    assert len(read_obj(tmp_path / "m.obj").mesh.faces) == 1


def test_mistakes_far_down_are_found_in_their_lines(tmp_path: Path) -> None:
    many = TRIANGLE + "f 1 2 3\n" * 300
    for text, message in (
        (many + "f 1 2 4\n", r"m\.obj:304: .*there is no v 4"),
        (many + "v 1 2 x\n", r"m\.obj:304: .*expected a number"),
        (many + "v 1 2 nan\n", r"m\.obj:304: .*not finite"),
        (many + "f 1 2\n", r"m\.obj:304: .*at least 3 corners"),
    ):
        (tmp_path / "m.obj").write_text(text)
        with pytest.raises(SceneError, match=message):
            read_obj(tmp_path / "m.obj")


@given(st.lists(st.integers(0, 5), min_size=1, max_size=60), st.integers(1, 4), st.integers(0, 2**31))
def test_corners_are_merged_in_the_order_of_their_first(keys: list[int], kinds: int, seed: int) -> None:
    key = np.array(keys)
    other = np.random.default_rng(seed).integers(-1, 30 * kinds, len(key))
    first, vertex = merge_corners(key, other, key)
    pairs = list(zip(key.tolist(), other.tolist(), strict=True))
    distinct = list(dict.fromkeys(pairs))
    assert [pairs[i] for i in first] == distinct
    assert [distinct[i] for i in vertex] == pairs


def grid() -> tuple[np.ndarray, np.ndarray]:
    """Vertices of a bumpy square, float32, and its triangles."""
    x, y = np.meshgrid(np.linspace(0, 1, SIDE), np.linspace(0, 1, SIDE), indexing="ij")
    vertices = np.stack([x, y, 0.1 * np.sin(30 * x) * np.cos(20 * y)], -1).reshape(-1, 3).astype("<f4")
    i = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def write_ply(file: Path) -> None:
    vertices, faces = grid()
    rows = np.zeros(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    file.write_bytes(head.encode() + vertices.tobytes() + rows.tobytes())


def write_glb(file: Path) -> None:
    vertices, faces = grid()
    parts = [vertices.tobytes(), faces.astype("<u4").tobytes()]
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": len(parts[0])},
        {"buffer": 0, "byteOffset": len(parts[0]), "byteLength": len(parts[1])},
    ]
    document = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": sum(map(len, parts))}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    body += struct.pack("<II", sum(map(len, parts)), 0x004E4942) + b"".join(parts)
    file.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body)


def write_obj(file: Path) -> None:
    vertices, faces = grid()
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    file.write_text("\n".join(lines))


def plain_obj(file: Path) -> MeshData:
    found = read_plain_obj(file, 1 << 14)
    assert found is not None
    return found.mesh


def gltf_mesh(file: Path) -> Mesh:
    mesh = read_gltf(file).meshes[0]
    assert isinstance(mesh, Mesh)
    return mesh


@pytest.mark.parametrize(
    ("name", "write", "read", "most"),
    [
        ("m.ply", write_ply, read_ply, 1.2),
        ("m.obj", write_obj, plain_obj, 1.75),  # and the material of each triangle
    ],
)
def test_reading_takes_little_more_than_what_is_read(
    tmp_path: Path, name: str, write: Callable[[Path], None], read: Callable[[Path], MeshData], most: float
) -> None:
    write(tmp_path / name)
    tracemalloc.start()
    try:
        mesh = read(tmp_path / name)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    vertices, faces = grid()
    assert np.array_equal(mesh.faces, faces) or name == "m.obj"
    assert np.abs(mesh.vertices[mesh.faces] - vertices[faces]).max() < 1e-6
    assert peak <= most * (mesh.vertices.nbytes + mesh.faces.nbytes)


def test_gltf_is_read_from_the_mapped_file(tmp_path: Path) -> None:
    write_glb(tmp_path / "m.glb")
    mesh = gltf_mesh(tmp_path / "m.glb")
    vertices, faces = grid()
    assert np.array_equal(mesh.faces, faces)
    assert np.array_equal(mesh.vertices, vertices.astype(np.float64))


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("count_type", ["uchar", "int"])
def test_polygons_of_all_lengths(tmp_path: Path, order: str, count_type: str) -> None:
    rng = np.random.default_rng(3)
    polygons = [rng.integers(0, 9, rng.integers(3, 7)) for _ in range(500)]
    head = (
        f"ply\nformat {order} 1.0\nelement vertex 9\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(polygons)}\nproperty list {count_type} short vertex_indices\nend_header\n"
    )
    if order == "ascii":
        rows = [f"{i} {i} 1" for i in range(9)] + [" ".join(map(str, [len(p), *p])) for p in polygons]
        body = "\n".join(rows).encode()
    else:
        sign = "<" if order == "binary_little_endian" else ">"
        body = b"".join(struct.pack(sign + "3f", i, i, 1) for i in range(9))
        count = {"uchar": "B", "int": "i"}[count_type]
        body += b"".join(struct.pack(f"{sign}{count}{len(p)}h", len(p), *p) for p in polygons)
    (tmp_path / "m.ply").write_bytes(head.encode() + body)
    expected = [(p[0], p[i], p[i + 1]) for p in polygons for i in range(1, len(p) - 1)]
    assert read_ply(tmp_path / "m.ply").faces.tolist() == [list(map(int, row)) for row in expected]
    (tmp_path / "m.ply").write_bytes(head.encode() + body[:-3])
    with pytest.raises(SceneError, match="truncated"):
        read_ply(tmp_path / "m.ply")


def test_a_single_column_is_merged_in_order_of_first_appearance() -> None:
    key = np.random.default_rng(7).integers(0, 90_000, 300_000).astype(np.int32)  # several blocks, in threads
    first, vertex = merge_corners(key, key)
    keys, firsts = np.unique(key, return_index=True)
    assert np.array_equal(first, np.sort(firsts))
    assert np.array_equal(key[first][vertex], key)
    assert len(first) == len(keys)
    assert vertex.dtype == np.int32


def test_rows_are_taken_by_number_in_threads() -> None:
    values = np.arange(3000.0).reshape(-1, 3)
    numbers = np.random.default_rng(8).integers(-1, 1000, 300_000).astype(np.int32)
    assert np.array_equal(at_numbers(values, numbers), values[np.maximum(numbers, 0)])
    assert np.array_equal(at_numbers(values, numbers[:9000]), values[np.maximum(numbers[:9000], 0)])
