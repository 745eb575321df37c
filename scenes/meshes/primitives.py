"""Mitsuba's simple shapes as triangles, with its orientation and texture coordinates.

Curved shapes have `around` segments around their axis, and a sphere has half as many rings. Their vertices lie on the
surface, and normals interpolated over a triangle are exact: those of a sphere point away from its centre everywhere.
So a ray that is reflected or refracted goes where it would on the round shape, from a place that is off by at most
radius * (pi / around)² / 2, as silhouettes are: 0.03 % of the radius with 128 segments. Areas are off by about as
much. With `true_area` a shape, a lamp, is larger by as much as it takes to have the area of the round one. Shapes are
watertight: seams and poles repeat positions bit for bit.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.meshes.mesh_data import MeshData

AROUND = 128  # segments; a sphere then has 16,128 triangles
FEWEST_AROUND = 32  # of many spheres, which are then small in the image
SPHERE_BUDGET = 1 << 19  # triangles of all spheres of a scene together, before they become coarser
DISK_RINGS = 8  # the texture's radius and angle are interpolated in each ring


def segments_around(spheres: int) -> int:
    """Segments for the curved shapes of a scene.

    Args:
        spheres: how many of them the scene has.
    """
    share = math.isqrt(SPHERE_BUDGET // max(spheres, 1))  # a sphere has about as many triangles as segments squared
    return max(FEWEST_AROUND, min(AROUND, share // 16 * 16))


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


def sphere(around: int = AROUND, *, true_area: bool = False) -> MeshData:
    """The unit sphere at the origin; it faces outwards. u goes around z from +x, v from the pole at +z to the other.

    Args:
        around: segments around the axis, even.
        true_area: whether it has the area of the round sphere, and then vertices a little outside of it.
    """
    rings = around // 2
    steps = np.arange(rings + 1)
    mesh = _sphere(_circle(around), np.pi * steps / rings, np.arange(around + 1) / around, steps / rings)
    scale = math.sqrt(4.0 * math.pi / _area(mesh.vertices, mesh.faces)) if true_area else 1.0
    return replace(mesh, vertices=mesh.vertices * scale)


def sphere_of(us: NDArray[np.float64], vs: NDArray[np.float64]) -> MeshData:
    """The unit sphere with vertices at given texture coordinates.

    Args:
        us, vs: growing, from 0 to 1.
    """
    angle = 2.0 * np.pi * np.append(us[:-1], 0.0)  # the last repeats the first bit for bit
    return _sphere(np.stack([np.cos(angle), np.sin(angle)], axis=1), np.pi * vs, us, vs)


def _sphere(
    circle: NDArray[np.float64], theta: NDArray[np.float64], us: NDArray[np.float64], vs: NDArray[np.float64]
) -> MeshData:
    """The unit sphere with rings at angles from +z, and circle's points on each."""
    rings, around = len(theta) - 1, len(circle) - 1
    sin, cos = np.sin(theta), np.cos(theta)
    sin[[0, -1]] = 0.0  # sin(pi) is not quite 0 in floating point, and poles must be points
    normals = np.concatenate(
        [circle[None, :, :] * sin[:, None, None], np.broadcast_to(cos[:, None, None], (rings + 1, around + 1, 1))],
        axis=2,
    )
    u = np.broadcast_to(us, (rings + 1, around + 1)).copy()
    u[0, :-1] = u[-1, 1:] = (us[:-1] + us[1:]) / 2.0  # at a pole each triangle has a vertex of its own, in mid-segment
    v = np.broadcast_to(vs[:, None], u.shape)
    faces = _grid_faces(rings, around)
    faces = faces[~_is_pole_sliver(faces, rings, around)]
    flat = normals.reshape(-1, 3)
    return MeshData(flat, faces, flat, np.stack([u, v], axis=2).reshape(-1, 2))


def disk(around: int = AROUND, *, true_area: bool = False) -> MeshData:
    """The unit disk in the plane z = 0; it faces +z. u is the distance from the centre, v goes around from +x."""
    radius = np.arange(DISK_RINGS + 1) / DISK_RINGS
    plane = radius[:, None, None] * _circle(around)[None, :, :]
    vertices = np.concatenate([plane, np.zeros((*plane.shape[:2], 1))], axis=2).reshape(-1, 3)
    u = np.broadcast_to(radius[:, None], plane.shape[:2])
    v = np.broadcast_to(np.arange(around + 1) / around, plane.shape[:2]).copy()
    v[0] += 0.5 / around
    faces = _grid_faces(DISK_RINGS, around)
    faces = faces[~_starts_at_first_ring(faces, around)]
    normals = np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
    scale = math.sqrt(math.pi / _area(vertices, faces)) if true_area else 1.0
    return MeshData(vertices * scale, faces, normals, np.stack([u, v], axis=2).reshape(-1, 2))


def cylinder(around: int = AROUND, *, true_area: bool = False) -> MeshData:
    """The side of a cylinder of radius 1, z from 0 to 1, without caps; it faces outwards. u goes around, v along z."""
    circle = _circle(around)
    ends = [np.concatenate([circle, np.full((around + 1, 1), height)], axis=1) for height in (1.0, 0.0)]
    normals = np.tile(np.concatenate([circle, np.zeros((around + 1, 1))], axis=1), (2, 1))
    u = np.tile(np.arange(around + 1) / around, 2)
    uvs = np.stack([u, np.repeat([1.0, 0.0], around + 1)], axis=1)
    vertices, faces = np.concatenate(ends), _grid_faces(1, around)
    scale = 2.0 * math.pi / _area(vertices, faces) if true_area else 1.0
    return MeshData(vertices * (scale, scale, 1.0), faces, normals, uvs)


def _area(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2.0


def _circle(around: int) -> NDArray[np.float64]:
    """Points of the unit circle, shape [around + 1, 2]; the last repeats the first bit for bit."""
    angle = 2.0 * np.pi * (np.arange(around + 1) % around) / around
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """Two triangles for every cell of a grid of (rows + 1) x (columns + 1) vertices, shape [2 * rows * columns, 3]."""
    corner = np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)[None, :]
    below = corner + columns + 1
    # with rows going down and columns to the right, seen from the front, this is counter-clockwise
    first = np.stack([corner, below, below + 1], axis=2)
    second = np.stack([corner, below + 1, corner + 1], axis=2)
    return np.stack([first, second], axis=2).reshape(-1, 3).astype(np.int64)


def _is_pole_sliver(faces: NDArray[np.int64], rings: int, around: int) -> NDArray[np.bool_]:
    return _starts_at_first_ring(faces, around) | (np.sum(faces >= rings * (around + 1), axis=1) == 2)


def _starts_at_first_ring(faces: NDArray[np.int64], around: int) -> NDArray[np.bool_]:
    return np.asarray(np.sum(faces <= around, axis=1) == 2)
