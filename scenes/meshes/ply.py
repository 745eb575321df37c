"""Reads PLY files: ASCII and binary, either byte order.

Format: Greg Turk, "The PLY Polygon File Format", 1994. Polygons are cut into fans. Elements that are not
geometry are skipped; properties of vertices and of faces that are not become attributes.

Read by hand: trimesh (5.2) takes faces that name vertices which do not exist, and of a file that ends too early what
there is, without a word.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.mapped import FileBytes, map_file
from wdpm.scenes.meshes.mesh_data import MeshData, VertexAttribute
from wdpm.scenes.meshes.ply_bodies import AsciiBody, BinaryBody, ElementKind, Property, Table
from wdpm.scenes.meshes.polygons.cutting import triangulate
from wdpm.scenes.meshes.vertex_attributes import grouped, named_attributes

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_UV_NAMES = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"))
_CORNER_NAMES = ("vertex_indices", "vertex_index")


def read_ply(file: Path) -> MeshData:
    """The triangles of a PLY file.

    Raises:
        SceneError: not a PLY file, broken or truncated, without vertices or faces, an index out of range.
    """
    try:
        data = map_file(file)
    except OSError as error:
        raise SceneError(f"cannot be read: {error.strerror}", file) from error
    order, kinds, body = _read_header(data, file)
    reader = AsciiBody(data[body:], file) if order == "" else BinaryBody(data, body, order, file)
    columns: dict[str, Table] = {}
    whole: dict[str, int] = {}
    polygons: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None
    of_faces: dict[str, VertexAttribute] = {}
    for kind in kinds:
        if kind.name == "vertex" and kind.has_lists:
            raise SceneError("its vertices have lists (property list), which are not read: save it without them", file)
        if kind.has_lists:
            begin = reader.position
            found = reader.read_lists(kind, _CORNER_NAMES if kind.name == "face" else ())
            if kind.name == "face":
                polygons = found
                of_faces = _face_attributes(reader, begin, kind, found[0])
        else:
            columns[kind.name] = reader.read_table(kind)
        if kind.name == "vertex":
            whole = _whole(kind)
    if polygons is None and any(kind.name == "tristrips" for kind in kinds):
        raise SceneError("its triangles are in strips (tristrips), which are not read: save them as faces", file)
    return _assemble(columns.get("vertex"), whole, polygons, of_faces, file)


def _whole(kind: ElementKind) -> dict[str, int]:
    """The largest value of each property that is a whole number."""
    return {p.name: int(np.iinfo(p.dtype).max) for p in kind.properties if p.dtype[0] in "iu"}


def _face_attributes(
    reader: AsciiBody | BinaryBody, begin: int, kind: ElementKind, counts: NDArray[np.int64]
) -> dict[str, VertexAttribute]:
    """What a file says of its polygons besides their corners; nothing where these are not all of as many corners.

    Args:
        begin: where the element begins: of the file's bytes, or of the words of its text.
        counts: corners of each.
    """
    single = [p.name for p in kind.properties if p.count_dtype is None]
    lists = len(kind.properties) - len(single)
    if not grouped(single, "face") or lists != 1 or not len(counts) or counts.min() != counts.max():
        return {}
    corners = int(counts[0])
    if isinstance(reader, BinaryBody):
        columns = _binary_columns(reader, begin, kind, corners)
    else:
        columns = _ascii_columns(reader, begin, kind, corners)
    return named_attributes(columns, _whole(kind), "face")


def _binary_columns(reader: BinaryBody, begin: int, kind: ElementKind, corners: int) -> dict[str, NDArray[np.float64]]:
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    for p in kind.properties:
        if p.count_dtype is None:
            fields.append((p.name, reader.order + p.dtype))
        else:
            fields += [("corners", reader.order + p.count_dtype), (p.name, reader.order + p.dtype, (corners,))]
    table = np.frombuffer(reader.data, np.dtype(fields), kind.count, begin)
    return {p.name: table[p.name].astype(np.float64) for p in kind.properties if p.count_dtype is None}


def _ascii_columns(reader: AsciiBody, begin: int, kind: ElementKind, corners: int) -> dict[str, NDArray[np.float64]]:
    columns: dict[str, NDArray[np.float64]] = {}
    width = len(kind.properties) + corners
    place = begin
    for p in kind.properties:
        if p.count_dtype is not None:
            place += 1 + corners
            continue
        words = slice(place, begin + width * kind.count, width)
        ends = zip(reader.begin[words].tolist(), reader.end[words].tolist(), strict=True)
        columns[p.name] = np.array([float(reader.data[first:last].tobytes()) for first, last in ends])
        place += 1
    return columns


def _read_header(data: FileBytes, file: Path) -> tuple[str, list[ElementKind], int]:
    if data[:3] != b"ply":
        raise SceneError('not a PLY file: it does not begin with "ply"', file, 1)
    order: str | None = None
    kinds: list[ElementKind] = []
    position = 0
    number = 0
    while True:
        end = data.find(b"\n", position)
        if end < 0:
            raise SceneError('the header has no "end_header"', file, number + 1)
        number += 1
        words = data[position:end].decode("latin-1").split()
        position = end + 1
        match words:
            case ["end_header"]:
                if order is None:
                    raise SceneError('the header has no "format" line', file, number)
                return order, kinds, position
            case ["format", name, _] if name in _BYTE_ORDERS:
                order = _BYTE_ORDERS[name]
            case ["element", name, count] if count.isdecimal():
                kinds.append(ElementKind(name, int(count), ()))
            case ["property", *description] if kinds:
                last = kinds[-1]
                properties = (*last.properties, _read_property(description, file, number))
                kinds[-1] = ElementKind(last.name, last.count, properties)
            case [] | ["ply" | "comment" | "obj_info", *_]:
                pass
            case _:
                raise SceneError(f'header line not understood: "{" ".join(words)[:60]}"', file, number)


def _read_property(words: list[str], file: Path, line: int) -> Property:
    match words:
        case ["list", count, item, name] if _TYPES.get(count, "f")[0] in "iu" and item in _TYPES:
            return Property(name, _TYPES[item], _TYPES[count])
        case [item, name] if item in _TYPES:
            return Property(name, _TYPES[item], None)
    raise SceneError(f'property not understood: "{" ".join(words)[:60]}"', file, line)


def _assemble(
    columns: Table | None,
    whole: dict[str, int],
    polygons: tuple[NDArray[np.int64], NDArray[np.int64]] | None,
    of_faces: dict[str, VertexAttribute],
    file: Path,
) -> MeshData:
    vertices = None if columns is None else columns.together(("x", "y", "z"))
    if columns is None or vertices is None or len(vertices) == 0:
        raise SceneError("the mesh is empty: no vertices with x, y and z", file)
    if polygons is None or len(polygons[0]) == 0:
        raise SceneError("the mesh is empty: no faces", file)
    counts, corners = polygons
    if counts.min() < 3:
        face = int(np.argmax(counts < 3))
        raise SceneError(f"face {face} has {counts[face]} corners; expected at least 3", file)
    if not 0 <= corners.min() <= corners.max() < len(vertices):
        index = int(corners[np.argmax((corners < 0) | (corners >= len(vertices)))])
        raise SceneError(f"a face names vertex {index}, but there are {len(vertices)}", file)
    faces = corners.reshape(-1, 3) if counts.max() == 3 else corners[triangulate(counts, corners, vertices)[0]]
    uvs = next((found for names in _UV_NAMES if (found := columns.together(names)) is not None), None)
    normals = columns.together(("nx", "ny", "nz"))
    if of_faces and counts.max() > 3:
        triangles = np.repeat(np.arange(len(counts)), counts - 2)
        of_faces = {name: VertexAttribute(a.values[triangles], a.coded) for name, a in of_faces.items()}
    return MeshData(vertices, faces, normals, uvs, named_attributes(columns, whole), of_faces)
