"""Reads PLY files: ASCII and binary, either byte order.

Format: Greg Turk, "The PLY Polygon File Format", 1994. Polygons are cut into fans. Elements that are not
geometry are skipped; properties of vertices that are not become attributes.

Read by hand: trimesh (5.2) takes faces that name vertices which do not exist, and of a file that ends too early what
there is, without a word.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.mesh_data import MeshData, triangulate_fans
from wdpm.scenes.meshes.vertex_attributes import named_attributes

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


@dataclass(frozen=True)
class _Property:
    name: str
    dtype: str
    count_dtype: str | None  # of a list's length; None for a single value


@dataclass(frozen=True)
class _ElementKind:
    name: str
    count: int
    properties: tuple[_Property, ...]

    @property
    def has_lists(self) -> bool:
        return any(prop.count_dtype is not None for prop in self.properties)


def read_ply(file: Path) -> MeshData:
    """The triangles of a PLY file.

    Raises:
        SceneError: not a PLY file, broken or truncated, without vertices or faces, an index out of range.
    """
    try:
        data = file.read_bytes()
    except OSError as error:
        raise SceneError(f"cannot be read: {error.strerror}", file) from error
    order, kinds, body = _read_header(data, file)
    reader = _AsciiBody(data[body:], file) if order == "" else _BinaryBody(data[body:], order, file)
    columns: dict[str, dict[str, NDArray[np.float64]]] = {}
    whole: dict[str, int] = {}
    polygons: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None
    for kind in kinds:
        if kind.has_lists:
            found = reader.read_lists(kind, _CORNER_NAMES if kind.name == "face" else ())
            polygons = found if kind.name == "face" else polygons
        else:
            columns[kind.name] = reader.read_table(kind)
        if kind.name == "vertex":
            whole = {p.name: int(np.iinfo(p.dtype).max) for p in kind.properties if p.dtype[0] in "iu"}
    return _assemble(columns.get("vertex"), whole, polygons, file)


def _read_header(data: bytes, file: Path) -> tuple[str, list[_ElementKind], int]:
    if not data.startswith(b"ply"):
        raise SceneError('not a PLY file: it does not begin with "ply"', file, 1)
    order: str | None = None
    kinds: list[_ElementKind] = []
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
                kinds.append(_ElementKind(name, int(count), ()))
            case ["property", *description] if kinds:
                last = kinds[-1]
                properties = (*last.properties, _read_property(description, file, number))
                kinds[-1] = _ElementKind(last.name, last.count, properties)
            case [] | ["ply" | "comment" | "obj_info", *_]:
                pass
            case _:
                raise SceneError(f'header line not understood: "{" ".join(words)[:60]}"', file, number)


def _read_property(words: list[str], file: Path, line: int) -> _Property:
    match words:
        case ["list", count, item, name] if _TYPES.get(count, "f")[0] in "iu" and item in _TYPES:
            return _Property(name, _TYPES[item], _TYPES[count])
        case [item, name] if item in _TYPES:
            return _Property(name, _TYPES[item], None)
    raise SceneError(f'property not understood: "{" ".join(words)[:60]}"', file, line)


class _BinaryBody:
    def __init__(self, data: bytes, order: str, file: Path) -> None:
        self.data = data
        self.order = order
        self.file = file
        self.position = 0

    def _truncated(self, kind: _ElementKind) -> SceneError:
        return SceneError(f'the file ends within its {kind.count} elements "{kind.name}": it is truncated', self.file)

    def _need(self, size: int, kind: _ElementKind) -> None:
        if self.position + size > len(self.data):
            raise self._truncated(kind)

    def read_table(self, kind: _ElementKind) -> dict[str, NDArray[np.float64]]:
        fields = [(f"{i}", self.order + prop.dtype) for i, prop in enumerate(kind.properties)]
        row = np.dtype(fields)
        self._need(row.itemsize * kind.count, kind)
        table = np.frombuffer(self.data, row, kind.count, self.position)
        self.position += row.itemsize * kind.count
        return {prop.name: table[f"{i}"].astype(np.float64) for i, prop in enumerate(kind.properties)}

    def read_lists(self, kind: _ElementKind, wanted: tuple[str, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Lengths of the wanted lists, shape [count], and their items one after another."""
        lengths: list[NDArray[np.int64]] = []
        items: list[NDArray[np.int64]] = []
        row = 0
        while row < kind.count:
            run_lengths, run_items, rows = self._read_run(kind, wanted, kind.count - row)
            lengths.append(run_lengths)
            items.append(run_items)
            row += rows
        empty = np.zeros(0, dtype=np.int64)
        return np.concatenate([empty, *lengths]), np.concatenate([empty, *items])

    def _read_run(
        self, kind: _ElementKind, wanted: tuple[str, ...], rows_left: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
        """Reads the rows whose lists are as long as those of the next row; meshes are nearly always one such run."""
        row, sizes = self._row_like_next(kind)
        rows = min(rows_left, (len(self.data) - self.position) // row.itemsize)
        if rows == 0:
            raise self._truncated(kind)
        table = np.frombuffer(self.data, row, rows, self.position)
        alike = np.ones(rows, dtype=np.bool_)
        for index, size in sizes.items():
            alike &= table[f"n{index}"] == size
        if not alike.all():
            rows = int(np.argmin(alike))
            table = table[:rows]
        self.position += rows * row.itemsize
        for index, prop in enumerate(kind.properties):
            if prop.name in wanted:
                corners = table[f"{index}"].astype(np.int64).reshape(-1)
                return np.full(rows, sizes[index], dtype=np.int64), corners, rows
        return np.zeros(rows, dtype=np.int64), np.zeros(0, dtype=np.int64), rows

    def _row_like_next(self, kind: _ElementKind) -> tuple[np.dtype[np.void], dict[int, int]]:
        fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        sizes: dict[int, int] = {}
        offset = self.position
        for index, prop in enumerate(kind.properties):
            dtype = np.dtype(self.order + prop.dtype)
            length = 1
            if prop.count_dtype is not None:
                count_dtype = np.dtype(self.order + prop.count_dtype)
                if offset + count_dtype.itemsize > len(self.data):
                    raise self._truncated(kind)
                length = int(np.frombuffer(self.data, count_dtype, 1, offset)[0])
                if length < 0:
                    raise SceneError(f'element "{kind.name}" has a list of negative length', self.file)
                if offset + length * dtype.itemsize > len(self.data):
                    raise self._truncated(kind)
                sizes[index] = length
                fields.append((f"n{index}", count_dtype.str))
                offset += count_dtype.itemsize
            fields.append((f"{index}", dtype.str, (length,)))
            offset += length * dtype.itemsize
        return np.dtype(fields), sizes


class _AsciiBody:
    def __init__(self, data: bytes, file: Path) -> None:
        self.file = file
        self.tokens = data.split()
        self.position = 0

    def _take(self, count: int, kind: _ElementKind) -> list[bytes]:
        if self.position + count > len(self.tokens):
            message = f'the file ends within its {kind.count} elements "{kind.name}": it is truncated'
            raise SceneError(message, self.file)
        taken = self.tokens[self.position : self.position + count]
        self.position += count
        return taken

    def read_table(self, kind: _ElementKind) -> dict[str, NDArray[np.float64]]:
        width = len(kind.properties)
        tokens = self._take(width * kind.count, kind)
        try:
            values = np.array(tokens, dtype=np.bytes_).astype(np.float64).reshape(kind.count, width)
        except ValueError as error:
            raise SceneError(f'a value of element "{kind.name}" is not a number: {error}', self.file) from error
        return {prop.name: values[:, i].copy() for i, prop in enumerate(kind.properties)}

    def read_lists(self, kind: _ElementKind, wanted: tuple[str, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        lengths: list[int] = []
        items: list[int] = []
        try:
            for _ in range(kind.count):
                length = 0
                for prop in kind.properties:
                    count = 1 if prop.count_dtype is None else int(self._take(1, kind)[0])
                    values = self._take(max(count, 0), kind)
                    if prop.name in wanted:
                        length = count
                        items.extend(map(int, values))
                lengths.append(length)
        except ValueError as error:
            raise SceneError(f'a value of element "{kind.name}" is not a whole number: {error}', self.file) from error
        return np.array(lengths, dtype=np.int64), np.array(items, dtype=np.int64)


def _assemble(
    columns: dict[str, NDArray[np.float64]] | None,
    whole: dict[str, int],
    polygons: tuple[NDArray[np.int64], NDArray[np.int64]] | None,
    file: Path,
) -> MeshData:
    vertices = _columns(columns, ("x", "y", "z"))
    if columns is None or vertices is None or len(vertices) == 0:
        raise SceneError("the mesh is empty: no vertices with x, y and z", file)
    if polygons is None or len(polygons[0]) == 0:
        raise SceneError("the mesh is empty: no faces", file)
    counts, corners = polygons
    if (counts < 3).any():
        face = int(np.argmax(counts < 3))
        raise SceneError(f"face {face} has {counts[face]} corners; expected at least 3", file)
    outside = (corners < 0) | (corners >= len(vertices))
    if outside.any():
        index = int(corners[np.argmax(outside)])
        raise SceneError(f"a face names vertex {index}, but there are {len(vertices)}", file)
    triangles, _ = triangulate_fans(counts)
    uvs = next((found for names in _UV_NAMES if (found := _columns(columns, names)) is not None), None)
    normals = _columns(columns, ("nx", "ny", "nz"))
    return MeshData(vertices, corners[triangles], normals, uvs, named_attributes(columns, whole))


def _columns(table: dict[str, NDArray[np.float64]] | None, names: tuple[str, ...]) -> NDArray[np.float64] | None:
    if table is None or any(name not in table for name in names):
        return None
    return np.stack([table[name] for name in names], axis=1)
