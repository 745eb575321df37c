"""4x4 matrices of Mitsuba's transforms; they multiply column vectors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Matrix = NDArray[np.float64]

_IDENTITY = np.eye(4)
_ROWS_AT_ONCE = 1 << 16


def translation(offset: ArrayLike) -> Matrix:
    """Moves by offset, shape [3]."""
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def scaling(factors: ArrayLike) -> Matrix:
    """Scales each axis by its factor, shape [3]."""
    matrix = np.eye(4)
    matrix[[0, 1, 2], [0, 1, 2]] = factors
    return matrix


def rotation(axis: ArrayLike, degrees: float) -> Matrix:
    """Turns counter-clockwise around an axis that points at the onlooker (Rodrigues' formula).

    Raises:
        ValueError: the axis is zero.
    """
    direction = np.asarray(axis, dtype=np.float64)
    length = np.linalg.norm(direction)
    if not length > 0:
        raise ValueError("the axis is zero")
    x, y, z = direction / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.radians(degrees)
    matrix = np.eye(4)
    matrix[:3, :3] += math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    return matrix


def look_at(origin: ArrayLike, target: ArrayLike, up: ArrayLike) -> Matrix:
    """Puts the origin at `origin` and turns +z to `target` and +y near `up`; +x is left, as Mitsuba has it.

    Raises:
        ValueError: origin and target coincide, or up is parallel to the line of sight.
    """
    eye = np.asarray(origin, dtype=np.float64)
    forward = np.asarray(target, dtype=np.float64) - eye
    if not np.linalg.norm(forward) > 0:
        raise ValueError("origin and target are the same point")
    forward /= np.linalg.norm(forward)
    left = np.cross(np.asarray(up, dtype=np.float64), forward)
    if not np.linalg.norm(left) > 1e-9 * np.linalg.norm(up):
        raise ValueError("up is parallel to the line from origin to target")
    left /= np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([left, np.cross(forward, left), forward, eye], axis=1)
    return matrix


def facing_forward(node: Matrix) -> Matrix:
    """Where a camera or light is that looks along its -z with +x to the right, as in glTF: ours look along +z, +x left.

    The axes get unit length: scale means nothing to either.
    """
    matrix = np.asarray(node @ np.diag([-1.0, 1.0, -1.0, 1.0]))
    matrix[:3, :3] /= np.linalg.norm(matrix[:3, :3], axis=0)
    return matrix


def mirrors(matrix: Matrix) -> bool:
    """Whether left and right change places: the sign of the determinant, of any scale without overflow."""
    return bool(np.linalg.slogdet(matrix[:3, :3])[0] < 0)


def apply_to_points(matrix: Matrix, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Maps points, shape [N, 3], by an affine matrix."""
    if np.array_equal(matrix, _IDENTITY):
        return points + 0.0  # as products and sums would have it, of minus zero too
    moved = np.asarray(points @ matrix[:3, :3].T)
    moved += matrix[:3, 3]
    return moved


def placed(matrix: Matrix, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Maps points, shape [..., 3], by the first three rows of an affine matrix, shape [3 or 4, 4].

    Products are added in a fixed order, one rounding each: what kernels compute of the same numbers has the same bits
    (kernels.rays.instances). A matrix product of NumPy has whatever order its library takes.
    """
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    rows = [matrix[a, 0] * x + matrix[a, 1] * y + matrix[a, 2] * z + matrix[a, 3] for a in range(3)]
    return np.stack(rows, axis=-1)


def apply_to_normals(matrix: Matrix, normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Maps normals, shape [N, 3], by the inverse transpose; the results have unit length, zero stays zero.

    Raises:
        ValueError: the matrix has no inverse.
    """
    try:
        inverse = np.linalg.inv(matrix[:3, :3])
    except np.linalg.LinAlgError as error:
        raise ValueError("the transform flattens space: its matrix has no inverse") from error
    turned = normals + 0.0 if np.array_equal(inverse, _IDENTITY[:3, :3]) else np.asarray(normals @ inverse)
    return _normalize(turned, out=turned)


def normalized(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors, shape [N, 3], scaled to unit length; zero stays zero."""
    return _normalize(vectors, out=np.empty_like(vectors))


def _normalize(vectors: NDArray[np.float64], out: NDArray[np.float64]) -> NDArray[np.float64]:
    """As `normalized`; out may be the vectors themselves."""
    for first in range(0, len(vectors), _ROWS_AT_ONCE):
        block = slice(first, first + _ROWS_AT_ONCE)
        squares = vectors[block] * vectors[block]
        lengths = np.sqrt(squares[:, 0] + squares[:, 1] + squares[:, 2])  # a sum along rows of three takes longer
        proper = lengths > 0
        if proper.all():
            np.divide(vectors[block], lengths[:, None], out=out[block])
        else:
            np.divide(vectors[block], lengths[:, None], out=out[block], where=proper[:, None])
            out[block][~proper] = 0.0
    return out
