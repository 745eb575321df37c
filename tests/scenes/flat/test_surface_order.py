"""The curve along which triangles are given surface points."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.scenes.builtin.cornell_box import cornell_box
from wdpm.scenes.flat import surface_order
from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.surface_order import BITS, FEW, AreaBefore, along_curve, hilbert_keys


def test_the_curve_goes_from_each_place_to_one_beside_it() -> None:
    side = 16
    places = np.stack(np.meshgrid(*[np.arange(side, dtype=np.uint16)] * 3, indexing="ij")).reshape(3, -1)
    coarse, fine = (places[:, np.argsort(hilbert_keys(places * step))] for step in ((1 << BITS) // side, 1))
    for along in coarse.astype(int), fine.astype(int):
        assert np.all(np.abs(np.diff(along, axis=1)).sum(axis=0) == 1)


def test_finest_places_have_keys_of_their_own() -> None:
    some = np.unique(np.random.default_rng(0).integers(0, 1 << BITS, (3, 5000)).astype(np.uint16), axis=1)
    keys = hilbert_keys(some)
    assert keys.max() < 1 << 3 * BITS
    assert len(np.unique(keys)) == some.shape[1]


@pytest.mark.parametrize("count", [0, 1, FEW, FEW + 1, 1000, 3000])
def test_areas_before_are_sums_along_the_curve(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surface_order, "_AT_ONCE", 1024)
    corners = _some(count)
    area = triangle_areas(corners)
    before, total = along_curve(corners)
    assert total == pytest.approx(area.sum())
    order = np.argsort(before, kind="stable")
    np.testing.assert_allclose((before + area)[order], np.append(before[order], total)[1:], rtol=1e-12)


def test_triangles_at_one_place_and_those_that_are_nowhere_have_their_turn() -> None:
    corners = np.repeat(_some(1), 100, axis=0)
    corners[3] = np.nan
    corners[5] = np.inf
    before, total = along_curve(corners)
    assert total == pytest.approx(98 * float(triangle_areas(corners[:1])[0]))
    assert np.isfinite(before).all()


def test_meshes_come_one_after_another() -> None:
    areas = AreaBefore()
    one, two = areas.of_mesh(_some(40)), areas.of_mesh(_some(50))
    assert two.min() >= one.max()
    assert areas.step(1.5) == areas.total - 1.5


def test_every_triangle_of_a_scene_has_its_own_stretch() -> None:
    triangles = flatten(cornell_box()).triangles
    area = triangle_areas(triangles.positions)
    order = np.argsort(triangles.area_before, kind="stable")
    np.testing.assert_allclose(np.diff(triangles.area_before[order]), area[order][:-1], rtol=1e-9, atol=1e-12)


def _some(count: int) -> NDArray[np.float32]:
    return np.random.default_rng(count).normal(size=(count, 3, 3)).astype(np.float32)
