"""How many samples each part of an image takes in a pass, where that is not as many everywhere.

Pixels that outlines of lamps cross take some times as many as others (kernels.camera.outlines), from the first pass on.
Where a trial has seen how noisy parts of the image are, a render in one pass shares its samples out by that; what
passes tell, adaptive sampling goes by.

Parts are blocks of BLOCK x BLOCK pixels from the upper left corner of the image on. They are none of the buckets that
slaves are handed: a bucket may have any size, and what a pixel is must not depend on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCK = 8
"""Side of a block [pixels]: with those around it, pixels enough to tell a variance after two passes. With 16, less was
gained on four of six scenes."""


@dataclass(frozen=True, eq=False)
class Allotment:
    """The samples of each block.

    Attributes:
        first: number of the first of the samples that each pixel takes: as many as it has had, int32, shape [rows,
            columns].
        count: how many it takes, int32, as `first`.
    """

    first: NDArray[np.int32]
    count: NDArray[np.int32]

    def __len__(self) -> int:
        """Rows of blocks; 0 where all pixels take as many."""
        return len(self.first)

    def of_pixels(self, x0: int, y0: int, x1: int, y1: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """`first` and `count` of some pixels, shape [y1 - y0, x1 - x0]."""
        rows, columns = np.arange(y0, y1) // BLOCK, np.arange(x0, x1) // BLOCK
        return self.first[np.ix_(rows, columns)], self.count[np.ix_(rows, columns)]


NO_ALLOTMENT = Allotment(np.zeros((0, 0), np.int32), np.zeros((0, 0), np.int32))
"""All pixels take the samples that the View says."""


def blocks_of(width: int, height: int) -> tuple[int, int]:
    """Rows and columns of blocks of an image."""
    return -(-height // BLOCK), -(-width // BLOCK)


def spread(blocks: NDArray[np.generic], width: int, height: int) -> NDArray[np.generic]:
    """A value of each pixel from one of each block, shape [height, width]."""
    return blocks[np.ix_(np.arange(height) // BLOCK, np.arange(width) // BLOCK)]


NOISE_STEPS = range(-2, 5)
"""Powers of the square root of two that samples of blocks are of the image's average: from half to four times. Fewer
than half might lose what a trial has not seen; each number more is a group of pixels of its own."""

MOST_BY_NOISE = 4
"""The largest of them, as a number."""

LEAST_BY_NOISE = 2
"""Samples of any pixel: a single one is spread over nothing, and is far more than twice as noisy as two are."""

LEAST_NOISE = 0.02
UNSEEN_NOISE = 0.005
"""Squared error of a sample that is added everywhere: a share of the mean, and as much as edges, photons and records
make that a trial does not look at. Without the second, cbox and lens-cbox, whose light is smooth, lost where they
should gain: what a trial sees there is a few pixels with ten times the noise of others."""

BY_CHANCE = 0.01
"""Share of a trial's pixels whose noise counts for no more than that of the noisiest others: none decides alone."""

LEAST_WORTH = 0.875
"""Of the error that a trial foretells with as many samples everywhere: if more than that is left, so many are taken."""


def allotment_by_noise(noise: NDArray[np.float64], spp: int, width: int, height: int, multiple: int = 1) -> Allotment:
    """The samples of a render in one pass, by how noisy a trial saw parts of its image.

    Errors fall most where samples go by the root of the squared error of one (Neyman 1934). A trial knows these from a
    few samples: each is the mean of the eight pixels of the trial about a place, and its three-eighth power is taken
    in place of the root, as the most of them are too large and the least too small. What that is worth is told by the
    pixel in the middle, which had no say in it. The trial's own samples are in no image, so what they saw makes none
    darker or brighter.

    Args:
        noise: squared error of a sample, of each pixel of a small picture of the same view, as relMSE weighs it.
        spp: samples of a pixel, on average; no more are allotted.
        width, height: of the image [pixels].
        multiple: of which all numbers of samples are.

    Returns:
        NO_ALLOTMENT where as many samples everywhere are about as good.
    """
    rows, columns = blocks_of(width, height)
    places = np.ix_(_middles(rows, height, len(noise)), _middles(columns, width, noise.shape[1]))
    noise = np.minimum(noise, np.quantile(noise, 1.0 - BY_CHANCE))
    floor = LEAST_NOISE * noise.mean() + UNSEEN_NOISE
    seen, own = _mean_around(noise)[places] + floor, noise[places] + floor
    pixels = _sizes(rows, height)[:, None] * _sizes(columns, width)[None, :]
    counts = [max(LEAST_BY_NOISE, spp * 2.0 ** (0.5 * step)) for step in NOISE_STEPS]
    levels = np.unique([multiple * max(1, round(count / multiple)) for count in counts])
    borders = np.sqrt(levels[:-1] * levels[1:])
    eighth = np.sqrt(np.sqrt(np.sqrt(seen)))
    wanted = eighth * eighth * eighth

    def with_scale(scale: float) -> NDArray[np.int32]:
        return levels[np.searchsorted(borders, scale * wanted)].astype(np.int32)

    if not wanted.min() > 0 or (pixels * levels[0]).sum() >= spp * pixels.sum():
        return NO_ALLOTMENT
    low, high = 0.0, float(levels[-1] / wanted.min())
    for _ in range(SEARCH_STEPS):
        middle = 0.5 * (low + high)
        if (pixels * with_scale(middle)).sum() <= spp * pixels.sum():
            low = middle
        else:
            high = middle
    count = with_scale(low)
    left, even = (pixels * own / count).sum(), (pixels * own).sum() / spp
    return Allotment(np.zeros_like(count), count) if left < LEAST_WORTH * even else NO_ALLOTMENT


SEARCH_STEPS = 40
"""Halvings, until samples are as many as they may be."""


def _mean_around(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the eight about each; beyond an edge are those along it."""
    height, width = values.shape
    padded = np.pad(values, 1, mode="reflect" if min(height, width) > 1 else "edge")
    total = -values
    for y in range(3):
        for x in range(3):
            total = total + padded[y : y + height, x : x + width]
    return np.maximum(total, 0.0) / 8.0


def _middles(blocks: int, side: int, places: int) -> NDArray[np.intp]:
    """In which of so many places along the side of an image the middle of each of its blocks lies."""
    middle = BLOCK * np.arange(blocks) + 0.5 * _sizes(blocks, side)
    return np.minimum(middle * places / side, places - 1).astype(np.intp)


def _sizes(blocks: int, side: int) -> NDArray[np.int64]:
    """Pixels of each of the blocks along a side of an image; the last may have fewer."""
    return np.minimum(BLOCK, side - BLOCK * np.arange(blocks))


OUTLINE_SHARE = 0.125
"""Of the samples of all pixels, those that pixels on outlines take beyond their own, at most."""

OUTLINE_TIMES = 16
"""As many times the samples of others they take, at most. Shares of the error are alike on both sides where samples go
by its root (Neyman 1934): a pixel of which a hundredth is a lamp of a hundred times its light has the variance of a
thousand others."""


@dataclass(frozen=True, eq=False)
class LampOutlines:
    """Pixels that outlines of lamps cross.

    Attributes:
        pixels: numbers of them in what is rendered, row by row, ascending, int32, shape [N].
        times: as many times the samples of other pixels they take.
    """

    pixels: NDArray[np.int32]
    times: int = 1

    def __len__(self) -> int:
        return len(self.pixels)

    def times_of(self, pixels: NDArray[np.integer[Any]]) -> NDArray[np.int32]:
        """As many times the samples of others each of some pixels takes, int32, shape [pixels]."""
        return np.where(np.isin(pixels, self.pixels), np.int32(self.times), np.int32(1))


NO_LAMP_OUTLINES = LampOutlines(np.zeros(0, np.int32))


def lamp_outlines_of(
    whole: NDArray[np.int64], width: int, height: int, crop: tuple[int, int, int, int]
) -> LampOutlines:
    """The outlines in what is rendered.

    Args:
        whole: pixels that they cross, numbers in the whole image, ascending.
        width, height: of the whole image: as many samples go to a pixel of a crop as to that of the image.
        crop: x, y, width and height of what is rendered.
    """
    if not len(whole):
        return NO_LAMP_OUTLINES
    times = 1 + min(OUTLINE_TIMES - 1, math.floor(OUTLINE_SHARE * width * height / len(whole)))
    column, row = whole % width - crop[0], whole // width - crop[1]
    inside = (column >= 0) & (column < crop[2]) & (row >= 0) & (row < crop[3])
    if times == 1 or not inside.any():
        return NO_LAMP_OUTLINES
    return LampOutlines((row * crop[2] + column)[inside].astype(np.int32), times)
