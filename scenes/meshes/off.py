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
        data = file.read_bytes()
    except OSError as error:
        raise SceneError(f"cannot be read: {error.strerror}", file) from error
    try:
        mesh = trimesh.load(io.BytesIO(data), file_type="off", process=False, force="mesh")
    except (ValueError, IndexError, NameError, TypeError, KeyError) as error:  # what its parser raises
        raise SceneError(f"not an OFF file, or truncated: {error}", file) from None
    if len(mesh.faces) == 0:
        raise SceneError("the mesh is empty: no faces", file)
    return MeshData(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64))
