"""Where a photon task begins, and where its credit comes home; see bucket_home.py."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

from wdpm.cluster.batch import SCHEMAS, Batch, Kind, by_destination, take
from wdpm.cluster.task import PhotonsTraced, PhotonTask
from wdpm.cluster.work.replica import Replica
from wdpm.kernels import columns
from wdpm.kernels.photons.emit_photons import EmitOrders, first_cells
from wdpm.kernels.photons.flight import Flight
from wdpm.scenes.errors import ProtocolError


def emitted_photons(replica: Replica, start: int, stop: int) -> Any:
    """The photon paths start to stop - 1 as they leave the lights: kernels.photons.flight.Flight."""
    world, count = replica.world, stop - start
    flight = columns.empty(Flight, count, replica.launcher.device)
    orders = EmitOrders()
    orders.first, orders.global_paths, orders.seed = start, world.global_map.paths, wp.uint32(world.seed)
    kernel = replica.kernels.emit_photons
    replica.launcher(kernel, count, scene=replica.emit_scene, orders=orders, flight_out=flight)
    return flight


class PhotonHome:
    """A range of photon paths."""

    def __init__(self, task: PhotonTask, number: int, replica: Replica) -> None:
        self.task = task
        self._number = number
        self._replica = replica
        self._credit = task.stop - task.start
        self._emitted = 0.0

    def begin(self) -> Iterator[Batch]:
        """The photons as they leave the lights, by the first cell on their way."""
        replica, world = self._replica, self._replica.world
        flight = emitted_photons(replica, self.task.start, self.task.stop)
        count = self.task.stop - self.task.start
        first = wp.empty(count, dtype=wp.int32, device=replica.launcher.device)
        replica.launcher(first_cells, count, cells=replica.cells, flight=flight, next_cell_out=first)
        arrays = columns.download(flight, SCHEMAS[Kind.PHOTON])
        aimed = max(0, min(world.global_map.paths - self.task.start, count))  # where those begin that are
        self._emitted = float(arrays["flux"][:aimed].sum(dtype=np.float64)) / 3.0
        for row, chosen in enumerate((slice(0, aimed), slice(aimed, count))):
            lights = replica.paths_by_light[row]
            lights += np.bincount(arrays["light"][chosen], minlength=len(lights))
        destination = first.numpy()
        self._credit = int(np.count_nonzero(destination >= 0))
        for cell, rows in by_destination(destination, destination >= 0):
            yield Batch.of_task(Kind.PHOTON, self.task.number, self._number, cell, len(rows), take(arrays, rows))

    def receive(self, batch: Batch) -> Iterator[Batch]:
        """Take back credit; photons bring nothing else home."""
        if batch.kind is not Kind.ENDED:
            raise ProtocolError(f"a {batch.kind.value} batch came home to photon task {self.task.number}")
        self._credit -= batch.credit
        return iter(())

    def result(self) -> PhotonsTraced | None:
        """The task's result once nothing is in flight."""
        if self._credit > 0:
            return None
        return PhotonsTraced(self.task.number, self.task.stop - self.task.start, self._emitted)
