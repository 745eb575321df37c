"""Random numbers: stratified within a stream, independent between streams, and what the papers say they are."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.maths import random as kernel_random
from wdpm.kernels.maths.random import (
    PURPOSE_EMISSION,
    PURPOSE_LIGHT,
    PURPOSE_PIXEL,
    PURPOSE_SCATTER,
    reverse_bits,
    sample_1d,
    sample_2d,
    shuffled,
    sobol_second_reversed,
    stream_of,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Floats = NDArray[np.float64]
Words = NDArray[np.uint32]


@wp.kernel
def points_kernel(
    index: wp.array(dtype=wp.uint32),
    stream: wp.array(dtype=wp.uint32),
    points_out: wp.array(dtype=wp.vec2),
    numbers_out: wp.array(dtype=wp.float64),
):
    i = wp.tid()
    points_out[i] = sample_2d(index[i], stream[i])
    numbers_out[i] = sample_1d(index[i], stream[i])


@wp.kernel
def words_kernel(
    x: wp.array(dtype=wp.uint32),
    stream: wp.uint32,
    reversed_out: wp.array(dtype=wp.uint32),
    sobol_out: wp.array(dtype=wp.uint32),
    shuffled_out: wp.array(dtype=wp.uint32),
):
    i = wp.tid()
    reversed_out[i] = reverse_bits(x[i])
    sobol_out[i] = sobol_second_reversed(x[i])
    shuffled_out[i] = shuffled(x[i], stream)


@wp.kernel
def streams_kernel(
    seed: wp.uint32,
    purpose: wp.uint32,
    items: wp.array(dtype=wp.uint32),
    dimension: int,
    out: wp.array(dtype=wp.uint32),
):
    i = wp.tid()
    out[i] = stream_of(seed, purpose, items[i], dimension)


def words(values: object) -> wp.array:
    return wp.array(np.asarray(values, np.uint32), dtype=wp.uint32, device="cpu")


def samples(index: object, stream: object) -> tuple[Floats, Floats]:
    """Points, shape [N, 2], and numbers, shape [N]."""
    index, stream = np.broadcast_arrays(np.asarray(index, np.uint32), np.asarray(stream, np.uint32))
    count = index.size
    points = wp.empty(count, dtype=wp.vec2, device="cpu")
    numbers = wp.empty(count, dtype=wp.float64, device="cpu")
    inputs = [words(index.ravel()), words(stream.ravel()), points, numbers]
    wp.launch(points_kernel, count, inputs=inputs, device="cpu")
    return points.numpy().astype(np.float64), numbers.numpy()


def streams(seed: int, purpose: int, items: object, dimension: int = 0) -> Words:
    """Names of streams."""
    names = wp.empty(np.size(items), dtype=wp.uint32, device="cpu")
    inputs = [wp.uint32(seed), wp.uint32(purpose), words(items), dimension, names]
    wp.launch(streams_kernel, np.size(items), inputs=inputs, device="cpu")
    return np.asarray(names.numpy())


def of_words(x: Words, stream: int = 0) -> tuple[Words, Words, Words]:
    """reverse_bits, sobol_second_reversed and shuffled."""
    outputs = [wp.empty(len(x), dtype=wp.uint32, device="cpu") for _ in range(3)]
    wp.launch(words_kernel, len(x), inputs=[words(x), wp.uint32(stream), *outputs], device="cpu")
    reversed_, sobol, permuted = (np.asarray(out.numpy()) for out in outputs)
    return reversed_, sobol, permuted


def some_words() -> Words:
    rng = np.random.default_rng(3)
    single = 1 << np.arange(32, dtype=np.uint64)
    return np.concatenate([np.arange(600), single, single - 1, rng.integers(0, 2**32, 2000)]).astype(np.uint32)


def textbook_second_dimension(index: int) -> int:
    """Sobol's second dimension by its generator matrix: direction numbers v_{j+1} = v_j ^ (v_j >> 1), from 2^31."""
    direction, x = 1 << 31, 0
    while index:
        if index & 1:
            x ^= direction
        direction ^= direction >> 1
        index >>= 1
    return x


def test_bits_are_reversed() -> None:
    x = some_words()
    expected = [int(f"{value:032b}"[::-1], 2) for value in x.tolist()]
    np.testing.assert_array_equal(of_words(x)[0], expected)


def test_the_second_dimension_is_sobols() -> None:
    x = some_words()
    expected = np.array([textbook_second_dimension(value) for value in x.tolist()], np.uint32)
    np.testing.assert_array_equal(of_words(of_words(x)[1])[0], expected)


@pytest.mark.parametrize("bits", [0, 1, 4, 9])
def test_shuffling_permutes_within_aligned_blocks(bits: int) -> None:
    size = 1 << bits
    for block in (0, 5, (1 << 32 - bits) - 1):
        x = (np.arange(size, dtype=np.uint64) + block * size).astype(np.uint32)
        blocks = of_words(x, 0x1234567)[2].astype(np.uint64) >> np.uint64(bits)
        inside = np.sort(of_words(x, 0x1234567)[2].astype(np.uint64) % size)
        assert len(np.unique(blocks)) == 1
        np.testing.assert_array_equal(inside, np.arange(size))


@pytest.mark.parametrize("bits", [1, 2, 5, 8, 12])
@pytest.mark.parametrize("stream", [0, 1, 0xDEADBEEF, 2**32 - 1])
def test_points_are_a_net(bits: int, stream: int) -> None:
    """A (0, m, 2)-net in base 2: each elementary interval of area 2^-m holds one of 2^m points of an aligned block."""
    count = 1 << bits
    for block in (0, 1, 777):
        points, _ = samples(np.arange(count) + block * count, stream)
        assert points.min() >= 0.0
        assert points.max() < 1.0
        for across in range(bits + 1):
            column = np.floor(points[:, 0] * 2**across)
            row = np.floor(points[:, 1] * 2 ** (bits - across))
            intervals = column * 2 ** (bits - across) + row
            assert len(np.unique(intervals)) == count, (block, across)


@pytest.mark.parametrize("bits", [1, 3, 10])
def test_numbers_are_stratified(bits: int) -> None:
    count = 1 << bits
    for stream in (0, 99, 2**31):
        for block in (0, 3):
            _, numbers = samples(np.arange(count) + block * count, stream)
            np.testing.assert_array_equal(np.sort(np.floor(numbers * count)), np.arange(count))


def test_any_prefix_covers_evenly() -> None:
    """The first n points of a stream have a mean close to 1/2, for counts that are no power of two, too.

    A prefix of n is a union of at most log2(n) + 1 aligned blocks, each a net; a net of 2^m points misses a mean of a
    coordinate by less than 2^-m / 2 a point, 1/2 in sum; so the sums are off by (log2(n) + 1) / 2 at most.
    """
    for count in (3, 7, 100, 999):
        points, numbers = samples(np.arange(count), 42)
        bound = (np.log2(count) + 1) / 2 / count
        assert np.all(np.abs(points.mean(axis=0) - 0.5) < bound)
        assert abs(numbers.mean() - 0.5) < bound


def chi_square(counts: NDArray[np.int64]) -> float:
    """Standard deviations by which a chi-square statistic of equal expectations is off its mean."""
    expected = counts.sum() / counts.size
    freedom = counts.size - 1
    return float((((counts - expected) ** 2).sum() / expected - freedom) / np.sqrt(2 * freedom))


# With 255 degrees of freedom and more, chi-square is close to normal: it leaves 5 standard deviations with a
# probability below 1e-5 (its tail is somewhat heavier than the normal's 3e-7), and seeds are fixed.
DEVIATIONS = 5.0


@pytest.mark.parametrize("index", [0, 1, 17, 100_003])
def test_one_item_is_uniform_over_streams(index: int) -> None:
    names = streams(7, int(PURPOSE_PIXEL), np.arange(1 << 16))
    points, numbers = samples(np.full(1 << 16, index), names)
    grid = np.floor(points * 16).astype(np.int64)
    assert abs(chi_square(np.bincount(grid[:, 0] * 16 + grid[:, 1], minlength=256))) < DEVIATIONS
    assert abs(chi_square(np.bincount(np.floor(numbers * 256).astype(np.int64), minlength=256))) < DEVIATIONS


def test_streams_do_not_correlate() -> None:
    """Pairs of streams that a render uses side by side: pixels, dimensions, purposes, seeds, bounces.

    The correlation of n independent pairs has a standard deviation of 1 / sqrt(n). One item from each of n pairs of
    streams is taken, so stratification within a stream has no say.
    """
    count = 1 << 15
    items = np.arange(count)
    base = streams(0, int(PURPOSE_LIGHT), items)
    others = {
        "next item": streams(0, int(PURPOSE_LIGHT), items + 1),
        "item 512 further": streams(0, int(PURPOSE_LIGHT), items + 512),
        "next dimension": streams(0, int(PURPOSE_LIGHT), items, 1),
        "next seed": streams(1, int(PURPOSE_LIGHT), items),
        "another purpose": streams(0, int(PURPOSE_PIXEL), items),
    }
    for name, other in others.items():
        assert not np.any(base == other), name
        for index in (0, 5):
            one, one_number = samples(np.full(count, index), base)
            two, two_number = samples(np.full(count, index), other)
            for a in (one[:, 0], one[:, 1], one_number):
                for b in (two[:, 0], two[:, 1], two_number):
                    assert abs(np.corrcoef(a, b)[0, 1]) < DEVIATIONS / np.sqrt(count), name


def test_coordinates_of_a_point_do_not_correlate_over_streams() -> None:
    count = 1 << 16
    points, _ = samples(np.full(count, 3), streams(5, int(PURPOSE_SCATTER), np.arange(count)))
    assert abs(np.corrcoef(points[:, 0], points[:, 1])[0, 1]) < DEVIATIONS / np.sqrt(count)


def test_dimensions_of_one_path_fill_space() -> None:
    """Four dimensions of consecutive paths, as emission uses them: chi-square over 4^4 boxes.

    Points of one stream are stratified, so the statistic may fall below its mean by any amount; only excess is a flaw.
    """
    count = 1 << 16
    first, _ = samples(np.arange(count), streams(0, int(PURPOSE_EMISSION), [0], 1))
    second, _ = samples(np.arange(count), streams(0, int(PURPOSE_EMISSION), [0], 2))
    grid = np.floor(np.hstack([first, second]) * 4).astype(np.int64)
    counts = np.bincount(grid @ [64, 16, 4, 1], minlength=256)
    assert chi_square(counts) < DEVIATIONS


def test_purposes_differ() -> None:
    names = [name for name in dir(kernel_random) if name.startswith("PURPOSE_")]
    assert len(names) == len({int(getattr(kernel_random, name)) for name in names}) >= 6
