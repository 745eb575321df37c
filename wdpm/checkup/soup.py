"""The triangles of a scene as a render will have them, with what they share, for checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.checkup.standing import box_corners
from wdpm.scenes.flat.renderer_space import RendererSpace, renderer_space
from wdpm.scenes.model.scene import Instance, Scene, Solid

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Soup:
    """All triangles whose corners exist and are finite.

    Attributes:
        space: where everything is, as in scenes.flat.flatten.
        positions: corners in that space in single precision, float32, shape [T, 3, 3].
        vertex: numbers of the corners, the same where corners are in the same place, int64, shape [T, 3].
        mesh: which mesh a triangle is of, int64, shape [T], ascending.
        row: its number in that mesh, int64, shape [T].
        begin: where the triangles of each mesh begin, and the end of the last, int64, shape [meshes + 1].
        front: normal of the front times twice the area, float64, shape [T, 3].
        beyond: corners of the boxes of instances that are left out, float32, shape [N, 3].
    """

    space: RendererSpace
    positions: NDArray[np.float32]
    vertex: Ints
    mesh: Ints
    row: Ints
    begin: Ints
    front: NDArray[np.float64]
    beyond: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.mesh)

    def rows_of(self, mesh: int) -> slice:
        """The triangles of a mesh."""
        return slice(int(self.begin[mesh]), int(self.begin[mesh + 1]))

    @property
    def extent(self) -> float:
        """Largest absolute coordinate of a corner."""
        return float(max(np.abs(self.positions).max(initial=0.0), np.abs(self.beyond).max(initial=0.0)))

    def reach(self, kept: Bools) -> NDArray[np.float64]:
        """Corners of some of the triangles, and of what is left out, shape [N, 3]."""
        return np.concatenate([self.positions[kept].reshape(-1, 3), self.beyond]).astype(np.float64)

    def longest(self) -> NDArray[np.float64]:
        """Length of each triangle's longest edge, shape [T]."""
        corners = self.positions.astype(np.float64)
        return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)


def make_soup(scene: Scene, left_out: Sequence[Instance] = ()) -> Soup:
    """The triangles of a scene.

    Args:
        left_out: what belongs to the scene and is too much to be looked at (standing.looked_at).

    Raises:
        SceneError: it has no triangles.
    """
    space = renderer_space([*scene.meshes, *left_out])
    parts, rows = [], []
    fronts = []
    for mesh in scene.meshes:
        sound = np.flatnonzero(sound_faces(mesh))
        with np.errstate(over="ignore", invalid="ignore"):
            corners = space.place(mesh.vertices).astype(np.float32)[mesh.faces[sound]]
        finite = np.isfinite(corners).all(axis=(1, 2))
        parts.append(corners[finite] + np.float32(0.0))  # -0.0 is in the same place as 0.0
        rows.append(sound[finite])
        fronts.append(_fronts(mesh, sound[finite], parts[-1]))
    counts = np.array([len(part) for part in rows], np.int64)
    positions = np.concatenate(parts)
    return Soup(
        space,
        positions,
        _numbered(positions.reshape(-1, 3)).reshape(-1, 3),
        np.repeat(np.arange(len(counts)), counts),
        np.concatenate(rows),
        np.concatenate([[0], np.cumsum(counts)]),
        np.concatenate(fronts),
        box_corners(left_out, space),
    )


def sound_faces(mesh: Solid) -> Bools:
    """Faces whose corners exist and are finite, shape [F]."""
    exists = np.asarray(((mesh.faces >= 0) & (mesh.faces < len(mesh.vertices))).all(axis=1))
    finite = np.asarray(np.isfinite(mesh.vertices).all(axis=1))
    sound = exists.copy()
    sound[exists] = finite[mesh.faces[exists]].all(axis=1)
    return sound


def _fronts(mesh: Solid, rows: Ints, positions: NDArray[np.float32]) -> NDArray[np.float64]:
    """Area vectors on the front, which is where the vertex normals are (kernels.rays.cell_triangles.front_normals)."""
    corners = positions.astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if mesh.normals is not None:
        against = np.einsum("ij,ij->i", normal, mesh.normals[mesh.faces[rows]].sum(axis=1)) < 0
        normal[against] *= -1.0
    return normal


def _numbered(points: NDArray[np.float32]) -> Ints:
    """A number for each place, shape [N]."""
    if not len(points):
        return np.zeros(0, np.int64)
    order = np.lexsort(points.T)
    steps = (np.diff(points[order], axis=0) != 0).any(axis=1)
    number = np.empty(len(points), np.int64)
    number[order] = np.concatenate([[0], np.cumsum(steps)])
    return number


@dataclass(frozen=True, eq=False)
class Edges:
    """How the edges of some triangles are shared.

    Attributes:
        of: the edges of each triangle, int64, shape [T, 3].
        ends: places of the ends of each edge, int64, shape [E, 2].
        uses: triangles at each edge, int64, shape [E].
        forward: how many of these go along it from the smaller place to the larger, int64, shape [E].
    """

    of: Ints
    ends: Ints
    uses: Ints
    forward: Ints

    @property
    def open(self) -> Bools:
        """Edges of one triangle only."""
        return self.uses == 1

    @property
    def crowded(self) -> Bools:
        """Edges of three triangles or more."""
        return self.uses > 2

    @property
    def torn(self) -> Bools:
        """Edges at which two triangles are wound against each other."""
        return (self.uses == 2) & (self.forward != 1)

    def at(self, edges: Bools) -> Ints:
        """The triangles at some edges."""
        return np.flatnonzero(edges[self.of].any(axis=1))


def edges_of(vertex: Ints, backwards: Bools | None = None) -> Edges:
    """The edges of triangles, shape [T, 3], of which some count as wound the other way, shape [T]."""
    start, end = vertex, np.roll(vertex, -1, axis=1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    size = int(vertex.max(initial=0)) + 1
    keys, number = np.unique((low * size + high).ravel(), return_inverse=True)
    along = start < end
    if backwards is not None:
        along = along ^ backwards[:, None]
    uses = np.bincount(number, minlength=len(keys))
    forward = np.bincount(number, weights=along.ravel(), minlength=len(keys)).astype(np.int64)
    return Edges(number.reshape(-1, 3), np.stack([keys // size, keys % size], axis=1), uses, forward)


def pieces(edges: Edges) -> Ints:
    """A number for each triangle, the same for those that hang together by edges, from 0, shape [T]."""
    count = len(edges.of)
    label = np.arange(count)
    triangle = np.repeat(label, 3)
    order = np.argsort(edges.of.ravel(), kind="stable")
    same = np.diff(edges.of.ravel()[order]) == 0
    one, other = triangle[order[:-1]][same], triangle[order[1:]][same]
    while True:
        a, b = label[one], label[other]
        apart = a != b
        if not apart.any():
            break
        one, other = one[apart], other[apart]
        np.minimum.at(label, np.maximum(a, b)[apart], np.minimum(a, b)[apart])
        while (label != label[label]).any():
            label = label[label]
    return np.unique(label, return_inverse=True)[1]


def volumes(positions: NDArray[Any], front: NDArray[np.float64], piece: Ints) -> NDArray[np.float64]:
    """Signed volume that each piece encloses, shape [pieces]: below 0 where fronts face inwards."""
    count = int(piece.max(initial=-1)) + 1
    middle = positions.astype(np.float64).mean(axis=1)
    base = np.stack([np.bincount(piece, middle[:, axis], count) for axis in range(3)], axis=1)
    mean = base / np.bincount(piece, minlength=count)[:, None]
    sixth = np.einsum("ij,ij->i", middle - mean[piece], front) / 6.0
    return np.asarray(np.bincount(piece, sixth, count), np.float64)
