"""Reads OFF files, through trimesh; colours of vertices (COFF) by itself, as that leaves them out."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.mesh_data import MeshData, VertexAttribute
from wdpm.scenes.meshes.vertex_attributes import VERTEX_COLOR


def read_off(file: Path) -> MeshData:
    """The triangles of an OFF file, with colours of vertices if it is a COFF; polygons are cut into triangles.

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
    lines, begin = _lines(data)
    _check_complete(lines, begin, file)
    if len(mesh.faces) == 0:
        raise SceneError("the mesh is empty: no faces", file)
    vertices = np.asarray(mesh.vertices, np.float64)
    colors = _colors(lines[begin : begin + len(vertices)]) if lines[0].upper().startswith(b"COFF") else None
    attributes = {} if colors is None else {VERTEX_COLOR: colors}
    return MeshData(vertices, np.asarray(mesh.faces, np.int64), attributes=attributes)


def has_colored_faces(file: Path) -> bool:
    """Whether faces of a file that was read have colours, which are not read: more numbers than corners."""
    lines, begin = _lines(file.read_bytes())
    vertices = int((lines[begin - 1].upper().rpartition(b"OFF")[2].split())[0])
    face = lines[begin + vertices].split()
    return len(face) > int(face[0]) + 1


def _lines(data: bytes) -> tuple[list[bytes], int]:
    """Lines with something in them but comments, and the number of that of the first vertex."""
    lines = [line for line in (line.partition(b"#")[0].strip() for line in data.splitlines()) if line]
    return lines, 1 if lines[0].upper().rpartition(b"OFF")[2].split() else 2  # counts may stand beside the first word


def _colors(lines: list[bytes]) -> VertexAttribute | None:
    """Colours of vertices: whole numbers up to 255, or others up to 1; None if not every vertex has one."""
    words = [line.split()[3:6] for line in lines]
    try:
        values = np.array(words, np.str_).astype(np.float64)
    except ValueError:  # of different lengths, or no numbers
        return None
    if values.shape != (len(lines), 3):
        return None
    whole = all(word.isdigit() for row in words for word in row)
    return VertexAttribute(values / 255.0 if whole else values, coded=whole)


def _check_complete(lines: list[bytes], begin: int, file: Path) -> None:
    """Raise SceneError for a file that ends early: its reader takes the faces that are there."""
    counts = lines[begin - 1].upper().rpartition(b"OFF")[2].split()
    vertices, faces = (int(word) for word in counts[:2])
    if len(lines) < begin + vertices + faces:
        raise SceneError(
            f"truncated: it announces {vertices:,} vertices and {faces:,} faces, of which "
            f"{max(0, len(lines) - begin - vertices):,} are there",
            file,
        )
