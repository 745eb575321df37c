"""Reads OFF files, through trimesh."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.mesh_data import MeshData


def read_off(file: Path) -> MeshData:
    """The triangles of an OFF file; polygons are cut into triangles.

    Raises:
        SceneError: not an OFF file, truncated, an index out of range, or without faces.
    """
    import trimesh  # here, as it takes a third of the time in which a command starts, and few scenes have OFF files

    try:
        # What is no ASCII stands in comments, or is wrong; trimesh would look for a library to guess its encoding.
        data = file.read_bytes().decode("ascii", "replace").encode("ascii", "replace")
    except OSError as error:
        raise SceneError(f"cannot be read: {error.strerror}", file) from error
    try:
        mesh = trimesh.load(io.BytesIO(data), file_type="off", process=False, force="mesh")
    except (ValueError, IndexError, NameError, TypeError, KeyError) as error:  # what its parser raises
        raise SceneError(f"not an OFF file, or truncated: {error}", file) from None
    _check_complete(data, file)
    if len(mesh.faces) == 0:
        raise SceneError("the mesh is empty: no faces", file)
    return MeshData(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64))


def _check_complete(data: bytes, file: Path) -> None:
    """Raise SceneError for a file that ends early: its reader takes the faces that are there."""
    lines = [line for line in (line.partition(b"#")[0].strip() for line in data.splitlines()) if line]
    counts = lines[0].upper().rpartition(b"OFF")[2].split()  # may stand beside the first word
    begin = 1 if counts else 2
    vertices, faces = (int(word) for word in (counts or lines[1].split())[:2])
    if len(lines) < begin + vertices + faces:
        raise SceneError(
            f"truncated: it announces {vertices:,} vertices and {faces:,} faces, of which "
            f"{max(0, len(lines) - begin - vertices):,} are there",
            file,
        )
