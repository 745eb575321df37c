"""Triangles as seen from a place: solid angles against closed forms, and points that are even over them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.maths.spherical_triangle import direction_in_triangle, solid_angle, weights_seen

Array = NDArray[np.float64]

ERRORS = 5.0
AXES = np.eye(3)
SHAPES: dict[str, Any] = {
    "an octant": AXES,
    "wide": [[3, -2, 0.1], [-3, -2, 0.1], [0, 4, 0.1]],
    "far away": [[100, 0, 100], [101, 0, 100], [100, 1, 100]],
    "a sliver": [[-1, 0, 1], [1, 0, 1], [0, 1e-3, 1]],
    "edge-on": [[1, -1, 1e-4], [1, 1, 1e-4], [3, 0, 1e-4]],
    "close by": [[1e-2, -1, 1], [1e-2, 1, 1], [1e-2, 0, -1]],
}
EVERY = pytest.mark.parametrize("name", SHAPES)


@wp.kernel(enable_backward=False)
def _angles(corners: wp.array2d[wp.vec3d], angle_out: wp.array[wp.float64]) -> None:
    i = wp.tid()
    angle_out[i] = solid_angle(corners[i, 0], corners[i, 1], corners[i, 2])


@wp.kernel(enable_backward=False)
def _samples(
    corners: wp.array[wp.vec3d],
    u: wp.array[wp.vec2d],
    direction_out: wp.array[wp.vec3d],
    weights_out: wp.array[wp.vec2],
) -> None:
    i = wp.tid()
    a = corners[0]
    b = corners[1]
    c = corners[2]
    direction = direction_in_triangle(a, b, c, solid_angle(a, b, c), u[i])
    direction_out[i] = direction
    weights_out[i] = weights_seen(a, b, c, direction)


def angles(corners: Any) -> Array:
    """Solid angles of triangles, shape [N]."""
    rows = np.asarray(corners, np.float64).reshape(-1, 3, 3)
    out = wp.empty(len(rows), dtype=wp.float64)
    wp.launch(_angles, len(rows), inputs=[wp.array(rows, dtype=wp.vec3d)], outputs=[out])
    return np.asarray(out.numpy())


def samples(corners: Any, u: Array) -> tuple[Array, Array]:
    """Directions, and weights of all three corners, for points of the unit square."""
    out = [wp.empty(len(u), dtype=wp.vec3d), wp.empty(len(u), dtype=wp.vec2)]
    inputs = [wp.array(np.asarray(corners, np.float64), dtype=wp.vec3d), wp.array(u, dtype=wp.vec2d)]
    wp.launch(_samples, len(u), inputs=inputs, outputs=out)
    weights = out[1].numpy().astype(np.float64)
    return out[0].numpy(), np.column_stack([1 - weights.sum(axis=1), weights])


def spherical_excess(corners: Array) -> float:
    """Girard's formula: the sum of the angles between the planes of the sides, less pi."""
    a, b, c = (np.asarray(corner, np.float64) for corner in corners)
    sides = [np.cross(a, b), np.cross(b, c), np.cross(c, a)]
    sides = [side / np.linalg.norm(side) for side in sides]
    return float(sum(math.acos(-sides[i] @ sides[i - 1]) for i in range(3)) - math.pi)


def test_solid_angles_of_closed_form() -> None:
    half = [[math.cos(t), math.sin(t), 1e-9] for t in (0, 2 * math.pi / 3, 4 * math.pi / 3)]
    flat = [[1, 0, 0], [0, 1, 0], [-1, -1, 0]]
    found = angles([AXES, AXES[::-1], half, flat])
    np.testing.assert_allclose(found, [math.pi / 2, math.pi / 2, 2 * math.pi, 0.0], rtol=1e-8, atol=1e-15)


@EVERY
def test_solid_angles_against_girard(name: str) -> None:
    np.testing.assert_allclose(angles(SHAPES[name]), spherical_excess(SHAPES[name]), rtol=1e-8, atol=1e-11)


def test_a_small_solid_angle_is_area_over_squared_distance() -> None:
    """Where Girard's formula has no digits left."""
    corners = np.array([[0, 0, 1], [1e-6, 0, 1], [0, 1e-6, 1]])
    np.testing.assert_allclose(angles(corners), 5e-13, rtol=1e-5)


def quarters(corners: Array, levels: int) -> list[Array]:
    """A triangle cut into 4^levels parts by the middles of its sides."""
    parts = [np.asarray(corners, np.float64)]
    for _ in range(levels):
        finer = []
        for a, b, c in parts:
            ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
            finer += [np.array(part) for part in ([a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca])]
        parts = finer
    return parts


@EVERY
def test_points_are_even_over_the_solid_angle(name: str) -> None:
    """Chi-square of how many fall into each of 64 parts of the triangle, which are seen under very different angles."""
    corners = np.asarray(SHAPES[name], np.float64)
    count = 1 << 16
    u = np.random.default_rng(1).random((count, 2))
    direction, weights = samples(corners, u)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0, rtol=1e-9)
    assert weights.min() >= -1e-6
    point = weights @ corners
    seen = point / np.linalg.norm(point, axis=1, keepdims=True)
    np.testing.assert_allclose(seen, direction, atol=2e-5)  # weights are float32

    parts = quarters(corners, 3)
    share = angles(parts) / angles(corners)
    np.testing.assert_allclose(share.sum(), 1.0, rtol=1e-6)
    expected = share * count
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    row = np.full(count, -1)
    for number, (a, b, c) in enumerate(parts):
        sides = [np.cross(q - p, point - p) @ normal for p, q in ((a, b), (b, c), (c, a))]
        row[(row < 0) & (np.min(sides, axis=0) >= -1e-9 * (normal @ normal))] = number
    counts = np.bincount(row[row >= 0], minlength=len(parts))
    assert (row < 0).mean() < 1e-3
    many = expected > 8
    chi2 = ((counts - expected)[many] ** 2 / expected[many]).sum()
    degrees = many.sum() - 1
    assert (chi2 - degrees) / math.sqrt(2 * degrees) < ERRORS


@EVERY
def test_the_corners_of_the_square_are_corners_of_the_triangle(name: str) -> None:
    """So a grid of points in the square is a grid, bent but without folds, on the triangle."""
    corner = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    direction, _ = samples(SHAPES[name], corner)
    a, b, c = (np.asarray(p, np.float64) / np.linalg.norm(p) for p in SHAPES[name])
    for found, expected in zip(direction, (b, a, b, c), strict=True):
        np.testing.assert_allclose(found, expected, atol=2e-5)
