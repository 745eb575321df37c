"""Reads STL files, binary and ASCII. Format: 3D Systems, "StereoLithography Interface Specification", 1989.

The facet normals in the file are not used: they are often wrong, and the corners' order says the same.

Read by hand: of an ASCII file that ends within a facet trimesh (5.2) makes an empty scene, without a word.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.mesh_data import MeshData

_HEADER_SIZE = 80
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(file: Path) -> MeshData:
    """The triangles of an STL file; each has vertices of its own.

    Raises:
        SceneError: neither form of STL, truncated, or without triangles.
    """
    try:
        data = file.read_bytes()
    except OSError as error:
        raise SceneError(f"cannot be read: {error.strerror}", file) from error
    corners = _read_ascii(data, file) if _is_ascii(data) else _read_binary(data, file)
    if len(corners) == 0:
        raise SceneError("the mesh is empty: no facets", file)
    return MeshData(corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int64).reshape(-1, 3))


def _is_ascii(data: bytes) -> bool:
    """Binary files may begin with "solid" too, so their announced length decides first."""
    if len(data) >= _HEADER_SIZE + 4 and len(data) == _binary_size(data):
        return False
    return data.lstrip()[:5].lower() == b"solid"


def _binary_size(data: bytes) -> int:
    return _HEADER_SIZE + 4 + _FACET.itemsize * _announced(data)


def _announced(data: bytes) -> int:
    return int.from_bytes(data[_HEADER_SIZE : _HEADER_SIZE + 4], "little")


def _read_binary(data: bytes, file: Path) -> np.ndarray:
    if len(data) < _HEADER_SIZE + 4:
        raise SceneError('not an STL file: too short for a binary one, and it does not begin with "solid"', file)
    if len(data) < _binary_size(data):
        whole = (len(data) - _HEADER_SIZE - 4) // _FACET.itemsize
        raise SceneError(f"announces {_announced(data)} facets, but ends after {whole}: it is truncated", file)
    return np.frombuffer(data, _FACET, _announced(data), _HEADER_SIZE + 4)["corners"].astype(np.float64)


def _read_ascii(data: bytes, file: Path) -> np.ndarray:
    corners: list[list[float]] = []
    in_facet = 0
    for line, text in enumerate(data.decode("utf-8", errors="replace").splitlines(), start=1):
        words = text.split()
        keyword = words[0].lower() if words else ""
        if keyword == "vertex":
            corners.append(_coordinates(words[1:], file, line))
            in_facet += 1
        elif keyword == "endfacet":
            if in_facet != 3:
                raise SceneError(f"a facet has {in_facet} vertices; expected 3", file, line)
            in_facet = 0
    if in_facet:
        raise SceneError("the file ends within a facet: it is truncated", file)
    return np.array(corners, dtype=np.float64).reshape(-1, 3, 3)


def _coordinates(words: list[str], file: Path, line: int) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != 3:
        raise SceneError(f'"vertex" needs 3 numbers, got "{" ".join(words)}"', file, line)
    return values
