"""Where the irradiance records of a task are made: candidates out, sites back, gather rays out, light back, records."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Batch, Kind, by_destination, concatenate, take
from wdpm.cluster.records import NO_RECORDS, RAY_SAMPLES, ROUND_BITS, Records, candidates, joined
from wdpm.cluster.rows import in_order, summed, take_rows
from wdpm.cluster.task import RecordsMade, RecordTask
from wdpm.cluster.work import parts
from wdpm.cluster.work.misses import no_hits
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.camera.rays import Rays, first_path_cells
from wdpm.kernels.irradiance.record_rays import Sites, start_record_rays
from wdpm.kernels.irradiance.records import Bounds, MadeRecords, make_records, make_strata, record_directions
from wdpm.scenes.errors import ProtocolError

_GRAIN = 8
"""Records that are worth a launch of their own."""

WAVE_RAYS = 1 << 18
"""Gather rays of a task that are under way at once, about: bounds memory, changes no bit."""


class RecordHome:
    """A range of a round's candidates."""

    def __init__(self, task: RecordTask, number: int, replica: Replica, view: View) -> None:
        self.task = task
        self._number = number
        self._replica = replica
        self._view = view
        every = candidates(view.camera.width, view.camera.height, view.cache, task.round)
        self._pixels = every[task.start : task.stop]
        self._strata = view.cache.strata(task.round)
        self._credit = 0
        self._found: list[Arrays] = []
        self._sites: Arrays = {}
        self._next_site = 0
        self._searching = True
        self._site: Arrays = {}
        self._made: list[Records] = []
        self._rays = 0
        self._lit: list[Arrays] = []
        self._distance = np.zeros(0, np.float32)

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
        first = wp.empty(count, dtype=wp.int32, device=replica.launcher.device)
        kernel, camera = replica.kernels.first_camera_cells, replica.camera
        replica.launcher(kernel, count, camera=camera, cells=replica.cells, rays=rays, next_cell_out=first)
        destination = first.numpy()
        self._credit = int(np.count_nonzero(destination >= 0))
        for cell, rows in by_destination(destination, destination >= 0):
            yield self._batch(Kind.CANDIDATE, cell, len(rows), take(arrays, rows))
        if not self._credit:
            self._end_search()

    def receive(self, batch: Batch) -> Iterator[Batch]:
        """Take in sites, then light; shoot once all sites are known."""
        if batch.kind is Kind.RECORD_SITES and self._searching:
            self._check_slots(batch, len(self._pixels))
            self._found.append(batch.arrays)
        elif batch.kind is Kind.LIT and not self._searching:
            self._check_slots(batch, len(self._distance))
            self._lit.append(self._without_reaches(batch.arrays))
        elif batch.kind is not Kind.ENDED:
            raise ProtocolError(f"a {batch.kind.value} batch came home to record task {self.task.number}")
        self._credit -= batch.credit
        if self._credit == 0:
            if self._searching:
                self._end_search()
            else:
                self._made.append(self._records())
            while not self._credit and self._next_site < len(self._sites["slot"]):
                yield from self._shoot()

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

    def _shoot(self) -> Iterator[Batch]:
        """Start the gather rays of the next wave of sites."""
        replica, view = self._replica, self._view
        rays = self._strata[0] * self._strata[1]
        stop = self._next_site + max(1, WAVE_RAYS // rays)
        self._site = take(self._sites, slice(self._next_site, stop))
        self._next_site = stop
        count, device = len(self._site["slot"]) * rays, replica.launcher.device
        self._rays += count
        direction = wp.empty(count, dtype=wp.vec3, device=device)
        distance = wp.empty(count, dtype=wp.float32, device=device)
        normal, shading_normal = (
            wp.array(self._site[name], dtype=wp.vec3, device=device) for name in ("normal", "shading_normal")
        )
        strata = make_strata(*self._strata, device)
        number = wp.array(self._numbers(), dtype=wp.int64, device=device)
        seed = wp.uint32(replica.world.seed)  # that of the pass
        replica.launcher(
            record_directions,
            count,
            strata=strata,
            number=number,
            normal=normal,
            shading_normal=shading_normal,
            seed=seed,
            direction_out=direction,
            distance_out=distance,
        )
        self._distance = distance.numpy()
        at = {"position": self._site["position"], "normal": self._site["normal"]}
        places = columns.upload(Sites, {**at, "pixel": self._pixels[self._site["slot"]]}, device)
        medium = -1 if view.camera.medium is None else view.camera.medium
        paths = columns.empty(Paths, count, device)
        replica.launcher(
            start_record_rays,
            count,
            sites=places,
            direction=direction,
            distance=distance,
            rays=rays,
            first_sample=RAY_SAMPLES,
            medium=medium,
            offset_min=replica.lights.offset_min,
            paths_out=paths,
        )
        first = wp.empty(count, dtype=wp.int32, device=device)
        replica.launcher(first_path_cells, count, cells=replica.cells, paths=paths, next_cell_out=first)
        arrays, destination = columns.download(paths, SCHEMAS[Kind.PATH]), first.numpy()
        going = [(cell, take(arrays, rows)) for cell, rows in by_destination(destination, destination >= 0)]
        credits = [parts.credit_of(sent["bounce"], view.light_samples) for _, sent in going]
        self._credit = sum(credits)
        for (cell, sent), credit in zip(going, credits, strict=True):
            yield self._batch(Kind.PATH, cell, credit, sent)
        if not self._credit:
            self._made.append(self._records())  # no ray of the wave carries anything

    def _numbers(self) -> NDArray[np.int64]:
        """Of the records that are made here."""
        number = self.task.start + self._site["slot"].astype(np.int64)
        return (np.int64(self.task.round) << np.int64(ROUND_BITS)) + number

    def _without_reaches(self, lit: Arrays) -> Arrays:
        """Light alone; how far rays went is noted."""
        reach = parts.part_of(lit["place"], self._view.light_samples) == parts.REACH
        rows = np.flatnonzero(reach)
        self._distance[lit["slot"][rows]] = lit["radiance"][rows, 0]
        return take(lit, np.flatnonzero(~reach))

    def result(self) -> RecordsMade | None:
        """The records once nothing is in flight."""
        if self._credit > 0 or self._searching:
            return None
        return RecordsMade(self.task.number, self.task.round, joined([NO_RECORDS, *self._made]), self._rays)

    def _records(self) -> Records:
        """What the gather rays tell, once all are back."""
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
            grain=_GRAIN,
            strata=make_strata(*self._strata, device),
            radiance=wp.array(self._radiance(), dtype=wp.vec3, device=device),
            distance=wp.array(self._distance, dtype=wp.float32, device=device),
            shading_normal=wp.array(self._site["shading_normal"], dtype=wp.vec3, device=device),
            bounds=bounds,
            made_out=made,
        )
        told = columns.download(made, ("irradiance", "rotation", "translation", "radius"))
        return Records(self._numbers(), self._site["position"], self._site["shading_normal"], **told)

    def _radiance(self) -> NDArray[np.float32]:
        """What came along each gather ray, added in the order of the parts' places, float32, shape [rays, 3]."""
        together = concatenate(self._lit, Kind.LIT)
        self._lit = []
        order = in_order(together["slot"], together["place"])
        slot, radiance = together["slot"][order], take_rows(together["radiance"], order)
        return summed(slot, radiance, len(self._distance)).astype(np.float32)

    def _batch(self, kind: Kind, cell: int, credit: int, arrays: Arrays) -> Batch:
        return Batch(kind, self.task.number, self._number, cell, credit, arrays)
