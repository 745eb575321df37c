"""Which photons and surface points lie in the band around a cell."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.cluster.work.overlap_band import rows_near
from wdpm.kernels.rays.cells import FAR_AWAY

LOW = np.array([0.25, -FAR_AWAY, 0.5], np.float32)
HIGH = np.array([0.5, 0.5, FAR_AWAY], np.float32)


@pytest.mark.parametrize("distance", [0.0, 0.125, 10.0])
@pytest.mark.parametrize("count", [0, 1, 5000])
def test_places_near_a_box_are_no_further_from_its_nearest_point(count: int, distance: float) -> None:
    position = np.random.default_rng(3).uniform(-0.5, 1.5, (count, 3)).astype(np.float32)
    position[: count // 4] = np.round(position[: count // 4] * 8) / 8  # on the box, and just so far away
    away = (np.clip(position, LOW, HIGH) - position).astype(np.float64)
    expected = np.flatnonzero((away**2).sum(axis=1) <= distance**2)
    assert np.array_equal(rows_near(position, LOW, HIGH, distance), expected)


def test_all_places_lie_in_the_only_cell() -> None:
    everywhere = np.full(3, FAR_AWAY, np.float32)
    position = np.array([[0.0, 1e30, 0.0], [np.inf, 0.0, 0.0]], np.float32)
    assert rows_near(position, -everywhere, everywhere, 0.0).tolist() == [0, 1]
