"""Where the irradiance records of a task are made: candidates out, sites back, gather rays out, light back, records."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator, Mapping

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Batch, Kind, by_destination, concatenate, take
from wdpm.cluster.records import NO_RECORDS, ROUND_BITS, Records, candidates_at, joined
from wdpm.cluster.rows import take_rows
from wdpm.cluster.task import RecordsMade, RecordTask
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.work.misses import first_cells, no_hits, start_paths
from wdpm.cluster.work.records.extra_rays import (
    GRAIN,
    ExtraRays,
    Values,
    extra_rays,
    means,
    no_extra_rays,
    standard_errors,
)
from wdpm.cluster.work.records.record_wave import GatherRays, RecordWave, first_rays, further_rays
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera.rays import Rays
from wdpm.kernels.irradiance.records import Bounds, MadeRecords, make_records, make_strata
from wdpm.kernels.irradiance.unoccluded_light import unoccluded_radiance, upload
from wdpm.scenes.errors import ProtocolError

WAVE_RAYS = 1 << 17
"""Gather rays of a task that are under way at once, at most, or those of one record: bounds memory, changes no bit."""

DIVIDED_WAVE_RAYS = 1 << 18
"""The same where the scene is divided into cells. Each wave ends with a few rays that many holders of cells send each
other, which take as long as many; and while those are under way, the next wave waits."""


class RecordHome:
    """Some of a round's candidates.

    Args:
        held: cells of the same worker, by number.
        scene: the only cell, where it can follow gather rays to their ends at once.
    """

    def __init__(
        self,
        task: RecordTask,
        number: int,
        replica: Replica,
        view: View,
        held: Mapping[int, Cell],
        scene: Cell | None = None,
    ) -> None:
        self.task = task
        self._held = held
        self._scene = scene
        self._number = number
        self._replica = replica
        self._view = view
        width, height = view.camera.width, view.camera.height
        self._candidates = task.candidates
        self._pixels = candidates_at(width, height, view.cache, task.round, self._candidates)
        self._strata = view.cache.strata(task.round)
        self._credit = 0
        self._found: list[Arrays] = []
        self._where: Counter[int] = Counter()  # sites, by their cells
        self._sites: Arrays = {}
        self._next_site = 0
        self._searching = True
        self._site: Arrays = {}
        self._wave: RecordWave | None = None
        self._first: tuple[Values, NDArray[np.float32], ExtraRays] | None = None  # once the rays after them are known
        self._most_rays = WAVE_RAYS if replica.world.top_tree.cells == 1 else DIVIDED_WAVE_RAYS
        self._further: deque[GatherRays] = deque()  # those of them that have not set out
        self._light: list[Values] = []  # of those that are back
        self._made: list[Records] = []
        self._rays = 0

    def begin(self) -> Iterator[Batch]:
        """Send a camera ray through each candidate."""
        replica, count = self._replica, len(self._pixels)
        arrays: Arrays = {
            "slot": np.arange(count, dtype=np.int32),
            "pixel": self._pixels,
            "sample": np.full(count, self._view.first_sample, np.int32),
            **no_hits(count, self._view),
        }
        rays = columns.upload(Rays, arrays, replica.launcher.device)
        destination = first_cells(replica, rays, count)
        paths = columns.download(start_paths(replica, rays, count), SCHEMAS[Kind.CANDIDATE])
        self._credit = count
        for cell, rows in by_destination(destination, destination >= 0):
            yield self._batch(Kind.CANDIDATE, cell, len(rows), take(paths, rows))
        if not self._credit:
            self._end_search()

    def receive(self, batch: Batch) -> Iterator[Batch]:
        """Take in sites, then light; shoot once all sites are known."""
        if batch.kind is Kind.RECORD_SITES and self._searching:
            self._check_slots(batch, len(self._pixels))
            self._found.append(batch.arrays)
            self._where[batch.cell] += len(batch)
        elif batch.kind in (Kind.LIT, Kind.GATHERED) and self._wave is not None:
            self._check_slots(batch, len(self._wave))
            self._wave.take(batch)
        elif batch.kind is not Kind.ENDED:
            raise ProtocolError(f"a {batch.kind.value} batch came home to record task {self.task.number}")
        self._credit -= batch.credit
        if self._credit == 0:
            if self._searching:
                self._end_search()
            while not self._credit and (self._wave is not None or self._next_site < len(self._sites["slot"])):
                yield from self._go_on()

    def _end_search(self) -> None:
        """Put the sites in order."""
        self._searching = False
        sites = concatenate(self._found, Kind.RECORD_SITES)
        order = np.argsort(sites["slot"])
        self._found, self._sites = [], {name: take_rows(column, order) for name, column in sites.items()}

    def _check_slots(self, batch: Batch, count: int) -> None:
        slot = batch.arrays["slot"]
        if len(slot) and not (slot.min() >= 0 and slot.max() < count):
            raise ProtocolError(f"a {batch.kind.value} batch has slots outside 0 to {count - 1}")

    def _go_on(self) -> Iterator[Batch]:
        """Start the rays of the next sites, or further ones that those that are back call for; or make records."""
        strata = self._strata[0] * self._strata[1]
        if self._wave is None:
            stop = self._next_site + max(1, self._most_rays // strata)
            self._site = take(self._sites, slice(self._next_site, stop))
            self._site["pixel"] = self._pixels[self._site["slot"]]
            self._next_site = stop
            yield from self._shoot(first_rays(len(self._site["slot"]), *self._strata))
            return
        radiance, distance = self._wave.radiance(), self._wave.distance
        self._wave = None
        if self._first is None:
            extra = self._extra(radiance, distance)
            self._first = radiance, distance, extra
            further = further_rays(self._replica.launcher, extra, *self._strata)
            self._further.extend(further.cut(self._most_rays))
        else:
            self._light.append(radiance)
        if self._further:
            yield from self._shoot(self._further.popleft())
            return
        radiance, distance, extra = self._first
        if self._light:
            light = self._light[0] if len(self._light) == 1 else np.concatenate(self._light)
            radiance = means(self._replica.launcher, radiance, extra, light)
        self._first, self._light = None, []
        self._made.append(self._records(radiance, distance, extra))

    def _extra(self, radiance: Values, distance: NDArray[np.float32]) -> ExtraRays:
        """Rays that each stratum gets more.

        Args:
            radiance, distance: of the first ray of each.
        """
        plan, strata = self._view.cache, math.prod(self._strata)
        if not plan.extra:
            return no_extra_rays(len(self._site["slot"]), strata)
        most, tolerance = round(plan.extra * strata), plan.tolerance_in(self.task.round)
        unoccluded = self._unoccluded().reshape(-1)
        return extra_rays(self._replica.launcher, self._strata, radiance, unoccluded, distance, tolerance, most)

    def _unoccluded(self) -> NDArray[np.float32]:
        """Radiance through each stratum if nothing stood before lit places, shape [sites, strata] [W/(m² sr)]."""
        rows, columns = self._strata
        launcher, count = self._replica.launcher, len(self._site["slot"])
        unoccluded = wp.zeros((count, rows * columns), dtype=wp.float32, device=launcher.device)
        sites = {
            name: wp.array(self._site[name], dtype=wp.vec3, device=launcher.device)
            for name in ("position", "normal", "shading_normal")
        }
        launcher(
            unoccluded_radiance,
            count,
            grain=GRAIN,
            places=upload(**vars(self._view.lit_places), device=launcher.device),
            **sites,
            rows=rows,
            columns=columns,
            radiance_out=unoccluded,
        )
        return unoccluded.numpy()

    def _shoot(self, rays: GatherRays) -> Iterator[Batch]:
        """Start a wave of rays; what is followed to its end at once is back already."""
        self._rays += len(rays)
        self._wave = RecordWave(self._replica, self._view, self._site, self._numbers(), self._strata, rays)
        if self._scene is not None and self._wave.trace_whole(self._scene):
            return
        [(most, _)] = self._where.most_common(1)
        going = list(self._wave.start(self.task.number, self._number, self._held.get(most)))
        self._credit = sum(batch.credit for batch in going)
        yield from going

    def _numbers(self) -> NDArray[np.int64]:
        """Of the records that are made here."""
        number = self._candidates[self._site["slot"]].astype(np.int64)
        return (np.int64(self.task.round) << np.int64(ROUND_BITS)) + number

    def result(self) -> RecordsMade | None:
        """The records once nothing is in flight."""
        if self._credit > 0 or self._searching:
            return None
        return RecordsMade(self.task.number, self.task.round, joined([NO_RECORDS, *self._made]), self._rays)

    def _records(self, radiance: Values, distance: NDArray[np.float32], extra: ExtraRays) -> Records:
        """What the gather rays tell, once all are back.

        Args:
            radiance, distance, extra: of each stratum: the mean of its rays, how far the first went, and how many
                more there were.
        """
        count, device, plan = len(self._site["slot"]), self._replica.launcher.device, self._view.cache
        footprint = self._site["footprint"]
        bounds = Bounds()
        bounds.reach, bounds.clearance = plan.error, plan.clearance
        bounds.least = wp.array(np.float32(plan.least) * footprint, dtype=wp.float32, device=device)
        bounds.most = wp.array(np.float32(plan.most) * footprint, dtype=wp.float32, device=device)
        made = columns.empty(MadeRecords, count, device)
        self._replica.launcher(
            make_records,
            count,
            grain=GRAIN,
            strata=make_strata(*self._strata, device),
            radiance=columns.array_over(radiance.astype(np.float32), wp.vec3, device),
            distance=columns.array_over(distance, wp.float32, device),
            shading_normal=wp.array(self._site["shading_normal"], dtype=wp.vec3, device=device),
            bounds=bounds,
            made_out=made,
        )
        of_kernel = columns.download(made, ("irradiance", "rotation", "translation", "grazing", "radius"))
        error = standard_errors(self._replica.launcher, self._strata, radiance, extra.counts)
        return Records(self._numbers(), self._site["position"], self._site["shading_normal"], **of_kernel, error=error)

    def _batch(self, kind: Kind, cell: int, credit: int, arrays: Arrays) -> Batch:
        return Batch.of_task(kind, self.task.number, self._number, cell, credit, arrays)
