"""OBJ files as programs write them: read in pieces, several at a time, and put together."""

from __future__ import annotations

import os
from codecs import BOM_UTF8
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.meshes.growing import Growing
from wdpm.scenes.meshes.mesh_data import MeshData, VertexAttribute, merge_corners
from wdpm.scenes.meshes.obj_file import NO_MATERIAL, ObjFile, unknown_keywords
from wdpm.scenes.meshes.polygons.cutting import triangulate
from wdpm.scenes.meshes.several import at_numbers, converted, in_threads
from wdpm.scenes.meshes.text.obj_piece import NotPlainError, ObjPiece, read_pieces
from wdpm.scenes.meshes.vertex_attributes import VERTEX_COLOR

PIECE: Final = 1 << 20
"""Bytes that are read at a time. With arrays that fit into a core's cache, an eighth of this, a thread alone is
faster, but two together take half as much again: they wait for the interpreter after each step."""


def read_plain_obj(file: Path, piece: int = PIECE) -> ObjFile | None:
    """The file by whole arrays; None if something in it is not as programs write it, or is wrong.

    Args:
        piece: bytes that are read at a time, at least.

    Raises:
        OSError: it cannot be read.
    """
    if not file.is_file():  # in which one cannot go to and fro
        return None
    whole = _Whole()
    try:
        for parts in in_threads(partial(_read, file), _ranges(file, piece)):
            for part in parts:
                whole.add(part)
        return whole.assembled(file.name)
    except NotPlainError:
        return None


def _ranges(file: Path, size: int) -> Iterator[tuple[int, int]]:
    """Where pieces of the text begin and end, cut between lines."""
    with file.open("rb") as stream:
        begin = len(BOM_UTF8) if stream.read(len(BOM_UTF8)) == BOM_UTF8 else 0  # which editors on Windows put there
        while stream.seek(begin + size - 1) < (length := os.fstat(stream.fileno()).st_size):
            stream.readline()
            yield begin, stream.tell()
            begin = stream.tell()
        if begin < length:
            yield begin, length


def _read(file: Path, where: tuple[int, int]) -> list[ObjPiece]:
    """A piece of the text; threads read the file themselves, as that copies it."""
    begin, end = where
    with file.open("rb") as stream:
        stream.seek(begin)
        text = stream.read(end - begin)
    return read_pieces(text)


class _Whole:
    """What the pieces hold together."""

    def __init__(self) -> None:
        self.positions = Growing(np.float64, 3)
        self.uvs = Growing(np.float64, 2)
        self.normals = Growing(np.float64, 3)
        self.colors = Growing(np.float64, 3)
        self.corners = Growing(np.int32)  # positions of the corners of faces, from 0
        self.others = _Numbers(), _Numbers()  # texture coordinates and normals
        self.counts = Growing(np.int32)
        self.uses: list[tuple[int, str]] = []  # faces above each `usemtl`
        self.libraries: list[tuple[str, int]] = []
        self.unknown: dict[str, int] = {}
        self.lines = 1

    def add(self, piece: ObjPiece) -> None:
        """Raises NotPlainError if a number counts back beyond the first."""
        tables = self.positions, self.uvs, self.normals
        v, vt, vn = (_from_zero(piece, column, len(table)) for column, table in enumerate(tables))
        assert v is not None
        for numbers, others in zip(self.others, (vt, vn), strict=True):
            numbers.add(others, v, self.corners)
        self.corners.add(v)
        self.uses += [(len(self.counts) + above, name) for above, name in piece.materials]
        self.libraries += [(name, self.lines + line) for name, line in piece.libraries]
        for word, line in piece.unknown.items():
            self.unknown.setdefault(word, self.lines + line)
        self.lines += piece.lines
        self.counts.add(piece.counts)
        self.positions.add(piece.positions)
        self.uvs.add(piece.uvs)
        self.normals.add(piece.normals)
        self.colors.add(piece.colors)

    def assembled(self, name: str) -> ObjFile:
        """Raises NotPlainError without faces, or if a corner names what there is not."""
        v = self.corners.taken()
        vt, vn = (numbers.taken(v) for numbers in self.others)
        positions, uvs, normals = self.positions.taken(), self.uvs.taken(), self.normals.taken()
        if not len(v) or any(
            column is not None and column.max() >= len(table)
            for column, table in ((v, positions), (vt, uvs), (vn, normals))
        ):
            raise NotPlainError
        first, corner_vertex = merge_corners(v, *(column for column in (vt, vn) if column is not None))
        own_v = v[first]
        own_vt, own_vn = (own_v if one is v else None if one is None else one[first] for one in (vt, vn))
        del v, vt, vn, first
        counts = self.counts.taken()
        materials, face_material = self._materials(counts)
        if counts.min() == 3 == counts.max():
            faces = converted([corner_vertex.reshape(-1, 3)], np.int64)
        else:
            faces = corner_vertex[triangulate(counts, corner_vertex, _rows(positions, own_v))[0]].astype(np.int64)
        del corner_vertex
        partly_colored = len(self.colors) not in (0, len(positions))
        attributes = {} if partly_colored else self._attributes(own_v)
        own_normals = None if own_vn is None else _rows(normals, own_vn)
        own_uvs = None if own_vt is None else _rows(uvs, own_vt)
        mesh = MeshData(_rows(positions, own_v), faces, own_normals, own_uvs, attributes)
        libraries, warnings = tuple(self.libraries), unknown_keywords(name, self.unknown)
        return ObjFile(mesh, materials, face_material, libraries, warnings, partly_colored)

    def _materials(self, counts: NDArray[np.int32]) -> tuple[tuple[str, ...], NDArray[np.int32]]:
        """Names in order of first use, and the number of each triangle's."""
        numbers: dict[str, int] = {}
        begins = [0, *(above for above, _ in self.uses)]
        ends = [*begins[1:], len(counts)]
        names = [NO_MATERIAL, *(name for _, name in self.uses)]
        of_run = [
            numbers.setdefault(name, len(numbers)) if end > begin else 0
            for name, begin, end in zip(names, begins, ends, strict=True)
        ]
        of_face = np.repeat(np.array(of_run, np.int32), np.diff([*begins, len(counts)]))
        return tuple(numbers), of_face if counts.max() == 3 else np.repeat(of_face, counts - 2)

    def _attributes(self, vertices: NDArray[np.int32]) -> dict[str, VertexAttribute]:
        """The vertices' colours, if they have some."""
        colors = self.colors.taken()
        if not len(colors):
            return {}
        return {VERTEX_COLOR: VertexAttribute(colors[vertices], coded=True)}


def _from_zero(piece: ObjPiece, column: int, above: int) -> NDArray[np.int32] | None:
    """Numbers from 0, -1 for none; None where no corner has one.

    Args:
        above: how many there are of the kind above the piece.
    """
    numbers = piece.corners[column]
    if numbers is None or piece.seen is None:
        return numbers
    back = numbers < -1
    counted = np.where(back, above + piece.seen[:, column] + numbers + 1, numbers)
    if (counted[back] < 0).any():
        raise NotPlainError
    return counted.astype(np.int32)


class _Numbers:
    """Numbers of texture coordinates or normals at corners; kept only if they are not those of the positions."""

    def __init__(self) -> None:
        self._none = self._same = True  # at all corners so far
        self._own = Growing(np.int32)

    def add(self, numbers: NDArray[np.int32] | None, positions: NDArray[np.int32], positions_above: Growing) -> None:
        """Appends those of further corners; -1 or nothing for none."""
        was_none, was_same = self._none, self._same
        if not len(positions):
            return
        self._none = was_none and (numbers is None or not (numbers >= 0).any())
        self._same = was_same and (numbers is positions or (numbers is not None and np.array_equal(numbers, positions)))
        if self._none or self._same:
            return
        if was_same and len(positions_above):
            self._own.add(positions_above.copied())
        elif was_none:
            self._own.add(np.full(len(positions_above), -1, np.int32))
        self._own.add(np.full(len(positions), -1, np.int32) if numbers is None else numbers)

    def taken(self, positions: NDArray[np.int32]) -> NDArray[np.int32] | None:
        """All of them; None if there are none."""
        if self._none:
            return None
        return positions if self._same else self._own.taken()


def _rows(values: NDArray[np.float64], numbers: NDArray[np.int32]) -> NDArray[np.float64]:
    """Rows by number; zeros where it is -1."""
    if len(numbers) == len(values) and np.array_equal(numbers, np.arange(len(numbers))):
        return values
    rows = at_numbers(values, numbers)
    if numbers.min(initial=0) < 0:
        rows[numbers < 0] = 0.0
    return rows
