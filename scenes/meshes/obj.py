"""Reads Wavefront OBJ files.

Format: "Object Files (.obj)", Wavefront Advanced Visualizer, appendix B1. Indices may be negative: they then count
back from the latest vertex before the face. Polygons are cut into fans, or into ears where they are concave.

Files as programs write them are read by whole arrays (obj_plain); what else there is in others, and what is wrong in
any, is found here, line by line.

Read by hand: trimesh (5.2) counts negative indices back from the end of the file, so that faces between vertices get
others' corners, and answers an index out of range with an IndexError that names no line.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.mesh_data import MeshData, VertexAttribute, merge_corners
from wdpm.scenes.meshes.obj_file import IGNORED, NO_MATERIAL, ObjFile, unknown_keywords
from wdpm.scenes.meshes.obj_plain import read_plain_obj
from wdpm.scenes.meshes.polygons.cutting import triangulate
from wdpm.scenes.meshes.text.words import is_number
from wdpm.scenes.meshes.vertex_attributes import VERTEX_COLOR
from wdpm.scenes.model.checks import FARTHEST
from wdpm.scenes.model.transforms import normalized


@dataclass(eq=False)
class _Numbers:
    """The values of one kind of vertex line, and where they stand."""

    keyword: str
    least: int  # values that must be there
    width: int  # values that are used
    rows: list[list[str]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)

    def add(self, words: list[str], line: int, file: Path) -> None:
        if len(words) - 1 < self.least:
            raise SceneError(f'"{self.keyword}" needs {self.least} numbers, got {len(words) - 1}', file, line)
        row = words[1 : self.width + 1]
        self.rows.append(row if len(row) == self.width else row + ["0"] * (self.width - len(row)))
        self.lines.append(line)

    def array(self, file: Path) -> NDArray[np.float64]:
        try:
            values = np.array(self.rows, dtype=np.str_).reshape(-1, self.width).astype(np.float64)
        except ValueError:
            raise self._not_a_number(file) from None
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            row = int(np.argmin(finite))
            shown = " ".join(self.rows[row])
            raise SceneError(f'"{self.keyword} {shown}" is not finite', file, self.lines[row])
        near = (np.abs(values) <= FARTHEST).all(axis=1)
        if not near.all():
            row = int(np.argmin(near))
            shown = " ".join(self.rows[row])
            message = f'"{self.keyword} {shown}" is beyond {FARTHEST:g}: give the model in a larger unit'
            raise SceneError(message, file, self.lines[row])
        return values

    def _not_a_number(self, file: Path) -> SceneError:
        for row, line in zip(self.rows, self.lines, strict=True):
            for word in row:
                try:
                    float(word)
                except ValueError:
                    return SceneError(f'"{self.keyword}": expected a number, got "{word}"', file, line)
        raise AssertionError("numpy refused numbers that Python accepts")


@dataclass(eq=False)
class _Faces:
    """Faces as written, with what negative indices count back from."""

    corners: list[str] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    seen: list[tuple[int, int, int]] = field(default_factory=list)  # v, vt, vn lines above the face
    materials: list[int] = field(default_factory=list)

    def add(self, words: list[str], line: int, seen: tuple[int, int, int], material: int, file: Path) -> None:
        if len(words) < 4:
            raise SceneError(f"a face needs at least 3 corners, got {len(words) - 1}", file, line)
        self.corners.extend(words[1:])
        self.counts.append(len(words) - 1)
        self.lines.append(line)
        self.seen.append(seen)
        self.materials.append(material)


def read_obj(file: Path) -> ObjFile:
    """Reads an OBJ file; its material libraries are left to `mtl.read_mtl`.

    Raises:
        SceneError: with file and line; also if there is no face.
    """
    try:
        plain = read_plain_obj(file)
        return read_by_lines(file) if plain is None else plain
    except OSError as error:
        raise SceneError(f"cannot be read: {error.strerror}", file) from error


def read_by_lines(file: Path) -> ObjFile:
    """Reads an OBJ file line by line: whatever the format allows, and it says what is wrong and where.

    Raises:
        OSError: it cannot be read.
        SceneError: with file and line; also if there is no face.
    """
    return _Parser(file).parse(file.read_text(encoding="utf-8-sig", errors="replace"))


COLORED = (7, 8)
"""Words of a vertex with a colour behind its position; an eighth is its opacity, which is not read."""


def uncolored_vertex(file: Path) -> int:
    """The line of the first vertex without a colour, or with words for one, of a file that is partly coloured.

    Readers do not keep it, as lines take more room than vertices, and such files are rare.
    """
    for line, words in _lines(file.read_text(encoding="utf-8-sig", errors="replace")):
        if words[0] == "v" and not (len(words) in COLORED and all(is_number(word) for word in words[4:7])):
            return line
    raise AssertionError("asked for a file in which all vertices have colours")


class _Parser:
    def __init__(self, file: Path) -> None:
        self.file = file
        self.positions = _Numbers("v", 3, 3)
        self.colors: list[list[str]] = []  # behind the positions of some vertices: not in the format, but widespread
        self.uvs = _Numbers("vt", 1, 2)
        self.normals = _Numbers("vn", 3, 3)
        self.faces = _Faces()
        self.materials: dict[str, int] = {}
        self.libraries: list[tuple[str, int]] = []
        self.unknown: dict[str, int] = {}

    def parse(self, text: str) -> ObjFile:
        numbers = {"v": self.positions, "vt": self.uvs, "vn": self.normals}
        material = NO_MATERIAL
        for line, words in _lines(text):
            keyword = words[0]
            if keyword in numbers:
                numbers[keyword].add(words, line, self.file)
                if keyword == "v" and len(words) in COLORED:
                    self.colors.append(words[4:7])
            elif keyword in ("f", "fo"):  # fo is an old spelling
                seen = len(self.positions.rows), len(self.uvs.rows), len(self.normals.rows)
                number = self.materials.setdefault(material, len(self.materials))
                self.faces.add(words, line, seen, number, self.file)
            elif keyword == "usemtl":
                material = " ".join(words[1:])
            elif keyword == "mtllib":
                self.libraries.append((" ".join(words[1:]), line))
            elif keyword not in IGNORED:
                self.unknown.setdefault(keyword, line)
        return self._assemble()

    def _assemble(self) -> ObjFile:
        if not self.faces.counts:
            raise SceneError("the mesh is empty: no faces", self.file)
        counts = np.array(self.faces.counts, dtype=np.int64)
        face = np.repeat(np.arange(len(counts)), counts)
        indices = self._indices(face)
        first, corner_vertex = merge_corners(indices[:, 0], indices[:, 1], indices[:, 2])
        vertices = self.positions.array(self.file)[indices[first, 0]]
        corners, polygon = triangulate(counts, corner_vertex, vertices)
        mesh = MeshData(
            vertices,
            corner_vertex[corners].astype(np.int64),
            _gather(normalized(self.normals.array(self.file)), indices[first, 2]),
            _gather(self.uvs.array(self.file), indices[first, 1]),
            self._attributes(indices[first, 0]),
        )
        warnings = unknown_keywords(self.file.name, self.unknown)
        partly_colored = bool(self.colors) and not mesh.attributes
        face_material = np.array(self.faces.materials, dtype=np.int32)[polygon]
        return ObjFile(mesh, tuple(self.materials), face_material, tuple(self.libraries), warnings, partly_colored)

    def _attributes(self, vertices: NDArray[np.int64]) -> dict[str, VertexAttribute]:
        """The vertices' colours, if all have some."""
        if not self.colors or len(self.colors) != len(self.positions.rows):
            return {}
        try:
            values = np.array(self.colors, dtype=np.str_).astype(np.float64)
        except ValueError:  # whatever stands there, it is no colour
            return {}
        return {VERTEX_COLOR: VertexAttribute(values[vertices], coded=True)}

    def _indices(self, face: NDArray[np.int64]) -> NDArray[np.int64]:
        """Indices of each corner's position, texture coordinate and normal from 0, shape [C, 3]; -1 if not given."""
        written = self._written_indices(face)
        seen = np.array(self.faces.seen, dtype=np.int64)[face]
        totals = np.array([len(self.positions.rows), len(self.uvs.rows), len(self.normals.rows)])
        resolved = np.where(written < 0, seen + written, written - 1)
        given = written != _ABSENT
        wrong = given & ((written == 0) | (resolved < 0) | (resolved >= totals))
        if wrong.any():
            corner, kind = np.argwhere(wrong)[0]
            name, there = ("v", "vt", "vn")[kind], totals[kind] if written[corner, kind] >= 0 else seen[corner, kind]
            message = f"face corner {self.faces.corners[corner]}: there is no {name} {written[corner, kind]}"
            raise SceneError(f"{message} (the file has {there})", self.file, self.faces.lines[face[corner]])
        return np.where(given, resolved, -1)

    def _written_indices(self, face: NDArray[np.int64]) -> NDArray[np.int64]:
        rows = []
        for corner, word in enumerate(self.faces.corners):
            parts = word.split("/")
            try:
                row = [max(-_FARTHEST, min(int(part), _FARTHEST)) if part else _ABSENT for part in parts]
            except ValueError:
                row = []
            if not 1 <= len(row) <= 3 or row[0] == _ABSENT:
                line = self.faces.lines[face[corner]]
                raise SceneError(f'face corner "{word}" is not of the form v, v/vt, v//vn or v/vt/vn', self.file, line)
            rows.append(row + [_ABSENT] * (3 - len(row)))
        return np.array(rows, dtype=np.int64)


_ABSENT = np.iinfo(np.int64).max // 2  # far from any index, and index arithmetic on it does not overflow
_FARTHEST = _ABSENT // 2  # what a number beyond is taken for: no vertex has it either


def _gather(values: NDArray[np.float64], indices: NDArray[np.int64]) -> NDArray[np.float64] | None:
    """Rows by index; zeros where the index is -1; None if it is -1 everywhere."""
    if (indices < 0).all():
        return None
    return np.where((indices >= 0)[:, None], values[indices], 0.0)


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and words of the lines that are not empty; comments cut off, continued lines joined."""
    carried: list[str] = []
    begin = 1
    for number, line in enumerate(text.split("\n"), start=1):
        begin = begin if carried else number
        content = line.partition("#")[0].rstrip()
        if content.endswith("\\"):
            carried.append(content[:-1])
            continue
        words = " ".join([*carried, content]).split() if carried else content.split()
        carried = []
        if words:
            yield begin, words
