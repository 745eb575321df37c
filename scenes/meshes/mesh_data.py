"""A mesh file's content before it gets a material and a place, and what can be done with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.meshes.several import at_numbers
from wdpm.scenes.model.transforms import Matrix, apply_to_normals, apply_to_points, mirrors, normalized

COSINE_OF_FLAT = 0.9945
"""Of 6 degrees."""


@dataclass(frozen=True, eq=False)
class VertexAttribute:
    """What a mesh file says about its vertices, or its faces, besides their geometry.

    Attributes:
        values: float64, shape [V, C], of faces [F, C]; whole numbers of a file as shares of their type's largest.
        coded: whether they are most likely meant for the screen (sRGB), if they are colours.
    """

    values: NDArray[np.float64]
    coded: bool = False


@dataclass(frozen=True, eq=False)
class MeshData:
    """Indexed triangles.

    Attributes:
        vertices: float64, shape [V, 3].
        faces: int64, shape [F, 3], counter-clockwise seen from the front.
        normals: unit vertex normals, float64, shape [V, 3], or None.
        uvs: texture coordinates, float64, shape [V, 2], or None.
        attributes: others by name, as Mitsuba calls them: "vertex_color", ...
        face_attributes: likewise, one value a face: "face_color", ...
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[np.float64] | None = None
    uvs: NDArray[np.float64] | None = None
    attributes: Mapping[str, VertexAttribute] = field(default_factory=dict)
    face_attributes: Mapping[str, VertexAttribute] = field(default_factory=dict)

    def transformed(self, matrix: Matrix) -> MeshData:
        """The mesh mapped by an affine matrix.

        A mirroring matrix turns the corners' order around. Where there are normals they say which side is the front,
        so the order is put back to agree with them; a mesh without normals changes sides, as in Mitsuba.

        Raises:
            ValueError: the matrix has no inverse.
        """
        normals = None if self.normals is None else apply_to_normals(matrix, self.normals)
        mirrored = mirrors(matrix)
        faces = self.faces[:, ::-1] if mirrored and normals is not None else self.faces
        return replace(self, vertices=apply_to_points(matrix, self.vertices), faces=faces, normals=normals)

    def flipped(self) -> MeshData:
        """The mesh with front and back exchanged."""
        return replace(self, faces=self.faces[:, ::-1], normals=None if self.normals is None else -self.normals)

    def apart(self) -> MeshData:
        """The mesh with vertices of its own for every face: three to a face, in the order of the faces."""
        kept = self.faces.reshape(-1)
        return replace(
            self,
            vertices=self.vertices[kept],
            faces=np.arange(len(kept)).reshape(-1, 3),
            normals=None if self.normals is None else self.normals[kept],
            uvs=None if self.uvs is None else self.uvs[kept],
            attributes={name: replace(a, values=a.values[kept]) for name, a in self.attributes.items()},
        )

    def flat(self) -> MeshData:
        """The mesh without vertex normals."""
        return replace(self, normals=None)

    def has_placeholder_normals(self) -> bool:
        """Whether the vertex normals are all the same although the surface is not flat: some exporters write such.

        It is flat where faces with less than a hundredth of its area lean from the normal by more than 6 degrees.
        """
        if self.normals is None or not len(self.faces) or np.abs(self.normals - self.normals[0]).max() > 1e-6:
            return False
        corners = self.vertices[self.faces]
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(facing, axis=1)
        leaning = np.abs(facing @ self.normals[0]) < COSINE_OF_FLAT * area
        return bool(area[leaning].sum() > 0.01 * area.sum())

    def smooth(self) -> MeshData:
        """The mesh with its own normals, or with computed ones where it has none."""
        return self if self.normals is not None else replace(self, normals=vertex_normals(self.vertices, self.faces))


def vertex_normals(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Normals of the faces around a vertex, weighted by the angle each face has there, shape [V, 3].

    "Computing Vertex Normals from Polygonal Facets", Thürmer & Wüthrich 1998; Mitsuba uses the same weights. A vertex
    without a proper face gets a zero row.
    """
    corners = vertices[faces]
    face_normals = normalized(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    sums = np.zeros_like(vertices)
    for corner in range(3):
        towards = normalized(corners[:, (corner + 1) % 3] - corners[:, corner])
        back = normalized(corners[:, (corner + 2) % 3] - corners[:, corner])
        angle = np.arccos(np.clip(np.sum(towards * back, axis=1), -1.0, 1.0))
        weighted = face_normals * angle[:, None]
        for axis in range(3):
            sums[:, axis] += np.bincount(faces[:, corner], weights=weighted[:, axis], minlength=len(vertices))
    return normalized(sums)


Numbers = NDArray[np.signedinteger[Any]]


def merge_corners(*columns: Numbers) -> tuple[NDArray[np.int64], Numbers]:
    """Makes one vertex of every distinct combination of indices.

    Args:
        columns: for every corner its index of position, texture coordinate, normal, ...; each of shape [N].

    Returns:
        first: for every vertex a corner that has its combination, shape [V], in order of first appearance.
        corner_vertex: for every corner its vertex, shape [N], in 32 bits where they are enough.
    """
    key, *others = columns
    if not len(key):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    if key.min() < 0 or key.max() > 4 * len(key):  # no table of them
        return _merge_by_sorting(columns)
    others = [column for column in others if column is not key and column.min() != column.max()]
    if not others:
        return _merge_single(key)
    # for every corner, the first one of its combination
    earliest: Numbers = np.arange(len(key), dtype=np.int64 if len(key) >= 1 << 31 else np.int32)
    _find_earliest(key, others, earliest)
    first = np.flatnonzero(earliest == np.arange(len(key), dtype=earliest.dtype))
    number = np.empty_like(earliest)  # of vertices, at their first corners
    number[first] = np.arange(len(first))
    for block in range(0, len(key), _CORNERS_AT_ONCE):
        earliest[block : block + _CORNERS_AT_ONCE] = number[earliest[block : block + _CORNERS_AT_ONCE]]
    return first, earliest


def _merge_single(key: Numbers) -> tuple[NDArray[np.int64], Numbers]:
    """As `merge_corners`, of a single column that is not negative, nor much larger than there are corners."""
    dtype = np.int64 if len(key) >= 1 << 31 else np.int32
    table: Numbers = np.full(int(key.max()) + 1, -1, dtype)  # the first corner of each key
    for end in range(len(key), 0, -_CORNERS_AT_ONCE):
        begin = max(end - _CORNERS_AT_ONCE, 0)
        # of numbers that are written to one place the last stays
        table[key[begin:end][::-1]] = np.arange(end - 1, begin - 1, -1, dtype=dtype)
    is_first = np.zeros(len(key), np.bool_)
    is_first[table[table >= 0]] = True
    first = np.flatnonzero(is_first)
    table[key[first]] = np.arange(len(first), dtype=dtype)  # now the vertex of each key
    return first, at_numbers(table, key)


_CORNERS_AT_ONCE = 1 << 16
_MOST_ROUNDS = 16
"""What still differs after so many rounds is sorted: corners in which very many meet, each another combination."""


def _find_earliest(key: Numbers, others: Sequence[Numbers], earliest: Numbers) -> None:
    """For every corner the first that has its combination, in linear time where few meet in one of the key column.

    In every round, corners of one key are held against the first of them that is left.

    Args:
        key: not negative, not much larger than there are corners.
        earliest: numbers of the corners; it becomes the result.
    """
    first = np.empty(int(key.max()) + 1, earliest.dtype)
    left = earliest
    for _ in range(_MOST_ROUNDS):
        own = key[left]
        first[own[::-1]] = left[::-1]  # of numbers that are written to one place the last stays
        found = first[own]
        alike = np.ones(len(left), np.bool_)
        for column in others:
            alike &= column[left] == column[found]
        rest = left[~alike]
        earliest[left[alike]] = found[alike]
        left = rest
        if not len(left):
            return
    first_of, number = _merge_by_sorting([column[left] for column in (key, *others)])
    earliest[left] = left[first_of][number]


def _merge_by_sorting(columns: Sequence[Numbers]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """As `merge_corners`, whatever the numbers."""
    code = np.zeros(len(columns[0]), dtype=np.int64)
    size = 1  # codes are below it
    for column in columns:
        low, high = int(column.min(initial=0)), int(column.max(initial=0))
        if size * (high - low + 1) >= 1 << 62:  # the product of all ranges would overflow
            _, code = np.unique(code, return_inverse=True)
            size = len(code)
        code = code * (high - low + 1) + (column - low)
        size *= high - low + 1
    _, first, inverse = np.unique(code, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[inverse]
