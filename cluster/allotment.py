"""How many samples each part of an image takes in a pass, where that is not as many everywhere.

Pixels that outlines of lamps cross take some times as many as others (kernels.camera.outlines), from the first pass on.
What passes tell, adaptive sampling goes by: it shares samples out by parts of the image.

Parts are blocks of BLOCK x BLOCK pixels from the upper left corner of the image on. They are none of the buckets that
slaves are handed: a bucket may have any size, and what a pixel is must not depend on it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
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


@dataclass(frozen=True, eq=False)
class SampleGroup:
    """Pixels of a bucket that take as many samples.

    Attributes:
        rows: their places among the bucket's pixels.
        first: number of the first sample of each, int32.
        count: samples of each.
    """

    rows: NDArray[np.intp]
    first: NDArray[np.int32]
    count: int


@dataclass(frozen=True)
class Piece:
    """Samples `start` to `stop` - 1, of those that a group takes."""

    group: int
    start: int
    stop: int


def sample_groups(first: NDArray[np.int32], count: NDArray[np.int32], alike: bool) -> list[SampleGroup]:
    """Pixels by how many samples they take, those without any left out.

    Args:
        first, count: of each pixel.
        alike: pixels of a group also begin at the same sample.
    """
    keys = count.astype(np.int64) << 32
    if alike:
        keys += first
    found = []
    for key in np.unique(keys[count > 0]):
        rows = np.flatnonzero(keys == key)
        found.append(SampleGroup(rows, first[rows], int(key >> 32)))
    return found


def waves(groups: list[SampleGroup], most: int) -> Iterator[list[Piece]]:
    """All samples of some groups, of each in their order, at most `most` at once, or one of each pixel of a group."""
    wave: list[Piece] = []
    room = most
    for number, group in enumerate(groups):
        pixels = len(group.rows)
        at_once = max(1, min(group.count, most // pixels))
        for start in range(0, group.count, at_once):
            stop = min(start + at_once, group.count)
            if wave and pixels * (stop - start) > room:
                yield wave
                wave, room = [], most
            wave.append(Piece(number, start, stop))
            room -= pixels * (stop - start)
    if wave:
        yield wave
