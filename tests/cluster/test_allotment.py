"""How many samples each part of an image takes: as pixels, as groups of pixels, and in waves."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.cluster.allotment import (
    BLOCK,
    MOST_BY_NOISE,
    OUTLINE_SHARE,
    OUTLINE_TIMES,
    Allotment,
    allotment_by_noise,
    blocks_of,
    lamp_outlines_of,
    spread,
)
from wdpm.cluster.work.pixels.waves import Piece, sample_groups, waves


def test_a_bucket_of_any_size_has_the_samples_of_the_image() -> None:
    width, height = 3 * BLOCK + 1, 2 * BLOCK - 3
    shape = blocks_of(width, height)
    assert shape == (2, 4)
    count = np.arange(8, dtype=np.int32).reshape(shape)
    allotment = Allotment(count + 100, count)
    whole = spread(count, width, height)
    assert whole.shape == (height, width)
    assert whole[0, BLOCK - 1] == 0
    assert whole[0, BLOCK] == 1
    assert whole[-1, -1] == 7
    first, counted = allotment.of_pixels(5, 3, width, BLOCK + 2)
    np.testing.assert_array_equal(counted, whole[3 : BLOCK + 2, 5:])
    np.testing.assert_array_equal(first, counted + 100)


@pytest.mark.parametrize("alike", [False, True])
def test_every_sample_is_in_one_wave_and_those_of_a_pixel_in_order(alike: bool) -> None:
    rng = np.random.default_rng(4)
    first = rng.integers(0, 3, 50).astype(np.int32)
    count = rng.integers(0, 7, 50).astype(np.int32)
    groups = sample_groups(first, count, alike)
    taken: list[tuple[int, int]] = []
    for wave in waves(groups, 20):
        held = sum(len(groups[each.group].rows) * (each.stop - each.start) for each in wave)
        assert held <= 20 or (len(wave) == 1 and wave[0].stop - wave[0].start == 1)
        for each in wave:
            group = groups[each.group]
            taken += [
                (row, begin + number)
                for number in range(each.start, each.stop)
                for row, begin in zip(group.rows.tolist(), group.first.tolist(), strict=True)
            ]
    expected = [(row, n) for row in range(50) for n in range(first[row], first[row] + count[row])]
    assert sorted(taken) == expected
    for row in range(50):
        numbers = [number for place, number in taken if place == row]
        assert numbers == sorted(numbers)
    if alike:
        assert all(len(set(group.first.tolist())) == 1 for group in groups)


def test_pixels_that_take_as_many_are_one_group_in_whole_waves() -> None:
    groups = sample_groups(np.full(10, 7, np.int32), np.full(10, 5, np.int32), alike=False)
    assert list(waves(groups, 25)) == [[Piece(0, 0, 2)], [Piece(0, 2, 4)], [Piece(0, 4, 5)]]


def test_nothing_to_do_is_no_wave() -> None:
    none = np.zeros(4, np.int32)
    assert list(waves(sample_groups(none, none, alike=False), 10)) == []


def test_few_pixels_on_outlines_take_many_samples_and_many_of_them_no_more_than_others() -> None:
    width, height = 40, 30
    few = lamp_outlines_of(np.array([3, 41, 1199]), width, height, (0, 0, width, height))
    assert few.times == OUTLINE_TIMES
    np.testing.assert_array_equal(few.times_of(np.array([2, 3, 41, 42])), [1, OUTLINE_TIMES, OUTLINE_TIMES, 1])
    some = lamp_outlines_of(np.arange(30), width, height, (0, 0, width, height))
    assert 1 < some.times < OUTLINE_TIMES
    assert (some.times - 1) * len(some) <= OUTLINE_SHARE * width * height
    assert not len(lamp_outlines_of(np.arange(200), width, height, (0, 0, width, height)))
    assert not len(lamp_outlines_of(np.arange(0), width, height, (0, 0, width, height)))


def test_a_pixel_of_a_crop_takes_as_many_samples_as_that_of_the_image() -> None:
    width, height = 40, 30
    whole = np.array([3, 5 * width + 11, 5 * width + 30, 29 * width + 39])
    crop = lamp_outlines_of(whole, width, height, (10, 4, 12, 3))
    assert crop.times == lamp_outlines_of(whole, width, height, (0, 0, width, height)).times
    assert crop.pixels.tolist() == [1 * 12 + 1]


def test_samples_go_where_a_trial_saw_noise() -> None:
    noise = np.full((10, 20), 0.01)
    noise[:, 10:] = 1.0
    allotment = allotment_by_noise(noise, 8, 20 * BLOCK, 10 * BLOCK)
    assert allotment.count.shape == (10, 20)
    assert not allotment.first.any()
    assert allotment.count.mean() <= 8
    assert allotment.count.min() == 4
    assert (allotment.count[:, 11:] > allotment.count[:, :9].max()).all()
    foretold = (noise[:, 12] / allotment.count[:, 12]).mean() / (1.0 / 8.0)
    assert foretold < 0.8


def test_as_many_samples_are_taken_as_were_asked_for() -> None:
    noise = np.random.default_rng(3).exponential(size=(18, 31)) * np.geomspace(0.01, 100.0, 31)
    for spp in (3, 7, 64):
        width, height = 31 * BLOCK - 3, 18 * BLOCK - 5
        allotment = allotment_by_noise(noise, spp, width, height)
        pixels = spread(allotment.count, width, height)
        assert 0.9 * spp <= pixels.mean() <= spp
        assert pixels.min() >= max(1, round(0.5 * spp))
        assert pixels.max() <= MOST_BY_NOISE * spp


def test_all_numbers_of_samples_are_of_some_multiple() -> None:
    noise = np.random.default_rng(3).exponential(size=(18, 31)) * np.geomspace(0.01, 100.0, 31)
    allotment = allotment_by_noise(noise, 16, 31 * BLOCK, 18 * BLOCK, 4)
    assert len(np.unique(allotment.count)) > 2
    assert not (allotment.count % 4).any()
    assert 0.9 * 16 <= allotment.count.mean() <= 16


@pytest.mark.parametrize(
    ("noise", "spp"),
    [
        (np.ones((9, 9)), 8),
        (np.zeros((9, 9)), 8),
        (np.linspace(1.0, 1.3, 81).reshape(9, 9), 8),
        (np.geomspace(1e-6, 1e-3, 81).reshape(9, 9), 8),
        (np.random.default_rng(5).exponential(size=(30, 30)) ** 3, 8),
    ],
    ids=["even", "none", "hardly uneven", "hardly any", "by chance"],
)
def test_samples_are_as_many_everywhere_where_nothing_is_gained(noise: NDArray[np.float64], spp: int) -> None:
    assert not len(allotment_by_noise(noise, spp, 80, 80))


def test_one_sample_and_two_cannot_be_shared_out() -> None:
    noise = np.repeat(10.0 ** np.arange(-5, 4)[:, None], 9, axis=1)
    assert not len(allotment_by_noise(noise, 1, 80, 80))
    assert not len(allotment_by_noise(noise, 2, 80, 80))
    assert allotment_by_noise(noise, 4, 80, 80).count.min() == 2


def test_a_trial_with_more_pixels_than_blocks_and_one_with_fewer_cover_the_image() -> None:
    for side in (6, 40):
        noise = np.full((side, side), 0.01)
        noise[: side // 3] = 1.0
        count = allotment_by_noise(noise, 16, 12 * BLOCK, 12 * BLOCK).count
        assert (count[0] > count[-1]).all()
        assert (count == count[:, :1]).all()
