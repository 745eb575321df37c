"""How many samples each part of an image takes: as pixels, as groups of pixels, and in waves."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.cluster.allotment import (
    BLOCK,
    OUTLINE_SHARE,
    OUTLINE_TIMES,
    Allotment,
    Piece,
    blocks_of,
    lamp_outlines_of,
    sample_groups,
    spread,
    waves,
)


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
