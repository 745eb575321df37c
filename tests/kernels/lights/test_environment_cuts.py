"""Cut points of an environment's shares: the patch that any number chooses lies between those that the number names."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.kernels.lights.environment import cumulative_shares, cut_points


def weights(kind: str, rows: int, columns: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    weight = rng.uniform(0.0, 1.0, (rows, columns))
    if kind == "sun":
        weight[rows // 2, columns // 3] = 1e6
    if kind == "night":
        weight[:] = 0.0
    if kind == "holes":
        weight[:, columns // 4 :] = 0.0
        weight[0, :-1] = 0.0
    return weight


@pytest.mark.parametrize("kind", ["even", "sun", "night", "holes"])
@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 2), (3, 7), (5, 64), (4, 1000)])
def test_what_a_number_chooses_lies_between_its_cut_points(kind: str, rows: int, columns: int) -> None:
    shares = cumulative_shares(weights(kind, rows, columns))
    cuts = cut_points(shares)
    m = cuts.shape[1] - 1
    assert m & (m - 1) == 0
    of_cuts = np.arange(m, dtype=np.float32) / np.float32(m)
    for row, first_last in zip(shares, cuts, strict=True):
        u = np.concatenate([of_cuts, np.nextafter(of_cuts, np.float32(-1)), row, np.nextafter(row, np.float32(-1))])
        u = u[(u >= 0.0) & (u < 1.0)]
        chosen = np.minimum(np.searchsorted(row, u, side="right"), columns - 1)
        cut = (u * np.float32(m)).astype(np.int32)
        assert np.all(first_last[cut] <= chosen)
        assert np.all(chosen <= first_last[cut + 1])


def test_few_patches_lie_between_cut_points_of_an_even_sky() -> None:
    cuts = cut_points(cumulative_shares(np.ones((2, 1024))))
    assert np.diff(cuts, axis=1).max() <= 4
