"""Connected pieces of triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.kernels.lights.pieces import pieces_of


def by_search(corners: NDArray[np.float32]) -> NDArray[np.intp]:
    """Pieces by labels that spread from corner to corner until none changes."""
    places = [[(float(x) + 0.0, float(y) + 0.0, float(z) + 0.0) for x, y, z in triangle] for triangle in corners]
    label, before = np.arange(len(corners)), np.full(len(corners), -1)
    while not np.array_equal(label, before):
        before = label.copy()
        least: dict[tuple[float, float, float], int] = {}
        for number, triangle in zip(label.tolist(), places, strict=True):
            for place in triangle:
                least[place] = min(least.get(place, number), number)
        label = np.array([min(least[place] for place in triangle) for triangle in places])
    return label


def test_pieces_are_those_that_share_corners() -> None:
    """Triangles with corners on a coarse lattice, of which some have many neighbours and some none; in any order."""
    for seed, size in enumerate((4, 8, 12, 20)):
        corners = np.random.default_rng(seed).integers(0, size, (200, 3, 3)).astype(np.float32)
        wanted = by_search(corners)
        np.testing.assert_array_equal(pieces_of(corners), wanted)
        order = np.random.default_rng(seed + 9).permutation(200)
        np.testing.assert_array_equal(pieces_of(corners[order]), by_search(corners[order]))
        assert len(np.unique(wanted)) > 1 or size < 12


def test_a_zero_has_no_sign() -> None:
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[-0.0, -0.0, -0.0], [2, 0, 3], [0, 2, 3]]], np.float32)
    np.testing.assert_array_equal(pieces_of(corners), [0, 0])


def test_a_long_chain_is_one_piece() -> None:
    """Each triangle shares a corner with the next one, whose numbers go up and down."""
    start = np.random.default_rng(2).permutation(5000).astype(np.float32)
    corners = np.zeros((5000, 3, 3), np.float32)
    corners[:, 0, 0], corners[:, 1, 0] = start, start + 1
    corners[:, 2] = np.arange(5000)[:, None] + np.array([0, 7, 9], np.float32)
    np.testing.assert_array_equal(pieces_of(corners), 0)


def test_no_triangles_have_no_pieces() -> None:
    assert pieces_of(np.zeros((0, 3, 3), np.float32)).shape == (0,)
