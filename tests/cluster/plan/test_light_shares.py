"""How photons are shared out among lights: by use, and never nothing to one that shines."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from light_rig import square, table_of

from wdpm.cluster.plan.light_shares import EVEN, MEASURED, measured_emission, pilot_emission
from wdpm.kernels.limits import MAPS
from wdpm.scenes.flat.light_table import LightTable
from wdpm.scenes.model.lights import PointLight

STRONG = PointLight("strong", (2.0, 0, 0), (1.0,) * 3)
WEAK = PointLight("weak", (-2.0, 0, 0), (1e-12,) * 3)
DARK = PointLight("dark", (0.0, 2.0, 0), (0.0,) * 3)


def pilot(table: LightTable) -> Any:
    return pilot_emission(SimpleNamespace(lights=table), aimed=False)  # type: ignore[arg-type]


def shared(table: LightTable, flux: list[list[float]]) -> Any:
    return measured_emission(SimpleNamespace(lights=table, emission=pilot(table)), np.array(flux))  # type: ignore[arg-type]


def test_the_pilot_asks_every_light_that_shines() -> None:
    emission = pilot(table_of(others=[STRONG, WEAK, DARK]))
    for share in (emission.share, emission.caustic_share):
        np.testing.assert_allclose(share, [EVEN / 2 + (1 - EVEN), EVEN / 2, 0.0], rtol=1e-9)


def test_within_a_light_photons_go_by_power() -> None:
    """Two triangles of a square, of which one light's share is halved, and a point."""
    emission = pilot(table_of([square(3.0, 2.0)], [STRONG]))
    assert emission.share.sum() == pytest.approx(1.0)
    assert emission.share[0] == pytest.approx(emission.share[1])


@pytest.mark.parametrize("flux", [[1.0, 1e-12, 0.0], [1.0, 0.0, 0.0], [0.0, 1e-12, 0.0]])
def test_use_decides_most_and_the_weak_keep_a_rest(flux: list[float]) -> None:
    emission = shared(table_of(others=[STRONG, WEAK, DARK]), [flux] * MAPS)
    used = np.array(flux) / np.sum(flux)
    for share in (emission.share, emission.caustic_share):
        assert share.sum() == pytest.approx(1.0)
        assert (share >= MEASURED * used - 1e-12).all()
        assert (share[:2] >= (1 - MEASURED) * EVEN / 2 - 1e-12).all()
        assert share[2] == 0.0
