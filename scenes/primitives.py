"""Mitsuba's simple shapes as triangles, with its orientation and texture coordinates.

Curved shapes have AROUND segments around their axis, and a sphere has AROUND / 2 rings. Their vertices lie on the
surface and their normals are exact; silhouettes are off by at most radius * (pi / AROUND)² / 2, which is 0.03 % of the
radius, and areas by twice that. They are watertight: seams and poles repeat positions bit for bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.mesh_data import MeshData

AROUND = 128  # segments; twice as many would quarter the error, but a sphere then has 64,512 triangles
DISK_RINGS = 8  # the texture's radius and angle are interpolated in each ring


def rectangle() -> MeshData:
    """The square [-1, 1]² in the plane z = 0; it faces +z."""
    uvs = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    vertices = np.concatenate([2.0 * uvs - 1.0, np.zeros((4, 1))], axis=1)
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    return MeshData(vertices, np.array([[0, 1, 2], [0, 2, 3]]), normals, uvs)


def cube() -> MeshData:
    """The cube [-1, 1]³; it faces outwards."""
    vertices, normals = [], []
    for normal, u_axis, v_axis in _CUBE_SIDES:
        n, u, v = (np.array(axis, dtype=np.float64) for axis in (normal, u_axis, v_axis))
        vertices += [n - u + v, n + u + v, n + u - v, n - u - v]  # Mitsuba's order: uv (0,1) (1,1) (1,0) (0,0)
        normals += [n] * 4
    uvs = np.tile([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]], (6, 1))
    faces = np.concatenate(
        [[[4 * side, 4 * side + 1, 4 * side + 2], [4 * side + 3, 4 * side, 4 * side + 2]] for side in range(6)]
    )
    return MeshData(np.array(vertices), faces, np.array(normals), uvs)


# outward normal, direction of growing u, direction of growing v
_CUBE_SIDES = (
    ((0, -1, 0), (0, 0, 1), (1, 0, 0)),
    ((0, 1, 0), (-1, 0, 0), (0, 0, -1)),
    ((1, 0, 0), (0, 1, 0), (0, 0, -1)),
    ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
    ((-1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, 0, -1), (0, -1, 0), (1, 0, 0)),
)


def sphere() -> MeshData:
    """The unit sphere at the origin; it faces outwards. u goes around z from +x, v from the pole at +z to the other."""
    rings = AROUND // 2
    circle = _circle()
    theta = np.pi * np.arange(rings + 1) / rings
    sin, cos = np.sin(theta), np.cos(theta)
    sin[[0, -1]] = 0.0  # sin(pi) is not quite 0 in floating point, and poles must be points
    normals = np.concatenate(
        [circle[None, :, :] * sin[:, None, None], np.broadcast_to(cos[:, None, None], (rings + 1, AROUND + 1, 1))],
        axis=2,
    )
    u = np.broadcast_to(np.arange(AROUND + 1) / AROUND, (rings + 1, AROUND + 1)).copy()
    u[0] += 0.5 / AROUND  # at a pole each triangle has a vertex of its own, in the middle of its segment
    u[-1] -= 0.5 / AROUND
    v = np.broadcast_to((np.arange(rings + 1) / rings)[:, None], u.shape)
    faces = _grid_faces(rings, AROUND)
    faces = faces[~_is_pole_sliver(faces, rings)]
    flat = normals.reshape(-1, 3)
    return MeshData(flat.copy(), faces, flat, np.stack([u, v], axis=2).reshape(-1, 2))


def disk() -> MeshData:
    """The unit disk in the plane z = 0; it faces +z. u is the distance from the centre, v goes around from +x."""
    radius = np.arange(DISK_RINGS + 1) / DISK_RINGS
    plane = radius[:, None, None] * _circle()[None, :, :]
    vertices = np.concatenate([plane, np.zeros((*plane.shape[:2], 1))], axis=2).reshape(-1, 3)
    u = np.broadcast_to(radius[:, None], plane.shape[:2])
    v = np.broadcast_to(np.arange(AROUND + 1) / AROUND, plane.shape[:2]).copy()
    v[0] += 0.5 / AROUND
    faces = _grid_faces(DISK_RINGS, AROUND)
    faces = faces[~_starts_at_first_ring(faces)]
    normals = np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
    return MeshData(vertices, faces, normals, np.stack([u, v], axis=2).reshape(-1, 2))


def cylinder() -> MeshData:
    """The side of a cylinder of radius 1, z from 0 to 1, without caps; it faces outwards. u goes around, v along z."""
    circle = _circle()
    ends = [np.concatenate([circle, np.full((AROUND + 1, 1), height)], axis=1) for height in (1.0, 0.0)]
    normals = np.tile(np.concatenate([circle, np.zeros((AROUND + 1, 1))], axis=1), (2, 1))
    u = np.tile(np.arange(AROUND + 1) / AROUND, 2)
    uvs = np.stack([u, np.repeat([1.0, 0.0], AROUND + 1)], axis=1)
    return MeshData(np.concatenate(ends), _grid_faces(1, AROUND), normals, uvs)


def _circle() -> NDArray[np.float64]:
    """Points of the unit circle, shape [AROUND + 1, 2]; the last repeats the first bit for bit."""
    angle = 2.0 * np.pi * (np.arange(AROUND + 1) % AROUND) / AROUND
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """Two triangles for every cell of a grid of (rows + 1) x (columns + 1) vertices, shape [2 * rows * columns, 3]."""
    corner = np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)[None, :]
    below = corner + columns + 1
    # with rows going down and columns to the right, seen from the front, this is counter-clockwise
    first = np.stack([corner, below, below + 1], axis=2)
    second = np.stack([corner, below + 1, corner + 1], axis=2)
    return np.stack([first, second], axis=2).reshape(-1, 3).astype(np.int64)


def _is_pole_sliver(faces: NDArray[np.int64], rings: int) -> NDArray[np.bool_]:
    return _starts_at_first_ring(faces) | (np.sum(faces >= rings * (AROUND + 1), axis=1) == 2)


def _starts_at_first_ring(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    return np.asarray(np.sum(faces <= AROUND, axis=1) == 2)
