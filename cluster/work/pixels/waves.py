"""The samples of a bucket in waves: pixels that take as many samples together, so many samples at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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
