"""The pieces that the atrium is put together from: turned, arched, vaulted and draped surfaces of any fineness.

All are built once and then copied to their places. y is up; lengths in metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wdpm.scenes.meshes.mesh_data import MeshData

# fmt: off
# Outlines as (radius, height) from bottom to top; heights are scaled to the piece.
COLUMN = (
    (0.50, 0.00), (0.50, 0.02), (0.56, 0.035), (0.50, 0.05), (0.44, 0.06), (0.47, 0.07), (0.42, 0.085), (0.385, 0.10),
    (0.38, 0.40), (0.36, 0.65), (0.33, 0.86), (0.37, 0.87), (0.34, 0.885), (0.36, 0.90), (0.47, 0.95), (0.52, 1.0),
)
BALUSTER = (
    (0.085, 0.00), (0.085, 0.06), (0.055, 0.09), (0.045, 0.14), (0.075, 0.24), (0.095, 0.36),
    (0.085, 0.48), (0.055, 0.64), (0.042, 0.80), (0.050, 0.88), (0.070, 0.92), (0.085, 1.00),
)
FOUNTAIN = (
    (1.55, 0.00), (1.60, 0.10), (1.50, 0.14), (1.52, 0.25), (1.62, 0.27), (1.60, 0.30), (1.45, 0.28), (1.40, 0.18),
    (0.50, 0.15), (0.30, 0.20), (0.22, 0.30), (0.26, 0.46), (0.30, 0.52), (0.78, 0.60), (0.86, 0.64), (0.80, 0.65),
    (0.35, 0.60), (0.16, 0.63), (0.12, 0.75), (0.18, 0.80), (0.14, 0.90), (0.05, 0.97), (0.004, 1.0),
)
# how far it stands out, and its height in metres
CORNICE = (
    (0.00, 0.00), (0.08, 0.00), (0.08, 0.10), (0.14, 0.14), (0.17, 0.20), (0.28, 0.24),
    (0.28, 0.34), (0.33, 0.36), (0.36, 0.42), (0.36, 0.46), (0.00, 0.50),
)
# fmt: on


def resample(outline: Sequence[tuple[float, float]], rows: int) -> NDArray[np.float64]:
    """An outline as rows + 1 points at even distances along it, shape [rows + 1, 2]; its ends are kept."""
    points = np.array(outline)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], rows + 1)
    return np.stack([np.interp(at, along, points[:, axis]) for axis in range(2)], axis=1)


def turned(outline: Sequence[tuple[float, float]], height: float, around: int, rows: int) -> MeshData:
    """An outline turned around the y axis, standing on y = 0; open at its ends. 2 * around * rows triangles, smooth."""
    profile = resample(outline, rows)
    angle = 2.0 * np.pi * np.arange(around) / around
    ring = np.stack([np.cos(angle), np.zeros(around), np.sin(angle)], axis=1)
    vertices = profile[:, 0, None, None] * ring + (height * profile[:, 1])[:, None, None] * np.array([0.0, 1.0, 0.0])
    return MeshData(vertices.reshape(-1, 3), _grid(rows, around, wrap=True)).smooth()


def arch(
    radius: float, thickness: float, bay: float, spring: float, top: float, segments: int, roll: int
) -> list[MeshData]:
    """A wall from the springing height to the top with a half-round opening, and a moulding around the opening.

    The wall is `bay` wide along x, centred on x = 0 and z = 0; its front faces +z.
    """
    angle = np.pi * (1.0 - np.arange(segments + 1) / segments)
    x, y = radius * np.cos(angle), spring + radius * np.sin(angle)
    half = thickness / 2.0
    sheets = []
    for z in (half, -half):
        below = np.stack([x, y, np.full_like(x, z)], axis=1)
        above = np.stack([x, np.full_like(x, top), np.full_like(x, z)], axis=1)
        strip = MeshData(np.concatenate([below, above]), _grid(1, segments))
        sides = [box_side(s * (radius + bay / 2.0) / 2.0, bay / 2.0 - radius, spring, top, z) for s in (-1.0, 1.0)]
        wall = merged([strip, *sides])
        sheets.append(wall if z > 0 else wall.flipped())
    soffit = np.stack([np.stack([x, y, np.full_like(x, z)], axis=1) for z in (-half, half)])
    inside = MeshData(soffit.reshape(-1, 3), _grid(1, segments)).smooth()
    return [merged(sheets), merged_smooth([inside, _roll(radius, spring, half, segments, roll)])]


def _roll(radius: float, spring: float, z: float, segments: int, around: int) -> MeshData:
    """A round moulding along a half circle. 2 * segments * around triangles."""
    along = np.pi * (1.0 - np.arange(segments + 1) / segments)
    section = 2.0 * np.pi * np.arange(around) / around
    distance = radius + 0.12 + 0.09 * np.cos(section)
    vertices = np.stack(
        [
            np.cos(along)[:, None] * distance,
            spring + np.sin(along)[:, None] * distance,
            np.broadcast_to(z + 0.09 * np.sin(section), (segments + 1, around)),
        ],
        axis=2,
    )
    return MeshData(vertices.reshape(-1, 3), _grid(segments, around, wrap=True)).smooth()


def box_side(x: float, width: float, bottom: float, top: float, z: float) -> MeshData:
    """An upright rectangle that faces +z."""
    left, right = x - width / 2.0, x + width / 2.0
    corners = [(left, bottom, z), (right, bottom, z), (right, top, z), (left, top, z)]
    return quad(corners)


def groin_vault(half: float, spring: float, rise: float, cells: int) -> MeshData:
    """Two half-round vaults that cross over a square of side 2 * half; faces down. 2 * cells² triangles; cells even."""
    at = np.linspace(-1.0, 1.0, cells + 1)
    curve = np.sqrt(np.maximum(1.0 - at**2, 0.0))
    height = spring + rise * np.maximum(curve[:, None], curve[None, :])
    z, x = np.meshgrid(half * at, half * at, indexing="ij")
    return MeshData(np.stack([x, height, z], axis=2).reshape(-1, 3), _grid(cells, cells))


def draped(width: float, height: float, cells: int, folds: float, depth: float) -> MeshData:
    """A cloth that hangs down from y = 0, its folds growing towards the hem. 2 * cells² triangles, smooth."""
    u = np.linspace(0.0, 1.0, cells + 1)
    v, across = np.meshgrid(u, u, indexing="ij")
    wave = depth * (0.35 + 0.65 * v) * np.sin(2.0 * np.pi * folds * across + 0.8 * np.sin(3.0 * v))
    grid = np.stack([width * (across - 0.5), -height * v, wave], axis=2)
    return MeshData(grid.reshape(-1, 3), _grid(cells, cells)).smooth()


def sail(span: float, width: float, sag: float, cells: int) -> MeshData:
    """A cloth that hangs between two walls at z = -span / 2 and span / 2. 2 * cells² triangles, smooth."""
    u = np.linspace(-1.0, 1.0, cells + 1)
    z, x = np.meshgrid(u, u, indexing="ij")
    height = -sag * (1.0 - z**2) + 0.12 * np.cos(np.pi * 2.5 * x) * (1.0 - 0.5 * z**2)
    grid = np.stack([0.5 * width * x, height, 0.5 * span * z], axis=2)
    return MeshData(grid.reshape(-1, 3), _grid(cells, cells)).smooth()


def cornice(half_x: float, half_z: float, rows: int) -> MeshData:
    """A moulding around the inside of a rectangular court, mitred at its corners. 8 * rows triangles, flat."""
    profile = resample(CORNICE, rows)
    corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    inwards = np.array([half_x, half_z]) - profile[:, 0, None]
    plan = corners[None, :, :] * inwards[:, None, :]
    vertices = np.stack([plan[..., 0], np.broadcast_to(profile[:, 1, None], plan.shape[:2]), plan[..., 1]], axis=2)
    return MeshData(vertices.reshape(-1, 3), _grid(rows, 4, wrap=True)[:, ::-1])


def floor(half_x: float, half_z: float, cells_x: int, cells_z: int, tile: float) -> MeshData:
    """A level rectangle that faces up, with texture coordinates that count tiles. 2 * cells_x * cells_z triangles."""
    z, x = np.meshgrid(
        np.linspace(-half_z, half_z, cells_z + 1), np.linspace(-half_x, half_x, cells_x + 1), indexing="ij"
    )
    vertices = np.stack([x, np.zeros_like(x), z], axis=2).reshape(-1, 3)
    return MeshData(vertices, _grid(cells_z, cells_x), uvs=vertices[:, [0, 2]] / tile)


def box(low: ArrayLike, high: ArrayLike) -> MeshData:
    """An axis-aligned box that faces outwards. 12 triangles."""
    ends = np.array([low, high], dtype=np.float64)
    choice = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
    sides = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    return MeshData(ends[choice, [0, 1, 2]], np.array(faces, dtype=np.int64))


def quad(corners: ArrayLike) -> MeshData:
    """A quadrilateral, counter-clockwise seen from the front, shape [4, 3]."""
    return MeshData(np.asarray(corners, dtype=np.float64), np.array([[0, 1, 2], [0, 2, 3]]))


def merged(meshes: Sequence[MeshData]) -> MeshData:
    """Several flat meshes as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)])
    return MeshData(np.concatenate([mesh.vertices for mesh in meshes]), faces)


def merged_smooth(meshes: Sequence[MeshData]) -> MeshData:
    """Several smooth meshes as one."""
    return replace(merged(meshes), normals=np.concatenate([mesh.smooth().normals for mesh in meshes]))


def copied(mesh: MeshData, offsets: ArrayLike, degrees: ArrayLike = 0.0) -> MeshData:
    """A mesh copied to several places.

    Args:
        offsets: shape [K, 3].
        degrees: turn around the y axis before moving, shape [K] or one for all; 90 turns +z to +x.
    """
    at = np.asarray(offsets, dtype=np.float64).reshape(-1, 3)
    angle = np.broadcast_to(np.radians(np.asarray(degrees, dtype=np.float64)), len(at))
    count, size = len(at), len(mesh.vertices)
    turn = np.zeros((count, 3, 3))
    turn[:, 0, 0] = turn[:, 2, 2] = np.cos(angle)
    turn[:, 0, 2], turn[:, 2, 0] = np.sin(angle), -np.sin(angle)
    turn[:, 1, 1] = 1.0
    vertices = np.einsum("kij,vj->kvi", turn, mesh.vertices) + at[:, None, :]
    normals = None if mesh.normals is None else np.einsum("kij,vj->kvi", turn, mesh.normals).reshape(-1, 3)
    faces = mesh.faces[None, :, :] + (size * np.arange(count))[:, None, None]
    uvs = None if mesh.uvs is None else np.tile(mesh.uvs, (count, 1))
    return MeshData(vertices.reshape(-1, 3), faces.reshape(-1, 3), normals, uvs)


def _grid(rows: int, columns: int, *, wrap: bool = False) -> NDArray[np.int64]:
    """Two triangles a cell of a grid of vertices, row by row; with `wrap` the last column joins the first."""
    width = columns if wrap else columns + 1
    row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = row * width + column
    b = row * width + (column + 1) % width
    return np.stack([a, a + width, b, b, a + width, b + width], axis=2).reshape(-1, 3)
