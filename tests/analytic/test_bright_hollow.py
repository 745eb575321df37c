"""A small hollow that holds all the light of a large room: photons lie far denser there than points of the surface."""

from __future__ import annotations

import numpy as np
import pytest
from furnaces import box, hollow_sphere, rendered, scene, view

from wdpm.cluster.render_settings import Indirect
from wdpm.scenes.model.lights import PointLight

ALBEDO = 0.7
INTENSITY = 1.0
SIDE = 12.0


@pytest.mark.parametrize(("how", "most"), [(Indirect.GATHER, 0.01), (Indirect.MAP, 0.02)])
def test_a_small_bright_hollow(how: Indirect, most: float) -> None:
    """A lamp in the middle of a hollow unit sphere sends I on each unit of its area.

    Of that the sphere reflects albedo once, which is direct light, and albedo² / (1 - albedo) by way of itself. With k
    photons by the share of surface that a larger disc has it was 75 % too bright.
    """
    ball, room = hollow_sphere(smooth=True), box((SIDE, SIDE, SIDE), inside=True)
    lamp = PointLight("lamp", (0.0, 0.0, 0.0), (INTENSITY,) * 3)
    what = scene([ball, room], view((0, 0, 0), (1, 0.1, 0.2), 90), (ALBEDO,) * 3, (lamp,))
    chosen = {"indirect": how, "photons": 50_000, "spp": 64, "radius": 1.0}
    found = [rendered(what, seed=seed, **chosen).layers["indirect"].mean(dtype=np.float64) for seed in range(2)]
    exact = INTENSITY / np.pi * ALBEDO**2 / (1.0 - ALBEDO)
    np.testing.assert_allclose(np.mean(found), exact, rtol=most)
