"""Areas and normals of triangles that float32 has no digits for."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from wdpm.scenes.flat.areas import triangle_areas, triangle_normals


def test_areas_of_needles() -> None:
    """1 : 1e6 and thinner: against exact numbers."""
    rng = np.random.default_rng(1)
    start, along, across = (rng.uniform(-1, 1, (50, 3)) for _ in range(3))
    corners = np.stack([start, start + along, start + 0.5 * along + 1e-6 * across], axis=1).astype(np.float32)
    for triangle, area, normal in zip(corners, triangle_areas(corners), triangle_normals(corners), strict=True):
        a, b, c = ([Fraction(float(x)) for x in corner] for corner in triangle)
        u, v = ([p - q for p, q in zip(corner, a, strict=True)] for corner in (b, c))
        cross = [u[i - 2] * v[i - 1] - u[i - 1] * v[i - 2] for i in range(3)]
        exact = np.array([float(x) for x in cross])
        assert area == pytest.approx(0.5 * np.linalg.norm(exact), rel=1e-7)
        np.testing.assert_allclose(normal, exact / np.linalg.norm(exact), atol=1e-6)


def test_areas_in_any_unit() -> None:
    """Their squares leave float32's range on both sides."""
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    for size in (1e-18, 1e-12, 1.0, 1e12, 1e18):
        assert triangle_areas((size * corners).astype(np.float32))[0] == pytest.approx(0.5 * size**2, rel=1e-6)
