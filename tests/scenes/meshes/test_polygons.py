"""Polygons of mesh files as triangles: concave ones are covered, and no more than they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from wdpm.scenes.meshes.obj import read_obj
from wdpm.scenes.meshes.ply import read_ply
from wdpm.scenes.meshes.polygons.cutting import triangulate, triangulate_fans

L_SHAPE = [(-1, 0), (1, 0), (1, 2), (0.9, 2), (0.9, 0.1), (-1, 0.1)]
# a square with a square hole in it, to which a bridge leads: its ends come twice
FRAME = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
MIDDLES = [(0, 0), (1, 0), (2, 0), (2, 2), (1, 2), (1, 1), (0, 1)]


def in_space(flat: list[tuple[float, float]], seed: int = 1) -> NDArray[np.float64]:
    """Corners in a plane that leans, far from the origin."""
    random = np.random.default_rng(seed)
    across, _ = np.linalg.qr(random.normal(size=(3, 3)))
    return np.array(flat, np.float64) @ across[:2] + random.uniform(-50, 50, 3)


def area_vectors(places: NDArray[np.float64], corners: NDArray[np.int64]) -> NDArray[np.float64]:
    a, b, c = (places[corners[:, k]] for k in range(3))
    vectors: NDArray[np.float64] = np.cross(b - a, c - a) / 2
    return vectors


def check_covered(places: NDArray[np.float64], corners: NDArray[np.int64]) -> None:
    """All triangles face one way, and their areas are the polygon's."""
    around = np.cross(places - places[0], np.roll(places, -1, axis=0) - places[0]).sum(axis=0) / 2
    found = area_vectors(places, corners)
    np.testing.assert_allclose(found.sum(axis=0), around, atol=1e-9)
    assert np.linalg.norm(found, axis=1).sum() == pytest.approx(np.linalg.norm(around), rel=1e-9)


@pytest.mark.parametrize("flat", [L_SHAPE, FRAME, MIDDLES])
def test_concave_polygons_are_covered_whichever_corner_is_first(flat: list[tuple[float, float]]) -> None:
    for first in range(len(flat)):
        for turned in (flat[first:] + flat[:first], (flat[first:] + flat[:first])[::-1]):
            places = in_space(turned)
            corners, _ = triangulate(np.array([len(flat)]), np.arange(len(flat)), places)
            check_covered(places, corners)


@given(st.lists(st.floats(0.05, 1.0), min_size=4, max_size=40), st.integers(0, 100))
def test_stars_are_covered(radii: list[float], seed: int) -> None:
    angles = np.arange(len(radii)) * (2 * np.pi / len(radii))
    places = in_space(list(zip(radii * np.cos(angles), radii * np.sin(angles), strict=True)), seed)
    corners, _ = triangulate(np.array([len(radii)]), np.arange(len(radii)), places)
    check_covered(places, corners)


def test_polygons_beside_each_other_keep_their_places() -> None:
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    counts = np.array([4, 3, 6, 4])
    places = np.concatenate([in_space(square), in_space(square[:3]), in_space(L_SHAPE), in_space(square)])
    corners, polygon = triangulate(counts, np.arange(17), places)
    fans, of_fans = triangulate_fans(counts)
    np.testing.assert_array_equal(polygon, of_fans)
    np.testing.assert_array_equal(corners[polygon != 2], fans[polygon != 2])
    check_covered(places[7:13], corners[polygon == 2] - 7)


def test_edges_that_cross_leave_a_fan() -> None:
    bow = in_space([(0, 0), (3, 3), (3, 0), (0, 1), (1, 4)])
    corners, _ = triangulate(np.array([5]), np.arange(5), bow)
    assert len(corners) == 3


def test_files_with_a_concave_face(tmp_path: Path) -> None:
    rows = [f"{x} {y} 0" for x, y in L_SHAPE]
    (tmp_path / "m.obj").write_text("".join(f"v {row}\n" for row in rows) + "f 3 4 5 6 1 2\n")
    head = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "m.ply").write_text(head + "\n".join(rows) + "\n6 2 3 4 5 0 1\n")
    for mesh in (read_obj(tmp_path / "m.obj").mesh, read_ply(tmp_path / "m.ply")):
        vectors = area_vectors(mesh.vertices, mesh.faces)
        assert vectors[:, 2].min() > 0
        assert vectors[:, 2].sum() == pytest.approx(0.39, rel=1e-6)  # 2 x 0.1 below and 0.1 x 1.9 on it
