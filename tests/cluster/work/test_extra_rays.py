"""Extra gather rays of irradiance records: how many go where, and that they bring the error down without a bias."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.cluster.work.records.extra_rays import extra_rays, means, neighbours_spread, standard_errors
from wdpm.cluster.work.records.record_wave import first_rays, further_rays

Values = NDArray[np.float64]
ROWS, COLUMNS = 8, 25
LAMP = (slice(2, 4), slice(10, 13))
"""Strata that a lamp covers in part: a ray through one meets it with a probability of CHANCE."""
CHANCE = 0.4
LIT, DARK = 40.0, 1.0
NOTHING = np.zeros((1, 1, 1), np.float32)
"""No light from lit places."""


def shot(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    return np.ones(shape, np.bool_)


def rays_through(rng: np.random.Generator, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Values:
    """What rays through some strata bring back."""
    in_lamp = (rows >= 2) & (rows < 4) & (columns >= 10) & (columns < 13)
    return np.where(in_lamp & (rng.random(rows.shape) < CHANCE), LIT, DARK)


def truth() -> float:
    expected = np.full((ROWS, COLUMNS), DARK)
    expected[LAMP] = CHANCE * LIT + (1 - CHANCE) * DARK
    return float(expected.mean())


def estimates(records: int, most: int, seed: int) -> tuple[Values, Values]:
    """Mean radiance of each record by one ray a stratum, and with extra rays."""
    rng = np.random.default_rng(seed)
    shape = (records, ROWS, COLUMNS)
    rows, columns = (np.broadcast_to(a, shape).reshape(-1) for a in np.indices((ROWS, COLUMNS)))
    first = rays_through(rng, rows, columns)
    counts = extra_rays(first.reshape(shape), NOTHING, shot(shape), 1e-3, most).reshape(-1)
    extra = rays_through(rng, np.repeat(rows, counts), np.repeat(columns, counts))
    together = means(*(np.repeat(a[:, None], 3, axis=1) if a.dtype != np.int64 else a for a in (first, counts, extra)))
    return first.reshape(records, -1).mean(axis=1), together[:, 0].reshape(records, -1).mean(axis=1)


def test_extra_rays_bring_the_error_down_and_leave_the_mean() -> None:
    records = 4000
    plain, refined = estimates(records, 3 * ROWS * COLUMNS, 1)
    assert refined.std() < 0.65 * plain.std()
    for found in (plain, refined):
        assert found.mean() == pytest.approx(truth(), abs=4 * found.std() / np.sqrt(records))


def test_a_stratum_has_no_say_in_its_own_rays() -> None:
    """Where its own ray decided, a chance hit would be diluted and a chance miss not."""
    even = np.ones((1, ROWS, COLUMNS))
    odd = even.copy()
    odd[0, 4, 7] = 1000.0
    spread = neighbours_spread(odd)
    assert spread[0, 4, 7] == 0
    assert (spread[0, 3:6, 6:9] > 0).sum() == 8
    assert not spread[0, :, 9:].any()


def test_columns_go_round_and_rows_end() -> None:
    values = np.zeros((1, ROWS, COLUMNS))
    values[0, 0, 0] = 1.0
    spread = neighbours_spread(values)[0] > 0
    assert spread[0].nonzero()[0].tolist() == [1, COLUMNS - 1]
    assert spread[1].nonzero()[0].tolist() == [0, 1, COLUMNS - 1]
    assert not spread[2:].any()


@pytest.mark.parametrize("rows", [1, 2])
def test_flat_hemispheres_have_neighbours_too(rows: int) -> None:
    values = np.arange(3.0 * rows).reshape(1, rows, 3)
    assert np.isfinite(neighbours_spread(values)).all()


def test_even_light_calls_for_no_extra_rays() -> None:
    assert not extra_rays(np.full((2, ROWS, COLUMNS), 3.0), NOTHING, shot((2, ROWS, COLUMNS)), 0.01, 600).any()
    assert not extra_rays(np.zeros((2, ROWS, COLUMNS)), NOTHING, shot((2, ROWS, COLUMNS)), 0.01, 600).any()


def test_there_are_as_many_as_the_tolerance_calls_for_and_no_more_than_the_most() -> None:
    radiance = np.random.default_rng(3).random((5, ROWS, COLUMNS)) ** 4
    most = 600
    few, more, capped = (
        extra_rays(radiance, NOTHING, shot(radiance.shape), tolerance, most).sum(axis=(1, 2))
        for tolerance in (0.1, 0.05, 0.001)
    )
    assert (few < more).all()
    assert (more < capped).all()
    assert ((capped > 0.9 * most) & (capped < most + radiance[0].size)).all()


def test_rays_that_would_leave_below_the_surface_get_no_company() -> None:
    radiance = np.random.default_rng(4).random((1, ROWS, COLUMNS))
    above = shot(radiance.shape)
    above[0, -1] = False
    counts = extra_rays(radiance, NOTHING, above, 0.01, 600)
    assert counts[above].any()
    assert not counts[~above].any()


def test_what_else_is_under_way_changes_nothing() -> None:
    radiance = np.random.default_rng(5).random((7, ROWS, COLUMNS)) ** 3
    together = extra_rays(radiance, NOTHING, shot(radiance.shape), 0.02, 400)
    for i in range(len(radiance)):
        alone = extra_rays(radiance[i : i + 1], NOTHING, shot((1, ROWS, COLUMNS)), 0.02, 400)
        np.testing.assert_array_equal(together[i : i + 1], alone)


def test_unoccluded_light_that_no_ray_around_has_met_calls_for_rays() -> None:
    radiance, unoccluded = np.ones((1, ROWS, COLUMNS)), np.zeros((1, ROWS, COLUMNS), np.float32)
    unoccluded[0, 4, 7] = 1.0  # no more than is there
    assert not extra_rays(radiance, unoccluded, shot(radiance.shape), 0.02, 400).any()
    most, counts = 400, {}
    for bright in (6.0, 12.0, 1e6, np.inf):
        unoccluded[0, 4, 7] = bright
        counts[bright] = extra_rays(radiance, unoccluded, shot(radiance.shape), 0.02, most)[0]
        assert counts[bright][4, 7] == counts[bright].max()
    assert 0 < counts[6.0].sum() < counts[12.0].sum() < counts[1e6].sum() < most + radiance[0].size
    assert np.array_equal(counts[np.inf], counts[1e6])
    # A place stands for what is around it, too, and nothing else gets rays for its light.
    assert counts[1e6][3:6, 6:9].all()
    assert not np.delete(np.delete(counts[1e6], range(3, 6), 0), range(6, 9), 1).any()


def test_a_bright_thing_that_rays_seldom_find_makes_no_blotches_where_it_is_known() -> None:
    """It fills a twentieth of a stratum, and brings a fifth of all light: few records find it by chance."""
    records, chance, bright, tolerance = 4000, 0.05, 1000.0, 0.05
    rng = np.random.default_rng(7)
    shape = (records, ROWS, COLUMNS)
    first = np.ones(shape)
    first[:, 4, 7] += bright * (rng.random(records) < chance)
    known = np.zeros((1, ROWS, COLUMNS), np.float32)
    known[0, 4, 7] = chance * bright
    found, rays = {}, {}
    for name, unoccluded in (("by chance", NOTHING), ("known", known)):
        counts = extra_rays(first, unoccluded, shot(shape), tolerance, 3 * ROWS * COLUMNS).reshape(records, -1)
        place = 4 * COLUMNS + 7
        total = first.reshape(records, -1).copy()
        hits = 1.0 + bright * rng.binomial(counts[:, place], chance) / np.maximum(counts[:, place], 1)
        total[:, place] = (total[:, place] + counts[:, place] * hits) / (counts[:, place] + 1)
        found[name], rays[name] = total.mean(axis=1), counts.sum(axis=1).mean()
    truth = 1.0 + chance * bright / (ROWS * COLUMNS)
    for each in found.values():
        assert each.mean() == pytest.approx(truth, abs=4 * each.std() / np.sqrt(records))
    assert found["known"].std() < 0.3 * found["by chance"].std()
    assert rays["known"] < 3 * ROWS * COLUMNS


def test_rays_for_unseen_light_do_not_depend_on_the_ray_of_their_stratum() -> None:
    radiance, unoccluded = np.ones((1, ROWS, COLUMNS)), np.zeros((1, ROWS, COLUMNS), np.float32)
    unoccluded[0, 4, 7] = 6.0
    counts = extra_rays(radiance, unoccluded, shot(radiance.shape), 0.005, 400)
    hit = radiance.copy()
    hit[0, 4, 7] = 1000.0
    assert extra_rays(hit, unoccluded, shot(radiance.shape), 0.005, 400)[0, 4, 7] == counts[0, 4, 7] > 1


def test_dark_hemispheres_get_no_rays_for_unseen_light() -> None:
    """What light is relative to is not known there; and nothing divides by it."""
    unoccluded = np.ones((1, ROWS, COLUMNS), np.float32)
    assert not extra_rays(np.zeros((1, ROWS, COLUMNS)), unoccluded, shot((1, ROWS, COLUMNS)), 0.02, 400).any()


def test_further_rays_are_numbered_after_the_first_ones_of_their_record() -> None:
    rays = further_rays(np.array([[0, 2, 1, 1], [0, 0, 0, 0], [1, 0, 1, 0]]), 2, 2)
    assert first_rays(1, 2, 2).ray.tolist() == [0, 1, 2, 3]
    assert rays.record.tolist() == [0, 0, 0, 0, 2, 2]
    assert rays.stratum.tolist() == [1, 1, 2, 3, 0, 2]
    assert rays.ray.tolist() == [4, 5, 6, 7, 4, 5]
    assert rays.turn.tolist() == [1, 2, 1, 1, 1, 1]  # each stratum has had one before


@pytest.mark.parametrize(("rows", "columns"), [(1, 3), (3, 9), (8, 25), (16, 50), (22, 70)])
def test_no_two_rays_of_a_record_have_one_number(rows: int, columns: int) -> None:
    counts = np.random.default_rng(columns).integers(0, 4, (2, rows * columns))
    first, further = first_rays(2, rows, columns), further_rays(counts, rows, columns)
    for record in (0, 1):
        of_first, of_further = first.ray[first.record == record], further.ray[further.record == record]
        assert len(np.unique(of_first)) == rows * columns
        assert sorted(of_further) == list(range(of_first.max() + 1, of_first.max() + 1 + counts[record].sum()))


def test_what_lies_together_in_a_hemisphere_has_numbers_that_follow_each_other() -> None:
    """Each aligned square of strata has one range of numbers: points of a stream are even over it."""
    number = first_rays(1, 16, 48).ray.reshape(16, 48)
    for row, column in ((0, 0), (4, 20), (12, 44)):
        square = np.sort(number[row : row + 4, column : column + 4].reshape(-1))
        assert np.array_equal(square, square[0] + np.arange(16))
        assert square[0] % 16 == 0


def test_further_rays_follow_the_numbers_of_first_ones() -> None:
    counts = np.random.default_rng(2).integers(0, 3, (1, 8 * 25))
    first, further = first_rays(1, 8, 25), further_rays(counts, 8, 25)
    by_number = np.argsort(further.ray)
    assert (np.diff(first.ray[further.stratum[by_number]]) >= 0).all()


def test_records_know_about_how_much_they_err() -> None:
    """With one ray and with two through each stratum; what neighbours differ by in fact is counted as well."""
    rng = np.random.default_rng(5)
    every = np.indices((ROWS, COLUMNS)).reshape(2, 1, -1)
    rows, columns = np.repeat(every[0], 4000, axis=0), np.repeat(every[1], 4000, axis=0)
    one = rays_through(rng, rows, columns).reshape(-1, ROWS, COLUMNS)
    two = (one + rays_through(rng, rows, columns).reshape(-1, ROWS, COLUMNS)) / 2.0
    for more, radiance in enumerate((one, two)):
        told = standard_errors(radiance, np.full(radiance.shape, more, np.int64))
        irradiance = np.pi * radiance.mean(axis=(1, 2))
        assert np.std(irradiance) < np.sqrt(np.mean(told**2)) < 2.5 * np.std(irradiance)
    assert standard_errors(np.ones((1, ROWS, COLUMNS)), np.zeros((1, ROWS, COLUMNS), np.int64)) == 0.0


def test_one_ray_that_met_what_no_other_did_is_the_error_of_its_record() -> None:
    """The strata around it have got rays for it, which brought nothing."""
    radiance = np.ones((1, ROWS, COLUMNS))
    radiance[0, 2, 3] = 1.0 + radiance.size
    counts = np.full(radiance.shape, 15, np.int64)
    counts[0, 2, 3] = 0
    chance = np.pi * radiance.size / radiance.size
    assert standard_errors(radiance, counts)[0] == pytest.approx(chance, rel=0.1)
