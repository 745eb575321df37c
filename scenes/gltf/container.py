"""The container of glTF 2.0: JSON, binary chunks, buffers and accessors, with every size checked before use.

Format: Khronos Group, "glTF 2.0 Specification", sections 3.6 (binary data) and 4 (GLB).
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import DTypeLike, NDArray

from wdpm.scenes.beside import file_beside
from wdpm.scenes.errors import SceneError
from wdpm.scenes.git_lfs import check_not_a_pointer
from wdpm.scenes.meshes.mapped import FileBytes, let_go, map_file
from wdpm.scenes.meshes.several import converted
from wdpm.scenes.scene_root import check_within

_MAGIC, _JSON_CHUNK, _BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


_READ_VERSIONS = ("2.0", "2")


class GltfFile:
    """A parsed .gltf or .glb file.

    Attributes:
        json: the document.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        try:
            data = map_file(file)
        except OSError as error:
            raise self.error(f"cannot be read: {error.strerror}") from error
        self._mapped = [data]
        text, self._glb_chunk = _split_glb(data, file) if data[:4] == b"glTF" else (data[:], None)
        try:
            document = json.loads(text)
        except (ValueError, RecursionError) as error:
            line = error.lineno if isinstance(error, json.JSONDecodeError) else None
            raise SceneError(f"broken JSON: {error}", file, line) from error
        if not isinstance(document, dict):
            raise self.error("broken glTF: the document is not a JSON object")
        self.json: dict[str, Any] = document
        self._buffers: dict[int, memoryview] = {}
        self._supplied: dict[int, NDArray[Any]] = {}
        version = self.get(self.json, "asset", dict, {}).get("version")
        if version is None or not str(version).startswith("2."):
            raise self.error(f'expected glTF version 2.x in asset.version, got "{version}"')
        least = self.get(self.json, "asset", dict, {}).get("minVersion", "2.0")
        if str(least) not in _READ_VERSIONS:
            raise self.error(f"asks for a reader of glTF {least} in asset.minVersion; this one reads 2.0")

    def error(self, message: str) -> SceneError:
        return SceneError(message, self.file)

    def get(self, owner: dict[str, Any], key: str, kind: type | tuple[type, ...], default: Any) -> Any:
        """A property of the right JSON type, or the default."""
        value = owner.get(key, default)
        if value is not default and (not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool)):
            raise self.error(f'broken glTF: "{key}" is {json.dumps(value)[:60]}')
        return value

    def numbers(self, owner: dict[str, Any], key: str, default: list[float]) -> list[float]:
        """A property that is a list of finite numbers, as many as in the default."""
        values = self.get(owner, key, list, default)
        good = len(values) == len(default) and all(
            isinstance(x, int | float) and not isinstance(x, bool) and abs(x) < float("inf") for x in values
        )
        if not good:
            raise self.error(f'broken glTF: "{key}" must be {len(default)} numbers, got {json.dumps(values)[:60]}')
        return [float(x) for x in values]

    def number(self, owner: dict[str, Any], key: str, default: float) -> float:
        """A property that is a finite number."""
        value = self.get(owner, key, (int, float), default)
        if not abs(value) < float("inf"):
            raise self.error(f'broken glTF: "{key}" must be finite')
        return float(value)

    def count(self, kind: str) -> int:
        """How many objects a top-level list such as "meshes" has."""
        return len(self.get(self.json, kind, list, []))

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        """An object of a top-level list such as "meshes"."""
        items = self.get(self.json, kind, list, [])
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(items):
            raise self.error(f"broken glTF: there is no {kind}[{index}] (there are {len(items)})")
        if not isinstance(items[index], dict):
            raise self.error(f"broken glTF: {kind}[{index}] is not an object")
        return dict(items[index])

    def accessor(self, index: Any) -> NDArray[np.generic]:
        """The values of an accessor, shape [count, components]; normalized integers as float64 in [0, 1] or [-1, 1]."""
        accessor = self.item("accessors", index)
        component = accessor.get("componentType")
        width = _WIDTHS.get(str(accessor.get("type")))
        count = self.get(accessor, "count", int, -1)
        if component not in _COMPONENTS or width is None or count < 0:
            raise self.error(f"broken glTF: accessors[{index}] has no valid componentType, type or count")
        dtype = np.dtype(_COMPONENTS[component])
        if index in self._supplied:
            values = self._supplied[index]
            if values.shape != (count, width):
                raise self.error(
                    f"broken glTF: accessors[{index}] is of shape {values.shape}, expected {(count, width)}"
                )
            values = values.astype(dtype)
        elif "bufferView" in accessor:
            offset = self.get(accessor, "byteOffset", int, 0)
            values = self._strided(accessor["bufferView"], offset, dtype, count, width)
        else:
            self._check_allocation(count * width * dtype.itemsize)
            values = np.zeros((count, width), dtype=dtype)
        if "sparse" in accessor:
            values = self._with_sparse(values, self.get(accessor, "sparse", dict, {}), dtype)
        if accessor.get("normalized", False) is True and dtype.kind in "iu":
            return np.maximum(values.astype(np.float64) / np.iinfo(dtype).max, -1.0)
        return values

    def supply(self, index: Any, values: NDArray[Any]) -> None:
        """Give an accessor its values, shape [count, components], where they are not simply in the file."""
        self.item("accessors", index)
        self._supplied[index] = values

    def _check_allocation(self, size: int) -> None:
        # an accessor without data is all zeros; nothing in the file bounds it, so a gigabyte has to
        if size > 1 << 30:
            raise self.error(f"broken glTF: an accessor without data announces {size} bytes")

    def _strided(
        self, view_index: Any, offset: int, dtype: np.dtype[Any], count: int, width: int
    ) -> NDArray[np.generic]:
        view = self.item("bufferViews", view_index)
        data = self.view_bytes(view_index)
        row = dtype.itemsize * width
        stride = self.get(view, "byteStride", int, row)
        if offset < 0 or stride < row or (count and offset + stride * (count - 1) + row > len(data)):
            raise self.error(f"broken glTF: an accessor reads beyond the end of bufferViews[{view_index}]")
        if count == 0:
            return np.zeros((0, width), dtype=dtype)
        # strides need not be multiples of the component's size
        return np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))

    def _with_sparse(self, values: NDArray[Any], sparse: dict[str, Any], dtype: np.dtype[Any]) -> NDArray[np.generic]:
        count = self.get(sparse, "count", int, 0)
        where, what = self.get(sparse, "indices", dict, {}), self.get(sparse, "values", dict, {})
        index_type = _COMPONENTS.get(where.get("componentType", 0))
        if index_type not in ("<u1", "<u2", "<u4"):
            raise self.error("broken glTF: sparse accessor without valid indices")
        at = self.get(where, "byteOffset", int, 0)
        rows = self._strided(where.get("bufferView"), at, np.dtype(index_type), count, 1)[:, 0].astype(np.int64)
        at = self.get(what, "byteOffset", int, 0)
        patch = self._strided(what.get("bufferView"), at, dtype, count, values.shape[1])
        if len(rows) and rows.max() >= len(values):
            raise self.error("broken glTF: a sparse accessor replaces values beyond its end")
        patched = values.copy()
        patched[rows] = patch
        return patched

    def converted(self, index: Any, dtype: DTypeLike) -> NDArray[Any]:
        """The values of an accessor, as `accessor`, of some type; the file's memory is given back."""
        values = converted([self.accessor(index)], dtype)
        for data in self._mapped:
            let_go(data)
        return values

    def view_bytes(self, index: Any) -> memoryview:
        """The bytes of a buffer view, where the file is mapped."""
        view = self.item("bufferViews", index)
        data = self._buffer(self.get(view, "buffer", int, -1))
        offset, length = self.get(view, "byteOffset", int, 0), self.get(view, "byteLength", int, -1)
        if offset < 0 or length < 0 or offset + length > len(data):
            raise self.error(f"broken glTF: bufferViews[{index}] reads beyond the end of its buffer")
        return data[offset : offset + length]

    def _buffer(self, index: int) -> memoryview:
        if index not in self._buffers:
            buffer = self.item("buffers", index)
            if "uri" in buffer:
                self._buffers[index] = memoryview(self._uri_data(self.get(buffer, "uri", str, "")))
            elif self._glb_chunk is not None and index == 0:
                self._buffers[index] = self._glb_chunk
            else:
                raise self.error(f"broken glTF: buffers[{index}] has no data")
            length = self.get(buffer, "byteLength", int, 0)
            if length > len(self._buffers[index]):
                raise self.error(
                    f"buffers[{index}] has {len(self._buffers[index])} bytes instead of {length}: truncated"
                )
        return self._buffers[index]

    def uri_bytes(self, uri: str) -> bytes:
        """The content of a data URI or of a file beside this one; nothing is fetched from a network."""
        return self._uri_data(uri)[:]

    def _uri_data(self, uri: str) -> FileBytes:
        if uri.startswith("data:"):
            header, comma, payload = uri.partition(",")
            if not comma or not header.endswith(";base64"):
                raise self.error(f'only base64 data URIs are supported, got "{header[:60]}"')
            try:
                return base64.b64decode(payload, validate=True)
            except binascii.Error as error:
                raise self.error(f"broken glTF: data URI: {error}") from error
        if "://" in uri:
            raise self.error(f'"{uri[:60]}": only files beside the scene are read, nothing is fetched')
        name = unquote(uri)
        if "\0" in name:
            raise self.error(f"{uri!r} can be no name of a file")
        file = file_beside(self.file, name)
        check_within(file, self.file)
        check_not_a_pointer(file, self.file)
        try:
            data = map_file(file)
        except OSError as error:
            raise self.error(f'"{uri}" cannot be read: {error.strerror}') from error
        self._mapped.append(data)
        return data


def _split_glb(data: FileBytes, file: Path) -> tuple[bytes, memoryview | None]:
    """JSON text and binary chunk of a GLB container."""
    if len(data) < 20:
        raise SceneError("GLB is too short: it is truncated", file)
    _magic, version, length = struct.unpack_from("<III", data)
    if version != 2:
        raise SceneError(f"GLB container of version {version}; expected 2", file)
    if length > len(data):
        raise SceneError(f"GLB announces {length} bytes but has {len(data)}: it is truncated", file)
    chunks: dict[int, memoryview] = {}
    view = memoryview(data)
    position = 12
    while position + 8 <= length:
        size, kind = struct.unpack_from("<II", data, position)
        position += 8
        if position + size > length:
            raise SceneError("a GLB chunk reads beyond the end of the file: it is truncated", file)
        chunks.setdefault(kind, view[position : position + size])
        position += size
    if _JSON_CHUNK not in chunks:
        raise SceneError("GLB without a JSON chunk", file)
    return bytes(chunks[_JSON_CHUNK]), chunks.get(_BINARY_CHUNK)
