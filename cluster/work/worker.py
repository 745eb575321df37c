"""What a slave computes: its cells, and the homes of the tasks that it was handed. No input or output of its own.

Batches between its own cells and homes never leave it. All others are put in the outbox, for whoever moves them.
"""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import OF_MAPS, TO_HOME, Batch, Kind, by_home, pieces, take, zeros
from wdpm.cluster.host_cache import HostCache
from wdpm.cluster.host_memory import peak_memory
from wdpm.cluster.outbox import Outbox
from wdpm.cluster.queues import Queues, without_bare_credit
from wdpm.cluster.records import Records, take_near
from wdpm.cluster.runs import TASK
from wdpm.cluster.task import BucketTask, PhotonTask, RecordTask, Task
from wdpm.cluster.work import tally
from wdpm.cluster.work.bucket_home import BucketHome
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.work.final_gather import FinalGatherCounters
from wdpm.cluster.work.guards import Guards, added
from wdpm.cluster.work.photon_home import PhotonHome
from wdpm.cluster.work.records.record_home import RecordHome
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import NO_REGIONS, PhotonPlan, View, World
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import GLOBAL_MAP
from wdpm.kernels.rays.cells import cell_boxes
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.arrays import Triangles

Home = PhotonHome | RecordHome | BucketHome

RAYS = frozenset(set(Kind) - TO_HOME - OF_MAPS)

READS_RECORDS = frozenset({Kind.SHADE, Kind.CANDIDATE_HIT})
"""What asks the irradiance cache, before anything else in a task that has a use for it does."""

PIECE_ROWS = 1 << 15
"""Rays that a home starts in a cell of its own worker, at a time: far more than are worth a launch."""

TRACED_AT_ONCE = 1 << 15
"""Photon paths that a worker traces at once where it does without those that others lend."""


class CellWorker:
    """Cells and homes of one slave.

    Args:
        number: the slave's number.
        partition: the triangles of each of its cells.
        holders: number of the worker that holds each cell.
        host_cache: what workers on this machine make once for all of them; None where each makes its own. Where the
            scene is divided, no two hold the same but textures, and each makes all others.
    """

    def __init__(
        self,
        number: int,
        world: World,
        partition: Mapping[int, Triangles],
        holders: Sequence[int],
        launcher: Launcher,
        host_cache: HostCache | None = None,
    ) -> None:
        self.number = number
        self.holders = tuple(holders)
        of_all = HostCache() if host_cache is None else host_cache
        of_holders = of_all if len(self.holders) == 1 else HostCache()
        self.replica = Replica(world, launcher, number, of_holders, _not_held(self._trace_all), of_all)
        self.cells = {cell: Cell(cell, triangles, self.replica) for cell, triangles in sorted(partition.items())}
        self._guards = Guards(self.replica)  # of its homes
        self._homes: dict[int, Home] = {}
        self._awaits_records = False
        self._put_aside: list[Batch] = []  # until records are here
        self._traffic = dict.fromkeys(
            ("rays_in", "rays_out", "rays_put_off", "bytes_in", "bytes_out", "bytes_put_off"), 0
        )
        self._busy = 0.0
        self._photon_traffic = dict(self._traffic)  # what they were when the maps were built
        self._photon_busy = 0.0
        self._shares_bytes = 0

    def set_view(self, view: View) -> None:
        """Look through a camera; before buckets are started. What is counted for each view begins anew."""
        self._awaits_records = False
        self._put_aside.clear()
        self.replica.set_view(view)
        self._traffic, self._busy = dict(self._photon_traffic), self._photon_busy
        self._guards.counts.clear()
        for cell in self.cells.values():
            cell.begin_view()

    def adopt(self, world: World) -> None:
        """Go on with the same scene: under another photon plan, other materials or features, without photons."""
        self.forget_photons()
        before = self.replica.world
        others = world.materials is not before.materials
        self.replica.world = world
        if world.features != before.features:
            self.replica.update_features()
        if world.emission is not before.emission:
            self.replica.update_emission()
        if others:
            self.replica.update_materials()
            for cell in self.cells.values():
                cell.update_materials()

    def regroup(self, world: World, partition: Mapping[int, Triangles], holders: Sequence[int]) -> None:
        """Hold other cells of the same scene: those that stay are kept, the photons are not, and no task is known.

        Args:
            partition: the triangles of each cell that is new here.
        """
        self.holders = tuple(holders)
        kept = {cell: held for cell, held in self.cells.items() if self.holders[cell] == self.number}
        new = {cell: Cell(cell, triangles, self.replica) for cell, triangles in partition.items()}
        self.cells = dict(sorted((kept | new).items()))
        self._homes.clear()
        self._awaits_records = False
        self._put_aside.clear()
        self.adopt(world)

    def start(self, task: Task, samples: Sequence[range] = ()) -> Outbox:
        """Become a task's home.

        Args:
            samples: of a bucket, as BucketHome has them.
        """
        began = time.perf_counter()
        home: Home
        if isinstance(task, PhotonTask):
            home = PhotonHome(task, self.number, self.replica)
        elif isinstance(task, BucketTask) and self.replica.view is not None:
            scene = None if self._awaits_records else self._whole()
            home = BucketHome(task, self.number, self.replica, self.replica.view, self._guards, samples, scene)
        elif isinstance(task, RecordTask) and self.replica.view is not None:
            home = RecordHome(task, self.number, self.replica, self.replica.view, self.cells, self._whole())
        else:
            raise ProtocolError(f"task {task.number} came before a view was set")
        self._homes[task.number] = home
        outbox = Outbox()
        self._start(home.begin(), outbox)
        self._finish(task.number, outbox)
        self._busy += time.perf_counter() - began
        return outbox

    def _whole(self) -> Cell | None:
        """The only cell, where it can follow samples from the camera to their ends at once."""
        held = list(self.cells.values()) if self.holds_all else []
        return next((cell for cell in held if cell.traces_whole), None)

    def handle(self, batches: Sequence[Batch]) -> Outbox:
        """Take in batches that other workers sent."""
        began = time.perf_counter()
        for batch in batches:
            self._traffic["bytes_in"] += batch.nbytes
            if batch.kind in RAYS:
                self._traffic["rays_in"] += len(batch)
        outbox = Outbox()
        self._run(batches, outbox)
        self._busy += time.perf_counter() - began
        return outbox

    def await_records(self) -> None:
        """Put aside what reads irradiance records until others are set; for who has the whole scene."""
        self._awaits_records = True

    def go_on(self) -> Outbox:
        """Work off what was put aside until records were set."""
        began = time.perf_counter()
        outbox, self._awaits_records = Outbox(), False
        put_aside, self._put_aside = self._put_aside, []
        self._run(put_aside, outbox)
        self._busy += time.perf_counter() - began
        return outbox

    def set_records(self, records: Records) -> None:
        """Have these irradiance records, as far as they reach a cell of this worker, in place of those before."""
        began = time.perf_counter()
        tree, pad = self.replica.world.top_tree, self.replica.pad
        low, high = cell_boxes(tree.axis, tree.split)
        self.replica.set_records(take_near(records, [(low[cell] - pad, high[cell] + pad) for cell in self.cells]))
        self._busy += time.perf_counter() - began

    def copies(self, cells: Sequence[int], part: int = 0, regions: NDArray[np.float32] = NO_REGIONS) -> list[Batch]:
        """The photons that landed in these own cells, for workers of other teams that have them; one batch each.

        Args:
            regions: of the only cell, where each works out irradiance at photons: others need no photon of the global
                map that is not within reach of theirs, and this one need keep none. None if all need all.
            part: which of them is this worker's; `cells` are of the others, in their order.
        """
        stores = {cell: self.cells[cell].store for cell in set(cells)}
        if len(regions):
            [store] = (cell.store for cell in self.cells.values())
            boxes = [store.region(corners) for corners in regions]
            own, landed = boxes.pop(part), store.so_far()
            store.work_in(own)
            columns = [box.photons(landed, GLOBAL_MAP) for box in boxes]
        else:
            # In memory that all of them share nothing need be sent.
            landed_in = {
                cell: zeros(Kind.COPIED_PHOTONS) if store.lend() else store.so_far() for cell, store in stores.items()
            }
            columns = [landed_in[cell] for cell in cells]
        batches = [
            Batch.of_task(Kind.COPIED_PHOTONS, -1, self.number, cell, 0, arrays)
            for cell, arrays in zip(cells, columns, strict=True)
        ]
        self._traffic["bytes_out"] += sum(batch.nbytes for batch in batches)
        return batches

    def begin_points(self) -> None:
        """Begin with what maps need besides photons, which are to be traced now; for who has the whole scene."""
        for cell in self.cells.values():
            cell.store.begin_points()

    def _trace_all(self) -> None:
        """Trace all photon paths here, though others have traced theirs, and count nothing of it."""
        (store,) = (cell.store for cell in self.cells.values())
        counters = self._counters()
        values = tally.read(counters)
        tally.clear(counters)
        for start in range(0, self.replica.world.paths, TRACED_AT_ONCE):
            self.start(PhotonTask(-1, start, min(start + TRACED_AT_ONCE, self.replica.world.paths)))
        every = store.count.copy()
        tally.clear(counters)
        tally.add(counters, values)
        store.copy_count = every - store.count

    def exchange_ghosts(self) -> list[Batch]:
        """Ghosts and surface points of each own cell for every cell of another worker; between own cells at once."""
        began = time.perf_counter()
        outbox = Outbox()
        for cell in self.cells.values():
            self._start(cell.store.ghosts(), outbox)
        self._busy += time.perf_counter() - began
        return outbox.batches

    def ghosts_expected(self) -> int:
        """Batches of ghosts and of surface points that other workers send to this one."""
        return 2 * len(self.cells) * (len(self.holders) - len(self.cells))

    def sort_trees(self, part: int, parts: int, cells: Sequence[int]) -> list[Batch]:
        """Sort a part of the trees that maps are built as, if several who hold the same are to share that.

        Args:
            part, parts: which, from 0, and of how many.
            cells: of which others want that part.

        Returns:
            one batch for each of `cells`; none if each is to build its trees alone.
        """
        if len(self.holders) > 1:
            return []  # ghosts come in any order, and each holder of a cell numbers them in its own
        began = time.perf_counter()
        orders = {cell: held.store.sort(part, parts) for cell, held in self.cells.items()}
        batches = [
            Batch.of_task(Kind.COPIED_ORDER, -1, self.number, cell, 0, order)
            for cell in cells
            if (order := orders[cell]) is not None
        ]
        self._traffic["bytes_out"] += sum(batch.nbytes for batch in batches)
        self._busy += time.perf_counter() - began
        return batches

    def build_maps(self, part: int = 0, parts: int = 1, cells: Sequence[int] = ()) -> list[Batch]:
        """Build the photon maps of all cells, and a part of the irradiance at photons.

        Args:
            part, parts: which, from 0, and of how many.
            cells: of which others want that part: one batch for each.
        """
        began = time.perf_counter()
        for cell in self.cells.values():
            cell.store.build(part, parts)
        batches = [
            Batch.of_task(Kind.COPIED_IRRADIANCE, -1, self.number, cell, 0, self.cells[cell].store.irradiance_part())
            for cell in cells
        ]
        self._traffic["bytes_out"] += sum(batch.nbytes for batch in batches)
        self._busy += time.perf_counter() - began
        return batches

    def finish_maps(self) -> None:
        """All parts of the irradiance at photons are here."""
        began = time.perf_counter()
        for cell in self.cells.values():
            cell.store.finish()
        self._busy += time.perf_counter() - began
        self._photon_traffic, self._photon_busy = dict(self._traffic), self._busy

    def forget_photons(self, plan: PhotonPlan | None = None) -> None:
        """Let go of all photons, before they are traced again: by this plan, or by the same if None."""
        for cell in self.cells.values():
            cell.forget_photons()
        self.replica.paths_by_light[:] = 0
        self._traffic = dict.fromkeys(self._traffic, 0)
        self._busy = 0.0
        if plan is not None:
            self.replica.world = self.replica.world.with_photons(plan)

    @property
    def _exchanges_rays(self) -> bool:
        """Whether others hold cells too, so that some of its rays travel and others' come."""
        return any(holder != self.number for holder in self.holders)

    @property
    def holds_all(self) -> bool:
        """Whether it has the whole scene, in one cell: its tasks need no other worker then."""
        return len(self.holders) == 1

    def become_share(self) -> None:
        """Be one of several processes that share this worker's tasks, from here on: count anew.

        What is computed is computed on one core, since the others are for the other processes.
        """
        self.replica.launcher.use_one_thread()
        self.take_share()

    def take_share(self) -> list[Any]:
        """What was counted since this was last asked, as plain data."""
        counters = self._counters()
        values = tally.read(counters)
        tally.clear(counters)
        return values

    def add_share(self, values: Sequence[Any], private_bytes: int) -> None:
        """Take in what a share of this worker counted.

        Args:
            private_bytes: what all shares together have in memory for themselves.
        """
        tally.add(self._counters(), values)
        self._shares_bytes = max(self._shares_bytes, private_bytes)

    def _counters(self) -> list[tally.Counter]:
        """All that tasks count."""
        of_cells = [counter for cell in self.cells.values() for counter in cell.all_counters()]
        return [tally.Number(self, "_busy"), self.replica.paths_by_light, self._guards.counts, *of_cells]

    def photon_counts(self) -> dict[str, Any]:
        """What was counted of the photons that were traced and stored here, by name (cluster.master.statistics)."""
        cells = self.cells.values()
        stores = [cell.store for cell in cells]
        return {
            "paths_by_light": self.replica.paths_by_light.tolist(),
            "stored_by_light": np.sum([store.counters.by_light for store in stores], axis=0).tolist(),
            "flux_by_light": np.sum([store.counters.flux_by_light for store in stores], axis=0).tolist(),
            "energy": np.sum([cell.energy for cell in cells], axis=0).tolist(),
            "guards": added(store.guards.counts for store in stores),
        }

    def statistics(self) -> dict[str, Any]:
        """What this worker holds and has done; `photon_counts` has what was counted of photons."""
        cells = self.cells.values()
        return {
            "cells": list(self.cells),
            "triangles": sum(cell.triangle_count for cell in cells),
            "photons": np.sum([cell.store.count for cell in cells], axis=0).tolist(),
            "copies": np.sum([cell.store.copy_count for cell in cells], axis=0).tolist(),
            "ghosts": np.sum([cell.store.ghost_count for cell in cells], axis=0).tolist(),
            "gathers": sum(cell.gathers.gathers for cell in cells),
            "gathers_truncated": sum(cell.gathers.truncated for cell in cells),
            "gathers_left_band": sum(cell.gathers.left_band for cell in cells),
            "gathers_s": sum(cell.gathers.seconds for cell in cells),
            **{
                f"final_gather_{field.name}": sum(getattr(cell.final_gather, field.name) for cell in cells)
                for field in fields(FinalGatherCounters)
            },
            "irradiance_points": sum(cell.store.irradiance_count for cell in cells),
            "irradiance_s": sum(cell.store.irradiance_s for cell in cells),
            "records": len(self.replica.records),
            "vertices": sum(cell.vertices for cell in cells),
            "beams": sum(cell.beams for cell in cells),
            "guards": added([*(cell.guards for cell in cells), self._guards.counts]),
            "busy_s": self._busy,
            "made_alone": self.replica.host_cache.unshared,
            "peak_memory_bytes": peak_memory() + self._shares_bytes,
            **self._travelled(),
        }

    def _run(self, batches: Iterable[Batch], outbox: Outbox) -> None:
        """Work off batches, and what follows from them, until only work for other workers is left.

        Rays for one cell are collected until nothing else is to be done, and the fullest cell goes first: few large
        launches in place of many small ones. The order changes no bit.
        """
        waiting = Queues()
        leaving = Queues()
        waiting.extend(batches)
        while waiting:
            batch = waiting.pop()
            if self._awaits_records and batch.kind in READS_RECORDS:
                self._put_aside.append(batch)
                continue
            comes_home = batch.kind in TO_HOME
            follows = self._receive(batch, outbox) if comes_home else self._cell_of(batch).advance(batch)
            for following in by_home(follows):
                if self._destination(following) != self.number:
                    leaving.add(following)
                elif comes_home and self._puts_off(following):
                    self._put_off(following, outbox)
                else:
                    waiting.add(following)
        for batch in without_bare_credit([leaving.pop() for _ in range(len(leaving))]):
            self._send(batch, outbox)

    def _start(self, batches: Iterable[Batch], outbox: Outbox) -> None:
        """Send new batches on their way, and work off those that stay here."""
        own = []
        for batch in by_home(batches):
            if self._destination(batch) != self.number:
                self._send(batch, outbox)
            elif self._puts_off(batch):
                self._put_off(batch, outbox)
            else:
                own.append(batch)
        self._run(own, outbox)

    def _puts_off(self, batch: Batch) -> bool:
        """Whether what a home starts for an own cell waits until what it starts for others is on its way."""
        return self._exchanges_rays and batch.kind in RAYS

    def _put_off(self, batch: Batch, outbox: Outbox) -> None:
        """Have rays come in again as if another worker had sent them, in pieces: between these those of others do.

        A home starts all rays of a wave at once. What others wait for would wait for all of them.
        """
        for piece in pieces(batch, PIECE_ROWS):
            self._traffic["bytes_put_off"] += piece.nbytes
            self._traffic["rays_put_off"] += len(piece)
            outbox.batches.append(piece)

    def _travelled(self) -> dict[str, int]:
        """Rays and bytes that came from others and went to them.

        What was put off comes in like what others sent, but for rays of a task that another worker was faster with,
        which may wait still when the image is done: so it is not known to the last ray what came of others then.
        """
        counts = dict(self._traffic)
        for what in ("rays", "bytes"):
            counts[f"{what}_in"] = max(counts[f"{what}_in"] - counts.pop(f"{what}_put_off"), 0)
        return counts

    def _receive(self, batch: Batch, outbox: Outbox) -> Iterator[Batch]:
        """Take in what came home, task by task."""
        for task, runs, rows in batch.runs.slices(TASK):
            home = self._homes.get(task)
            if home is None:
                raise ProtocolError(f"a {batch.kind.value} batch came home to task {task}, which is unknown here")
            if runs.rows.any():
                part = Batch(batch.kind, batch.cell, runs, take(batch.arrays, rows))
            else:  # credit that travels with what others are brought
                part = Batch(Kind.ENDED, batch.cell, runs, {})
            yield from home.receive(part)
            self._finish(task, outbox)

    def _cell_of(self, batch: Batch) -> Cell:
        if batch.cell not in self.cells:
            raise ProtocolError(f"a {batch.kind.value} batch came for cell {batch.cell}, which is not held here")
        return self.cells[batch.cell]

    def _finish(self, task: int, outbox: Outbox) -> None:
        home = self._homes.get(task)
        result = None if home is None else home.result()
        if result is not None:
            del self._homes[task]
            outbox.results.append(result)

    def _destination(self, batch: Batch) -> int:
        return batch.home if batch.kind in TO_HOME else self.holders[batch.cell]

    def _send(self, batch: Batch, outbox: Outbox) -> None:
        self._traffic["bytes_out"] += batch.nbytes
        if batch.kind in RAYS:
            self._traffic["rays_out"] += len(batch)
        outbox.batches.append(batch)


def _not_held(method: Callable[[], None]) -> Callable[[], None]:
    """A method of an object that this does not keep: files and memory of a scene go with the last who needs them."""
    weak = weakref.WeakMethod(method)

    def call() -> None:
        alive = weak()
        if alive is not None:
            alive()

    return call
