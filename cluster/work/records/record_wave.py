"""Gather rays of some records that are under way at once: how they start, and what comes back."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Batch, Kind, by_destination, concatenate, take
from wdpm.cluster.rows import in_order, put_rows, summed, take_rows
from wdpm.cluster.runs import Runs
from wdpm.cluster.work import parts
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.work.records.extra_rays import ExtraRays, numbered
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.work.whole.samples import RecordRays
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.camera.rays import first_path_cells
from wdpm.kernels.irradiance.record_rays import Sites, start_record_rays
from wdpm.kernels.irradiance.records import make_strata, record_directions
from wdpm.kernels.launch import Launcher
from wdpm.kernels.limits import FURTHER_RAYS, RAY_SAMPLES


@dataclass(frozen=True, eq=False)
class GatherRays:
    """Which rays: one an item, int32.

    Attributes:
        record: that it is of, by its place among the sites.
        ray: its number, another one for each ray of its record: what the random numbers of its path are a function of.
        stratum: of the hemisphere that it goes through: row * columns + column.
        turn: its number among those of its stratum: what its place in that is a function of.
    """

    record: NDArray[np.int32]
    ray: NDArray[np.int32]
    stratum: NDArray[np.int32]
    turn: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.record)

    def cut(self, most: int) -> Iterator[GatherRays]:
        """The same rays in pieces of so many at most, none of them empty."""
        for first in range(0, len(self), most):
            piece = slice(first, first + most)
            yield GatherRays(self.record[piece], self.ray[piece], self.stratum[piece], self.turn[piece])


def first_rays(sites: int, rows: int, columns: int) -> GatherRays:
    """One ray through each stratum of each record."""
    strata = np.arange(rows * columns, dtype=np.int32)
    record, stratum = np.repeat(np.arange(sites, dtype=np.int32), len(strata)), np.tile(strata, sites)
    number = np.tile(_numbers(rows, columns).astype(np.int32), sites)
    return GatherRays(record, number, stratum, np.zeros_like(stratum))


def further_rays(launcher: Launcher, extra: ExtraRays, rows: int, columns: int) -> GatherRays:
    """As many more as are asked for, numbered stratum by stratum in the order of a record's first ones.

    Args:
        extra: of rows * columns strata.
    """
    first = _numbers(rows, columns)
    return GatherRays(*numbered(launcher, extra, first.argsort().astype(np.int32), FURTHER_RAYS))


@functools.cache
def _numbers(rows: int, columns: int) -> NDArray[np.int64]:
    """Numbers of the first rays of a record's strata: bits of row and column by turns (Morton 1966), shape [strata].

    Points of a stream are even over each range of numbers (kernels/maths/random.py), so what one lamp or one near wall
    takes up of a hemisphere should be few ranges of numbers: then shadow rays there, and the bounces of rays that go
    on, are spread evenly among each other. (Ahmed & Wonka 2020, "Screen-Space Blue-Noise Diffusion of Monte Carlo
    Sampling Error via Hierarchical Ordering of Pixels", number pixels so.) Where rows or columns are no power of two
    some numbers are nobody's.
    """
    row, column = np.divmod(np.arange(rows * columns, dtype=np.int64), columns)
    number = np.zeros_like(row)
    for bit in range(max(rows, columns).bit_length()):
        number |= (column >> bit & 1) << (2 * bit) | (row >> bit & 1) << (2 * bit + 1)
    number.flags.writeable = False
    return number


class RecordWave:
    """Rays of the records of some sites.

    Args:
        sites: kernels.ray_fields.SITE, and the pixels that saw them.
        numbers: of the records.
        strata: rows and columns of their hemispheres.

    Attributes:
        distance: of what each ray met [scene units]; inf if nothing, negative if it was not shot.
    """

    def __init__(
        self,
        replica: Replica,
        view: View,
        sites: Arrays,
        numbers: NDArray[np.int64],
        strata: tuple[int, int],
        rays: GatherRays,
    ) -> None:
        self._replica = replica
        self._view = view
        self._sites = sites
        self._numbers = numbers
        self._strata = strata
        self._rays = rays
        self._lit: list[Arrays] = []
        self._gathered: list[Arrays] = []
        self._whole: NDArray[np.float64] | None = None  # what came along each, where all is known at once
        self.distance = np.zeros(0, np.float32)

    def __len__(self) -> int:
        return len(self._rays)

    def _begin(self) -> RecordRays:
        """The rays as they set out."""
        replica, view, count = self._replica, self._view, len(self._rays)
        device = replica.launcher.device
        rays = self._rays
        record, ray, stratum, turn = (
            columns.array_over(column, wp.int32, device) for column in (rays.record, rays.ray, rays.stratum, rays.turn)
        )
        direction, distance = columns.outputs({"direction": wp.vec3, "distance": wp.float32}, count, device).values()
        normal, shading_normal = (
            columns.array_over(self._sites[name], wp.vec3, device) for name in ("normal", "shading_normal")
        )
        replica.launcher(
            record_directions,
            count,
            strata=make_strata(*self._strata, device),
            number=columns.array_over(self._numbers, wp.int64, device),
            normal=normal,
            shading_normal=shading_normal,
            seed=replica.world.seed,  # that of the pass
            record=record,
            stratum=stratum,
            turn=turn,
            direction_out=direction,
            distance_out=distance,
        )
        paths = columns.empty(Paths, count, device)
        sites = columns.upload(Sites, {name: self._sites[name] for name in ("position", "normal", "pixel")}, device)
        replica.launcher(
            start_record_rays,
            count,
            sites=sites,
            direction=direction,
            distance=distance,
            record=record,
            ray=ray,
            first_sample=RAY_SAMPLES,
            medium=-1 if view.camera.medium is None else view.camera.medium,
            offset_min=replica.lights.offset_min,
            paths_out=paths,
        )
        return RecordRays(paths, distance.numpy(), sites, self._rays.record, self._rays.ray)

    def trace_whole(self, scene: Cell) -> bool:
        """Follow all rays to their ends at once, if that can be: nothing of the wave is under way then."""
        traced = scene.trace_rays_whole(self._begin())
        if traced is None:
            return False
        self._whole, self.distance = traced.radiance, traced.distance
        scene.count_whole(traced.counts)
        return True

    def start(self, task: int, home: int, cell: Cell | None) -> Iterator[Batch]:
        """Send all rays on their way.

        Args:
            task, home: whose they are.
            cell: of the same worker, where most of them set out; it is asked at once about all that come to it first.
                So others are sent all of theirs together, and what has arrived is sorted as one. None: that is another
                worker's.
        """
        begun = self._begin()
        self.distance = begun.distance
        if cell is None:
            yield from self._start_elsewhere(task, home, begun.paths)
            return
        for batch in cell.start_paths(Runs.one(home, task, len(self), 0), begun.paths):
            if batch.kind is not Kind.ENDED:  # credit that never sets out
                yield batch

    def _start_elsewhere(self, task: int, home: int, paths: Any) -> Iterator[Batch]:
        """Send all rays to the cells that they come to first.

        Args:
            paths: kernels.camera.paths.Paths.
        """
        replica, view, count = self._replica, self._view, len(self._rays)
        first = columns.integers(count, replica.launcher.device)
        misses = int(replica.world.features.misses)
        replica.launcher(first_path_cells, count, cells=replica.cells, paths=paths, misses=misses, next_cell_out=first)
        arrays, destination = columns.download(paths, SCHEMAS[Kind.PATH]), first.numpy()
        for cell, rows in by_destination(destination, destination >= 0):
            sent, runs = take(arrays, rows), Runs.one(home, task, len(rows), 0)
            credit = parts.credit_of(runs, sent["bounce"], view.light_samples)
            yield Batch(Kind.PATH, cell, runs.with_credit(credit), sent)

    def take(self, batch: Batch) -> None:
        """Light that came along some rays, and how far they went."""
        lit = batch.arrays
        if batch.kind is Kind.GATHERED:
            self._gathered.append(lit)
            return
        reach = parts.part_of(lit["place"], self._view.light_samples) == parts.REACH
        rows = np.flatnonzero(reach)
        self.distance[lit["slot"][rows]] = lit["radiance"][rows, 0]
        self._lit.append(take(lit, np.flatnonzero(~reach)))

    def radiance(self) -> NDArray[np.float64]:
        """What came along each ray, added in the order of the parts' places, shape [rays, 3]. It is let go of."""
        if self._whole is not None:
            whole, self._whole = self._whole, None
            return whole
        together = concatenate(self._lit, Kind.LIT)
        self._lit = []
        order = in_order(together["slot"], together["place"])
        slot, radiance = together["slot"][order], take_rows(together["radiance"], order)
        light = summed(slot, radiance, len(self._rays))
        for gathered in self._gathered:
            put_rows(light, gathered["slot"], gathered["radiance"])
            self.distance[gathered["slot"]] = gathered["distance"]
        self._gathered = []
        return light
