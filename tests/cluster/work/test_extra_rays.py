"""Extra gather rays of irradiance records: how many go where, and that they bring the error down without a bias."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.cluster.work.records import extra_rays as of_records
from wdpm.cluster.work.records.extra_rays import GOLDEN, ExtraRays
from wdpm.cluster.work.records.record_wave import GatherRays, first_rays
from wdpm.cluster.work.records.record_wave import further_rays as further_rays_of
from wdpm.kernels.launch import ONE_THREAD
from wdpm.kernels.limits import FURTHER_RAYS

Values = NDArray[np.float64]
ROWS, COLUMNS = 8, 25
LAMP = (slice(2, 4), slice(10, 13))
"""Strata that a lamp covers in part: a ray through one meets it with a probability of CHANCE."""
CHANCE = 0.4
LIT, DARK = 40.0, 1.0
NOTHING = np.zeros((1, 1, 1), np.float32)
"""No light from lit places."""


def in_rgb(values: NDArray[np.generic]) -> Values:
    """Grey light of these values, shape [values, 3]."""
    return np.repeat(values.reshape(-1, 1), 3, axis=1).astype(np.float64)


def extra_rays(
    radiance: Values, unoccluded: NDArray[np.float32], above: NDArray[np.bool_], tolerance: float, most: int
) -> NDArray[np.int64]:
    """How many rays strata get more, shape [N, rows, columns] as all that is given but what is 1 stands for all."""
    promised = np.broadcast_to(unoccluded, radiance.shape).reshape(-1)
    distance = np.where(above, 1.0, -1.0).astype(np.float32).reshape(-1)
    light, (_, rows, columns) = in_rgb(radiance), radiance.shape
    found = of_records.extra_rays(ONE_THREAD, (rows, columns), light, promised, distance, tolerance, most)
    assert found.total == found.counts.sum()
    assert np.array_equal(found.begins, np.cumsum(found.counts.sum(axis=1)) - found.counts.sum(axis=1))
    return found.counts.reshape(radiance.shape)


def extra(counts: NDArray[np.int64]) -> ExtraRays:
    """So many, shape [N, strata]."""
    return ExtraRays.of(counts, counts.sum(axis=1))


def further_rays(counts: NDArray[np.int64], rows: int, columns: int) -> GatherRays:
    return further_rays_of(ONE_THREAD, extra(counts), rows, columns)


def standard_errors(radiance: Values, counts: NDArray[np.int64]) -> NDArray[np.float32]:
    (records, rows, columns), light = radiance.shape, in_rgb(radiance)
    return of_records.standard_errors(ONE_THREAD, (rows, columns), light, counts.reshape(records, -1))


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
    more = rays_through(rng, np.repeat(rows, counts), np.repeat(columns, counts))
    together = of_records.means(ONE_THREAD, in_rgb(first), extra(counts.reshape(records, -1)), in_rgb(more))
    return first.reshape(records, -1).mean(axis=1), together[:, 0].reshape(records, -1).mean(axis=1)


def test_extra_rays_bring_the_error_down_and_leave_the_mean() -> None:
    records = 4000
    plain, refined = estimates(records, 3 * ROWS * COLUMNS, 1)
    assert refined.std() < 0.65 * plain.std()
    for found in (plain, refined):
        assert found.mean() == pytest.approx(truth(), abs=4 * found.std() / np.sqrt(records))


def test_a_stratum_has_no_say_in_its_own_rays() -> None:
    """Where its own ray decided, a chance hit would be diluted and a chance miss not."""
    odd = np.ones((1, ROWS, COLUMNS))
    odd[0, 4, 7] = 1000.0
    counts = extra_rays(odd, NOTHING, shot(odd.shape), 1e-3, 1000)[0]
    assert counts[4, 7] == 0
    assert (counts[3:6, 6:9] > 0).sum() == 8
    assert counts[3:6, 6:9].sum() == counts.sum()


def test_columns_go_round_and_rows_end() -> None:
    values = np.zeros((1, ROWS, COLUMNS))
    values[0, 0, 0] = 1.0
    counts = extra_rays(values, NOTHING, shot(values.shape), 1e-3, 1000)[0] > 0
    assert counts[0].nonzero()[0].tolist() == [1, COLUMNS - 1]
    assert counts[1].nonzero()[0].tolist() == [0, 1, COLUMNS - 1]
    assert not counts[2:].any()


@pytest.mark.parametrize("rows", [1, 2])
def test_flat_hemispheres_have_neighbours_too(rows: int) -> None:
    values = np.arange(3.0 * rows).reshape(1, rows, 3)
    counts = extra_rays(values, NOTHING, shot(values.shape), 0.01, 60)
    assert 0 < counts.sum() < 60 + values.size
    assert 0 < standard_errors(values, counts)[0] < 10


def around(values: Values, row: int, column: int) -> list[float]:
    """What is around a stratum of a hemisphere, by rows."""
    rows, columns = values.shape
    there = [
        (row + down, (column + across) % columns) for down in (-1, 0, 1) for across in (-1, 0, 1) if down or across
    ]
    return [float(values[place]) for place in there if 0 <= place[0] < rows]


def sums(values: list[float]) -> float:
    """Added one after another: Python's own sum compensates for rounding from 3.12 on."""
    total = 0.0
    for value in values:
        total += value
    return total


def spread_around(values: list[float]) -> float:
    total, count = sums(values), float(len(values))
    squares = sums([value * value for value in values])
    return math.sqrt(max((squares - total * total / count) / max(count - 1.0, 1.0), 0.0))


@pytest.mark.parametrize(("rows", "columns"), [(1, 3), (2, 6), (ROWS, COLUMNS)])
def test_shares_and_errors_are_what_plain_words_say(rows: int, columns: int) -> None:
    """All bits: as another one adds up what is around a stratum, in the same order."""
    rng = np.random.default_rng(columns)
    light, promised = rng.random((rows, columns)) ** 6, (rng.random((rows, columns)) ** 9).astype(np.float32)
    tolerance, most = 0.03, 90
    places = [(row, column) for row in range(rows) for column in range(columns)]
    spread = np.zeros((rows, columns))
    for place in places:
        near, far = around(light, *place), around(promised.astype(np.float64), *place)
        smooth = 0.5 * float(promised[place]) + 0.5 * sums(far) / len(far)
        unseen = 2.0 * max(smooth - sums(near) / len(near), 0.0)
        spread[place] = math.sqrt(spread_around(near) * spread_around(near) + unseen * unseen)
    all_light, all_spread = (sums(values.reshape(-1).tolist()) for values in (light, spread))
    wanted, variance = [], 0.0
    for number, place in enumerate(places):
        near, others = around(light, *place), around(spread, *place)
        total = all_light - float(light[place]) + sums(near) / len(near)
        spreads = all_spread - sums(others) + len(others) * float(spread[place])
        rays = spreads / (tolerance * total)
        asked = min(rays * rays, float(most + len(places))) * (float(spread[place]) / spreads) - 1.0
        wanted.append(math.floor(max(asked, 0.0) + (number + 1) * GOLDEN % 1.0))
        off = float(light[place]) - sums(near) / len(near)
        variance += max(spread_around(near) * spread_around(near), off * off) / (wanted[-1] + 1.0)
    found = extra_rays(light[None], promised[None], shot((1, rows, columns)), tolerance, most)
    assert found.reshape(-1).tolist() == wanted
    assert sum(wanted) > 0
    assert standard_errors(light[None], found)[0] == np.float32(math.sqrt(variance) * (math.pi / len(places)))


def test_means_are_of_all_rays_of_a_stratum() -> None:
    counts = np.array([[0, 2, 1], [3, 0, 0]])
    first, further = np.random.default_rng(8).random((6, 3)), np.random.default_rng(9).random((6, 3))
    found = of_records.means(ONE_THREAD, first, extra(counts), further)
    assert np.array_equal(found[[0, 4, 5]], first[[0, 4, 5]])
    assert np.array_equal(found[1], (first[1] + (further[0] + further[1])) / 3.0)
    assert np.array_equal(found[2], (first[2] + further[2]) / 2.0)
    assert np.array_equal(found[3], (first[3] + (further[3] + further[4] + further[5])) / 4.0)


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
    assert (rays.ray - FURTHER_RAYS).tolist() == [0, 1, 2, 3, 0, 1]
    assert rays.turn.tolist() == [1, 2, 1, 1, 1, 1]  # each stratum has had one before


@pytest.mark.parametrize(("rows", "columns"), [(1, 3), (3, 9), (8, 25), (16, 50), (22, 70)])
def test_no_two_rays_of_a_record_have_one_number(rows: int, columns: int) -> None:
    counts = np.random.default_rng(columns).integers(0, 4, (2, rows * columns))
    first, further = first_rays(2, rows, columns), further_rays(counts, rows, columns)
    for record in (0, 1):
        of_first, of_further = first.ray[first.record == record], further.ray[further.record == record]
        assert len(np.unique(of_first)) == rows * columns
        assert sorted(of_further) == list(range(FURTHER_RAYS, FURTHER_RAYS + counts[record].sum()))
        assert of_first.max() < FURTHER_RAYS


def test_no_stratum_has_the_stream_of_one_beside_it() -> None:
    """Rays tell how many more their neighbours get, and must not know what these bring."""
    stream = first_rays(1, 16, 48).ray.reshape(16, 48) % 4
    for row, column in ((0, 1), (1, 0), (1, 1)):
        assert (stream[row:, column:] != stream[: 16 - row, : 48 - column]).all()


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
