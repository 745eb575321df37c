"""Records of the irradiance cache: what they hold, and where they are looked for.

Records are made in rounds. The candidates of a round are pixels of a grid, each round's twice as fine as the one
before; where earlier records leave the surface that such a pixel sees uncovered, there will be a record. So where
records lie and what they hold is a function of the scene and the settings alone: all of a round are made without
knowledge of each other, and published before the next (Ward, Rubinstein & Clear 1988 fill a cache as the picture is
scanned, and what it holds depends on the order).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import ProtocolError

ROUND_BITS = 32
"""A record's number is round * 2^32 + place of its pixel in the round's candidates."""

NEIGHBOURS = 8
"""Candidates of one row that follow each other: their camera rays meet the same triangles."""

GOLDEN = 0.6180339887498949

STRATA_SPACING = 4
"""Distance of candidates for whose records CachePlan.rows and columns are [pixels]."""

FEWEST_STRATA, MOST_STRATA = 0.7, 4.0
"""Bounds of the strata of other records, as a share of those."""

LEAST_RAYS = 0.125
"""Gather rays of a record, as a share of those of CachePlan.rows and columns, however few the samples."""


@dataclass(frozen=True)
class CachePlan:
    """How the records of a view are made.

    Attributes:
        rounds: how many; 0 for a view without a cache.
        spacing: of the candidates of the first round [pixels].
        rows, columns: strata of a record's gather rays in elevation and azimuth, where candidates lie STRATA_SPACING
            pixels apart.
        error: how far records reach, as a share of the harmonic mean distance of what they see (Ward's a).
        clearance: how far at most, as a share of the distance of the nearest thing that they see.
        least, most: bounds of a record's radius [pixels].
        left, top: where the grid of candidates begins [pixels]; another place in each pass.
        tolerance: relative standard error of a record's irradiance that extra gather rays are to bring it to, where
            candidates lie STRATA_SPACING pixels apart or further.
        extra: most of them, in rays of one a stratum; 0 for none.
        least_rays: of a record, as a share of rows * columns, however few the samples (rendering.pass_plan.worth).
        wanted: weight of the records around a candidate that makes another one superfluous.
    """

    rounds: int = 0
    spacing: int = 1
    rows: int = 1
    columns: int = 1
    error: float = 1.0
    clearance: float = 1.0
    least: float = 1.0
    most: float = 1.0
    wanted: float = 0.0
    left: int = 0
    top: int = 0
    tolerance: float = 1.0
    extra: float = 0.0
    least_rays: float = LEAST_RAYS

    def strata(self, number: int) -> tuple[int, int]:
        """Rows and columns of strata of the records of a round.

        A record that was wanted where candidates lie far apart serves many pixels, one of the last rounds a few: rays
        go with the spacing, as far as they are still enough for gradients, or not yet better than what is between.
        """
        spacing = max(1, self.spacing >> number)
        finer = math.sqrt(min(max(spacing / STRATA_SPACING, FEWEST_STRATA), MOST_STRATA))
        return max(1, round(self.rows * finer)), max(3, round(self.columns * finer))

    def tolerance_in(self, number: int) -> float:
        """Relative standard error that extra gather rays are to bring records of a round to.

        An error is seen by how wide it is. Where candidates lie close, records reach a few pixels and many of them tell
        of each: the fewer pixels a candidate stands for, the more its record may err, as with its strata.
        """
        spacing = max(1, self.spacing >> number)
        return self.tolerance * math.sqrt(max(STRATA_SPACING / spacing, 1.0))


NO_CACHE = CachePlan()
"""Of a view without a cache."""


def candidate_count(width: int, height: int, plan: CachePlan, number: int) -> int:
    """How many candidates a round has; arguments as of `candidates`."""
    return int(_grid(width, height, plan, number).lengths.sum())


def candidates(
    width: int, height: int, plan: CachePlan, number: int, start: int = 0, stop: int | None = None
) -> NDArray[np.int32]:
    """The pixels of a round's candidates, counted row by row: every so many-th, but those of earlier rounds.

    They come in an order of which each range is spread over the whole image, a few neighbours at a time: tasks are
    ranges of them, and what a record costs differs from one part of an image to another by more than ten times.

    Args:
        width, height: of the image [pixels].
        number: of the round, from 0.
        start, stop: the range that is asked for, all if they are left out. A round has as many candidates as the image
            has pixels, so a task finds its own alone.
    """
    count = candidate_count(width, height, plan, number)
    return candidates_at(width, height, plan, number, np.arange(start, count if stop is None else min(stop, count)))


def candidates_at(
    width: int, height: int, plan: CachePlan, number: int, items: NDArray[np.integer[Any]]
) -> NDArray[np.int32]:
    """The pixels of some of a round's candidates, given by their places in that order; see `candidates`."""
    grid = _grid(width, height, plan, number)
    ends = np.cumsum(grid.lengths)
    place = _spread(int(ends[-1]) if len(ends) else 0, items)
    row = ends.searchsorted(place, side="right")
    along = place - (ends - grid.lengths)[row]
    x = np.concatenate([grid.x, grid.x[grid.new_columns]])[along + np.where(grid.new_rows[row], 0, len(grid.x))]
    return (grid.y[row] * width + x).astype(np.int32)


@dataclass(frozen=True, eq=False)
class _Grid:
    """Pixels that are candidates of a round or of one before it.

    Attributes:
        x, y: of its columns and rows.
        new_columns, new_rows: those in which there was no candidate before.
    """

    x: NDArray[np.intp]
    y: NDArray[np.intp]
    new_columns: NDArray[np.bool_]
    new_rows: NDArray[np.bool_]

    @property
    def lengths(self) -> NDArray[np.intp]:
        """Candidates of the round in each row: of a row that earlier rounds have visited those between theirs."""
        return np.where(self.new_rows, len(self.x), np.count_nonzero(self.new_columns))


def _grid(width: int, height: int, plan: CachePlan, number: int) -> _Grid:
    step = max(1, plan.spacing >> number)
    x, y = np.arange(plan.left % step, width, step), np.arange(plan.top % step, height, step)
    if not number:
        return _Grid(x, y, np.ones(len(x), np.bool_), np.ones(len(y), np.bool_))
    before = 2 * step
    return _Grid(x, y, (x - plan.left) % before != 0, (y - plan.top) % before != 0)


def _spread(count: int, items: NDArray[np.integer[Any]]) -> NDArray[np.intp]:
    """Some of `count` places, runs of them in the order of multiples of the golden ratio: none is left out for long."""
    runs = -(-count // NEIGHBOURS)
    order = np.argsort(np.arange(runs) * GOLDEN % 1.0)
    rank = np.empty(runs, np.intp)
    rank[order] = np.arange(runs)
    item = items.astype(np.intp)
    if missing := runs * NEIGHBOURS - count:  # the last run is shorter, wherever it comes
        item[item >= (order[-1] + 1) * NEIGHBOURS - missing] += missing
    return rank[item // NEIGHBOURS] * NEIGHBOURS + item % NEIGHBOURS


@dataclass(frozen=True, eq=False)
class Records:
    """Irradiance records, in the order of their numbers.

    Attributes:
        number: round * 2^32 + place of the pixel in the round's candidates, int64, shape [N].
        position: float32, shape [N, 3].
        normal: unit shading normal, float32, shape [N, 3].
        irradiance: [W/m²], float32, shape [N, 3].
        rotation, translation: its gradients, one row a channel, float32, shape [N, 3, 3].
        grazing: how much the light grazes the surface (kernels.maths.schlick), float32, shape [N].
        radius: how far the record reaches, float32, shape [N]. Places and lengths are in the renderer's space.
        error: standard error of the irradiance, as its own rays tell it, mean of RGB [W/m²], float32, shape [N].
    """

    number: NDArray[np.int64]
    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    irradiance: NDArray[np.float32]
    rotation: NDArray[np.float32]
    translation: NDArray[np.float32]
    grazing: NDArray[np.float32]
    radius: NDArray[np.float32]
    error: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.number)

    def take(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Records:
        """Some of them."""
        return Records(*(getattr(self, field.name)[rows] for field in fields(Records)))


NO_RECORDS = Records(
    np.empty(0, np.int64),
    np.empty((0, 3), np.float32),
    np.empty((0, 3), np.float32),
    np.empty((0, 3), np.float32),
    np.empty((0, 3, 3), np.float32),
    np.empty((0, 3, 3), np.float32),
    np.empty(0, np.float32),
    np.empty(0, np.float32),
    np.empty(0, np.float32),
)
"""Of a view without a cache, or before its first round."""


def joined(parts: Sequence[Records]) -> Records:
    """Records of several tasks or rounds as one set, in the order of their numbers."""
    # A round may have no tasks: the grid of its candidates may pass a small image by.
    parts = [NO_RECORDS, *parts]
    whole = {field.name: np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Records)}
    order = np.argsort(whole["number"])
    return Records(**{name: column[order] for name, column in whole.items()})


def of_rounds(records: Records, count: int) -> NDArray[np.intp]:
    """Which of the records are those of the first `count` rounds."""
    return np.flatnonzero(records.number < np.int64(count) << np.int64(ROUND_BITS))


def equal(a: Records, b: Records) -> bool:
    """Whether all bits are equal."""
    return all(getattr(a, field.name).tobytes() == getattr(b, field.name).tobytes() for field in fields(Records))


def take_near(records: Records, boxes: Sequence[tuple[NDArray[np.float32], NDArray[np.float32]]]) -> Records:
    """The records that reach into one of some boxes, each given by its low and its high corner."""
    reaches = np.zeros(len(records), np.bool_)
    for low, high in boxes:
        outside = np.maximum(np.maximum(low - records.position, records.position - high), 0.0).astype(np.float64)
        # The comparison is generous by a share of 2^-18, as the boxes of kernels/irradiance/record_tree.py are.
        reach = records.radius.astype(np.float64) * (1.0 + 2.0**-18)
        reaches |= (outside**2).sum(axis=1) <= reach**2
    return records if reaches.all() else records.take(reaches)


LARGEST = 1e35
"""Of a record's numbers, as it is made: what becomes of it among others, and how far it is read, stays finite."""


def moderate(records: Records) -> bool:
    """Whether records, from the wire or a file, may be smoothed and read further: no number is too large."""
    return all(bool((np.abs(column) <= LARGEST).all()) for name, column in vars(records).items() if name != "number")


def check_records(records: Records, number: int, start: int, stop: int, some: NDArray[np.int32] | None = None) -> None:
    """Raise ProtocolError unless records may be those of the candidates start to stop - 1 of a round.

    Args:
        some: the only ones of these that they may be of, ascending; all if None or empty.
    """
    count, first = len(records), number << ROUND_BITS
    for field in fields(Records):
        column = getattr(records, field.name)
        if len(column) != count or not np.isfinite(column).all():
            raise ProtocolError(f"irradiance records: {field.name} is not finite, or not one for each of {count}")
    if not moderate(records):
        raise ProtocolError(f"irradiance records with numbers above {LARGEST:g}")
    wrong = (np.diff(records.number) <= 0).any() or (records.radius <= 0).any() or (records.error < 0).any()
    if wrong or (count and not first + start <= records.number[0] <= records.number[-1] < first + stop):
        raise ProtocolError(f"irradiance records are not those of candidates {start} to {stop - 1} of round {number}")
    if count and some is not None and len(some) and not _among(records.number - first, some):
        raise ProtocolError(f"irradiance records of round {number} are of candidates that were not asked for")


def _among(values: NDArray[np.int64], ascending: NDArray[np.int32]) -> bool:
    """Whether all values are among others, at least one, that ascend; np.isin sorts both, in nine times the time."""
    place = ascending.searchsorted(values.astype(np.int32))
    return bool((ascending[np.minimum(place, len(ascending) - 1)] == values).all())
