"""Reads Mitsuba 0.6's binary mesh files (*.serialized), versions 3 and 4.

Format: Mitsuba 0.6 documentation, section "Serialized mesh loader". A file holds several meshes, each a zlib stream
of its own, and ends with a dictionary of their positions.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.mesh_data import MeshData

_FILE_ID = 0x041C
_HAS_NORMALS, _HAS_UVS, _HAS_COLOURS = 0x1, 0x2, 0x8
_FACE_NORMALS, _SINGLE, _DOUBLE = 0x10, 0x1000, 0x2000
_HEADER = struct.Struct("<HH")
_COUNTS = struct.Struct("<QQ")
MAX_NAME = 4096
ZLIB_MAX_RATIO = 1032  # deflate cannot shrink data more than this (zlib's technical notes), so neither can a valid file


def read_serialized(file: Path, shape_index: int) -> MeshData:
    """One mesh of a serialized file.

    Args:
        shape_index: which mesh, counted from 0.

    Raises:
        SceneError: not such a file, truncated or broken, no mesh of this index.
    """
    try:
        data = file.read_bytes()
    except OSError as error:
        raise SceneError(f"cannot be read: {error.strerror}", file) from error
    version = _version(data, 0, file)
    start, end = _mesh_span(data, version, shape_index, file)
    version = _version(data, start, file)
    return _read_mesh(data[start + _HEADER.size : end], version, f"mesh {shape_index}", file)


def _version(data: bytes, start: int, file: Path) -> int:
    if len(data) < start + _HEADER.size:
        raise SceneError("not a serialized mesh file: too short", file)
    file_id, version = _HEADER.unpack_from(data, start)
    if file_id != _FILE_ID:
        raise SceneError(f"not a serialized mesh file: it begins with {file_id:#06x} instead of {_FILE_ID:#06x}", file)
    if version not in (3, 4):
        raise SceneError(f"version {version} of the serialized format is not supported; expected 3 or 4", file)
    return int(version)


def _mesh_span(data: bytes, version: int, index: int, file: Path) -> tuple[int, int]:
    """Where a mesh lies, from the dictionary at the end."""
    entry = 8 if version == 4 else 4
    count = struct.unpack_from("<I", data, len(data) - 4)[0]
    dictionary = len(data) - 4 - entry * count
    if count == 0 or dictionary < _HEADER.size:
        raise SceneError(f"the dictionary at the end claims {count} meshes: the file is truncated", file)
    if not 0 <= index < count:
        raise SceneError(f"there is no mesh {index}: the file has {count}, counted from 0", file)
    offsets = [*np.frombuffer(data, f"<u{entry}", count, dictionary).tolist(), dictionary]
    start, end = offsets[index], offsets[index + 1]
    if not start < end <= dictionary:
        raise SceneError(f"the dictionary at the end is broken: mesh {index} lies at {start} to {end}", file)
    return start, end


class _Stream:
    """A zlib stream that is never expanded beyond what its own header announces."""

    def __init__(self, compressed: bytes, name: str, file: Path) -> None:
        self.left = compressed
        self.limit = ZLIB_MAX_RATIO * len(compressed) + 1024
        self.name = name
        self.file = file
        self.inflater = zlib.decompressobj()
        self.buffer = b""

    def take(self, size: int) -> bytes:
        if size > self.limit:
            raise SceneError(
                f"{self.name}: announces {size} bytes, more than the file can hold: it is broken", self.file
            )
        parts = [self.buffer]
        have = len(self.buffer)
        while have < size:
            try:
                part = self.inflater.decompress(self.left, size - have)
            except zlib.error as error:
                raise SceneError(f"{self.name}: broken compressed data: {error}", self.file) from error
            self.left = self.inflater.unconsumed_tail
            if not part:
                raise SceneError(f"{self.name}: the data ends too early: the file is truncated", self.file)
            parts.append(part)
            have += len(part)
        data = b"".join(parts)
        self.buffer = data[size:]
        return data[:size]

    def take_text(self) -> None:
        """Skips a text that ends with a zero byte."""
        for _ in range(MAX_NAME):
            if self.take(1) == b"\0":
                return
        raise SceneError(f"{self.name}: its name does not end", self.file)

    def take_array(self, dtype: str, rows: int, width: int) -> NDArray[np.generic]:
        data = self.take(np.dtype(dtype).itemsize * rows * width)
        return np.frombuffer(data, dtype).reshape(rows, width)


def _read_mesh(compressed: bytes, version: int, name: str, file: Path) -> MeshData:
    stream = _Stream(compressed, name, file)
    (flags,) = struct.unpack("<I", stream.take(4))
    if version == 4:
        stream.take_text()
    vertex_count, face_count = _COUNTS.unpack(stream.take(_COUNTS.size))
    if flags & _SINGLE and flags & _DOUBLE:
        raise SceneError(f"{name}: flags {flags:#x} say both single and double precision", file)
    real = "<f8" if flags & _DOUBLE else "<f4"  # neither, as in early files, means single, as in Mitsuba 3
    vertices = stream.take_array(real, vertex_count, 3).astype(np.float64)
    normals = stream.take_array(real, vertex_count, 3).astype(np.float64) if flags & _HAS_NORMALS else None
    uvs = stream.take_array(real, vertex_count, 2).astype(np.float64) if flags & _HAS_UVS else None
    if flags & _HAS_COLOURS:
        stream.take_array(real, vertex_count, 3)
    index = "<u8" if vertex_count > 0xFFFFFFFF else "<u4"
    faces = stream.take_array(index, face_count, 3).astype(np.int64)
    if vertex_count == 0 or face_count == 0:
        raise SceneError(f"{name} is empty: {vertex_count} vertices and {face_count} faces", file)
    if faces.max() >= vertex_count:
        raise SceneError(f"{name}: a face names vertex {faces.max()}, but there are {vertex_count}", file)
    return MeshData(vertices, faces, None if flags & _FACE_NORMALS else normals, uvs)
