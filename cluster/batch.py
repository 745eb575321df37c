"""What travels between workers: ray batches towards cells, results towards homes.

A batch is a set of equally long arrays with names. Its kind says which: `SCHEMAS` names the table of fields of each
(kernels.ray_fields), and the wire checks against it. Rows of several tasks may lie in it: `Runs` says whose they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.rows import take_rows
from wdpm.cluster.runs import HOME, Runs
from wdpm.cluster.runs import join as join_runs
from wdpm.kernels import ray_fields as fields
from wdpm.kernels.fields import Fields, chosen
from wdpm.scenes.errors import ProtocolError

Arrays = Mapping[str, NDArray[Any]]


class Kind(Enum):
    """What a batch holds. The first group goes to a cell, the second to a home."""

    __hash__ = object.__hash__  # there is one object of each; Enum's own takes Python code, some ten times a batch

    START = "start"
    """Camera rays as they set out, by pixel and sample number, in the cell that most of them come to first (routing
    `forward`)."""
    CAMERA = "camera"
    """Camera rays, by pixel and sample number, with the best hit so far."""
    PROBE = "probe"
    """Camera rays, by pixel and sample number, to be intersected here and reported to the home (routing `merge`)."""
    SHADE = "shade"
    """Final camera hits, in the cell that contains the hit point."""
    PATH = "path"
    """Camera paths that have left their first surface, with the best hit so far."""
    VERTEX = "vertex"
    """Camera paths whose hit is final, in the cell that contains the hit point."""
    CANDIDATE = "candidate"
    """Camera rays through candidates for irradiance records, or what they show in mirrors and through glass, with the
    best hit so far."""
    CANDIDATE_HIT = "candidate_hit"
    """Those rays whose hit is final, in the cell that contains the hit point."""
    SHADOW = "shadow"
    """Shadow segments: what arrives in their slot if nothing blocks them."""
    SHADOW_WALK = "shadow_walk"
    """Shadow segments where light may pass straight through surfaces or media, with the best hit so far."""
    SHADOW_WALK_HIT = "shadow_walk_hit"
    """Shadow segments whose hit is final, in the cell that contains the hit point: it may let light pass."""
    BEAM = "beam"
    """Stretches of camera rays in a medium, with the sums of what photons near them scatter towards the camera."""
    PHOTON = "photon"
    """Photons in flight, with the best hit so far."""
    LANDED = "landed"
    """Photons whose hit is final, in the cell that contains the hit point."""
    GHOST_PHOTONS = "ghost_photons"
    """Copies of photons that lie in the destination cell's overlap band."""

    GHOST_POINTS = "ghost_points"
    """Copies of surface points that lie in the destination cell's overlap band."""
    COPIED_PHOTONS = "copied_photons"
    """Photons of the destination cell that landed in another team, which has the same cell."""
    COPIED_ORDER = "copied_order"
    """What another team, which has the same cell, has sorted of the trees of its photons and surface points."""
    COPIED_IRRADIANCE = "copied_irradiance"
    """Irradiance at photons of the destination cell that another team has worked out."""

    PROBED = "probed"
    """What a probe found: hits by slot."""
    SAMPLES = "samples"
    """What camera samples see, but for direct light: the fixed slots of a home."""
    PIXELS = "pixels"
    """Sums over samples that set out together, all of which came to their ends in the cell where they did."""
    LIT = "lit"
    """Parts of camera samples, by slot and place: direct light, and all that later vertices of a path add."""
    GATHERED = "gathered"
    """All that gather rays of irradiance records bring that came to their ends in the cell where they arrived."""
    RECORD_SITES = "record_sites"
    """Where rays through candidates found that an irradiance record is wanted."""
    ENDED = "ended"
    """Nothing but credit: rays that ended."""


TO_HOME = frozenset({Kind.PROBED, Kind.SAMPLES, Kind.PIXELS, Kind.LIT, Kind.GATHERED, Kind.RECORD_SITES, Kind.ENDED})

GHOSTS = frozenset({Kind.GHOST_PHOTONS, Kind.GHOST_POINTS})
"""What slaves of a team exchange before they build their maps."""

OF_MAPS = GHOSTS | {Kind.COPIED_PHOTONS, Kind.COPIED_ORDER, Kind.COPIED_IRRADIANCE}
"""What maps are built of, besides what landed in the cell itself. It belongs to no task, and is counted by batches."""

SCHEMAS: Final[dict[Kind, Fields]] = {
    Kind.START: fields.START,
    Kind.CAMERA: fields.CAMERA_RAY,
    Kind.PROBE: fields.RAY,
    Kind.SHADE: fields.CAMERA_RAY,
    Kind.PATH: fields.PATH,
    Kind.VERTEX: fields.PATH,
    Kind.CANDIDATE: fields.PATH,
    Kind.CANDIDATE_HIT: fields.PATH,
    Kind.SHADOW: fields.SEGMENT,
    Kind.SHADOW_WALK: fields.WALK,
    Kind.SHADOW_WALK_HIT: fields.WALK,
    Kind.BEAM: fields.BEAM,
    Kind.PHOTON: fields.PHOTON,
    Kind.LANDED: fields.PHOTON,
    Kind.GHOST_PHOTONS: fields.STORED_PHOTON,
    Kind.GHOST_POINTS: fields.SURFACE_POINT,
    Kind.COPIED_PHOTONS: fields.STORED_PHOTON,
    Kind.COPIED_ORDER: fields.TREE_PLACES,
    Kind.COPIED_IRRADIANCE: fields.IRRADIANCE_POINT,
    Kind.PROBED: {**chosen(fields.RAY, "slot"), **fields.HIT},
    Kind.SAMPLES: fields.SAMPLE,
    Kind.PIXELS: fields.PIXEL,
    Kind.LIT: fields.PART,
    Kind.GATHERED: fields.GATHERED,
    Kind.RECORD_SITES: fields.SITE,
    Kind.ENDED: {},
}
"""The arrays of each kind of batch, in the order in which they travel."""


_COLUMNS: Final[dict[Kind, tuple[tuple[str, np.dtype[Any], tuple[int, ...]], ...]]] = {
    kind: tuple((name, np.dtype(field.dtype), field.shape) for name, field in schema.items())
    for kind, schema in SCHEMAS.items()
}
"""The same with NumPy's types, which take their time to be made."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Arrays of one kind on their way to a cell or to a home.

    Attributes:
        cell: the destination cell; for kinds that go to a home, a cell of the worker it comes from.
        runs: whose the rows are. What goes to a home has runs of that home alone.
        arrays: as SCHEMAS[kind] says.
    """

    kind: Kind
    cell: int
    runs: Runs
    arrays: Arrays

    @classmethod
    def of_task(cls, kind: Kind, task: int, home: int, cell: int, credit: int, arrays: Arrays) -> Batch:
        """A batch all of whose rows belong to one task: see Runs.table."""
        rows = next((len(array) for array in arrays.values()), 0)
        return cls(kind, cell, Runs.one(home, task, rows, credit), arrays)

    def __len__(self) -> int:
        for array in self.arrays.values():
            return len(array)
        return 0

    @property
    def home(self) -> int:
        """Where it goes, if it goes to a home."""
        return int(self.runs.table[0, HOME])

    @property
    def credit(self) -> int:
        """That of all runs."""
        return int(self.runs.credit.sum())

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(array.nbytes for array in self.arrays.values())

    def check(self) -> None:
        """Raise ProtocolError unless names, dtypes, shapes and lengths are those of the kind."""
        schema = SCHEMAS[self.kind]
        if self.arrays.keys() != schema.keys():
            raise ProtocolError(
                f"a {self.kind.value} batch has arrays {sorted(self.arrays)}; expected {sorted(schema)}"
            )
        count = len(self)
        for name, dtype, shape in _COLUMNS[self.kind]:
            array = self.arrays[name]
            if array.dtype != dtype or array.shape != (count, *shape):
                raise ProtocolError(
                    f"{self.kind.value}.{name} is {array.dtype} {array.shape}; expected {dtype.str} {(count, *shape)}"
                )


def take(arrays: Arrays, rows: NDArray[np.intp] | slice) -> dict[str, NDArray[Any]]:
    """Some rows of every array, ascending; the arrays themselves where that is all of them."""
    if isinstance(rows, slice):
        return {name: array[rows] for name, array in arrays.items()} if rows != slice(None) else dict(arrays)
    if len(rows) == len(next(iter(arrays.values()))):
        return dict(arrays)
    return take_some(arrays, rows)


def take_some(arrays: Arrays, rows: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
    """Some rows of every array, in any order."""
    return {name: take_rows(array, rows) for name, array in arrays.items()}


def take_in_order(arrays: Arrays, rows: NDArray[np.intp], name: str, runs: Runs) -> dict[str, NDArray[Any]]:
    """Some rows of every array, those of each run in the order of one of them; equal ones in any order.

    Args:
        name: of an array of int32.
        runs: of those rows.
    """
    key = arrays[name][rows]
    if len(runs) > 1:
        key = (runs.numbers() << 32) | key
    return take_some(arrays, rows.take(key.argsort()))


def concatenate(parts: Iterable[Arrays], kind: Kind) -> dict[str, NDArray[Any]]:
    """Arrays of several batches of one kind, one after another."""
    parts = list(parts)
    if not parts:
        return zeros(kind)
    return {name: np.concatenate([part[name] for part in parts]) for name in SCHEMAS[kind]}


FEW_TO_JOIN = 64
"""Rows of a run below which copying all rows twice takes less time than a view of each run of each array."""


def joined(batches: Sequence[Batch]) -> Batch:
    """Batches of one kind and destination as one."""
    if len(batches) == 1:
        return batches[0]
    kind, cell = batches[0].kind, batches[0].cell
    of_tasks, order = join_runs([batch.runs for batch in batches])
    arrays = [batch.arrays for batch in batches]
    if order is None:
        return Batch(kind, cell, of_tasks, concatenate(arrays, kind))
    if sum(map(len, batches)) >= FEW_TO_JOIN * len(order):
        return Batch(kind, cell, of_tasks, concatenate(_runs_in_order(batches, order), kind))
    return Batch(kind, cell, of_tasks, take_some(concatenate(arrays, kind), _rows_in_order(batches, order)))


def _rows_in_order(batches: Sequence[Batch], order: Sequence[int]) -> NDArray[np.intp]:
    """The rows of all batches, one after another, by run.

    Args:
        order: as _runs_in_order has it.
    """
    lengths = np.concatenate([batch.runs.rows for batch in batches])
    begins, sorted_lengths = (lengths.cumsum() - lengths).take(order), lengths.take(order)
    places = sorted_lengths.cumsum() - sorted_lengths
    return np.arange(sorted_lengths.sum()) + (begins - places).repeat(sorted_lengths)


def _runs_in_order(batches: Sequence[Batch], order: Sequence[int]) -> list[Arrays]:
    """The arrays of some runs of batches, as views.

    Args:
        order: numbers of runs, those of one batch after those of another.
    """
    runs = [(batch.arrays, slice(*ends)) for batch in batches for ends in pairwise(batch.runs.bounds.tolist())]
    return [{name: array[rows] for name, array in arrays.items()} for arrays, rows in (runs[i] for i in order)]


def pieces(batch: Batch, most: int) -> Iterator[Batch]:
    """A batch of one task, each of whose rows has the same credit, in pieces of at most so many rows.

    One whose credit is not that of its rows is left whole. Samples that set out together stay so, and may be more.
    """
    count, credit = len(batch), batch.credit
    if count <= most or credit % count:
        yield batch
        return
    first = 0
    while first < count:
        end = _end_of_piece(batch, first, min(first + most, count))
        size = end - first
        runs = Runs.one(batch.home, int(batch.runs.task[0]), size, size * (credit // count))
        yield Batch(batch.kind, batch.cell, runs, take(batch.arrays, slice(first, end)))
        first = end


def _end_of_piece(batch: Batch, first: int, end: int) -> int:
    """Where a piece that begins at row `first` ends, about at `end`: not within samples that set out together."""
    if batch.kind is not Kind.START:
        return end
    together = batch.arrays["together"][first:end]
    begins = together.nonzero()[0]
    if not len(begins):
        return end
    begin = first + int(begins[-1])
    until = begin + int(together[begins[-1]])
    if until <= end:
        return end
    return begin if begin > first else until


def zeros(kind: Kind, count: int = 0) -> dict[str, NDArray[Any]]:
    """Arrays of a kind of batch: `count` items of zeros."""
    return {name: np.zeros((count, *field.shape), field.dtype) for name, field in SCHEMAS[kind].items()}


def by_destination(destination: NDArray[np.int32], chosen: NDArray[np.bool_]) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """The chosen rows, grouped by destination, in ascending order of both.

    Raises:
        ProtocolError: a chosen one is negative, as a ray's may be that somebody sent.
    """
    rows = chosen.nonzero()[0]
    if not len(rows):
        return
    targets = destination.take(rows)
    least, most = int(np.minimum.reduce(targets)), int(np.maximum.reduce(targets))
    if least < 0:
        raise ProtocolError(f"something is on its way to cell {least}")
    if least == most:
        yield most, rows
        return
    if most >= 1 << 16:  # more than a scene has cells, unless somebody sent nonsense, which no memory may be kept for
        for target in np.unique(targets):
            yield int(target), rows.take((targets == target).nonzero()[0])
        return
    counts = np.bincount(targets)
    # NumPy sorts numbers of 8 or 16 bits by their digits: in a third of the time that np.unique takes for its part.
    digits = np.uint8 if most < 1 << 8 else np.uint16
    ordered = rows.take(targets.astype(digits).argsort(kind="stable"))
    there = counts.nonzero()[0]
    ends = counts.take(there).cumsum().tolist()
    for target, start, end in zip(there.tolist(), [0, *ends], ends, strict=False):
        yield target, ordered[start:end]


def by_home(batches: Iterable[Batch]) -> Iterator[Batch]:
    """The same batches without runs of nothing; those that go to homes are cut, so that each goes to one.

    Of what maps are built of, empty batches are kept: they are counted.
    """
    for batch in batches:
        runs = batch.runs if batch.kind in OF_MAPS else batch.runs.occupied()
        if not len(runs):
            continue
        if batch.kind not in TO_HOME:
            yield batch if runs is batch.runs else replace(batch, runs=runs)
            continue
        for _, some, rows in runs.slices(HOME):
            yield Batch(batch.kind, batch.cell, some, take(batch.arrays, rows))
