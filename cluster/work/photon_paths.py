"""Photon paths in one cell: followed until they end or leave it, and what they store on the way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Batch, Kind, by_destination, take
from wdpm.cluster.work.guards import PHOTONS_CUT
from wdpm.cluster.work.photon_store import PhotonStore
from wdpm.cluster.work.replica import Replica
from wdpm.kernels import columns
from wdpm.kernels.photons import flight as pf
from wdpm.kernels.photons.paths import Fates, TraceOrders, TraceScene
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.triangle import NO_HIT
from wdpm.kernels.rays.two_level import Trees

DEPOSITS_A_PATH = 6
"""Room for photons, a path, in one launch. What finds none waits for the next launch."""

LEAST_DEPOSITS = 1 << 14
"""Room for photons of each chunk of a launch, at least: a few paths that scatter ten thousand times each would wait
thousands of times. A megabyte."""


class PhotonPaths:
    """Traces photons through one cell.

    Args:
        cell: number of the cell.
        trees, surfaces: its triangles on the device.
        store: keeps the photons that land.

    Attributes:
        energy: power of photons that were absorbed, escaped, or were cut off here [W x paths], float64, shape [3].
    """

    def __init__(self, cell: int, trees: Trees, surfaces: Surfaces, store: PhotonStore, replica: Replica) -> None:
        self._cell = cell
        self._trees = trees
        self._surfaces = surfaces
        self._store = store
        self._replica = replica
        self.energy = np.zeros(3)
        self.update_materials()

    def update_materials(self) -> None:
        """Trace photons among the replica's materials, which have changed."""
        scene, replica = TraceScene(), self._replica
        scene.trees, scene.surfaces, scene.cells = self._trees, self._surfaces, replica.cells
        scene.materials, scene.textures, scene.media = replica.materials, replica.textures, replica.media
        self._scene = scene

    def trace(self, batch: Batch) -> Iterator[Batch]:
        """Follow photons until each has left the cell or ended. Each carries a credit of one.

        What a run has beyond that is of photons of its task that ended elsewhere.
        """
        arrays, landed, runs = batch.arrays, batch.kind is Kind.LANDED, batch.runs
        ended = np.maximum(runs.credit - runs.rows, 0)
        while True:
            traced, status, destination = self._launch(arrays, landed)
            ended += runs.sums(status == pf.ENDED)
            self._count_cut(traced, status)
            for kind, code in ((Kind.PHOTON, pf.TRAVELS), (Kind.LANDED, pf.LANDS)):
                for cell, rows in by_destination(destination, status == code):
                    yield Batch(kind, cell, runs.among(rows).with_unit(), take(traced, rows))
            waiting = np.flatnonzero(status == pf.WAITS)
            if not len(waiting):
                break
            arrays, landed, runs = take(traced, waiting), True, runs.among(waiting)
        if ended.any():
            yield Batch(Kind.ENDED, self._cell, runs.without_rows(ended), {})

    def _count_cut(self, traced: Arrays, status: NDArray[np.int32]) -> None:
        """Count the photons that ended at the limit of bounces, and not because they left the scene there."""
        at_limit = (status == pf.ENDED) & (traced["bounce"] >= pf.BOUNCE_LIMIT)
        if at_limit.any():
            left = (traced["prim"] < 0) & (traced["t"] >= np.float32(NO_HIT))
            cut = take(traced, np.flatnonzero(at_limit & ~left))
            self._store.guards.act_on_photons(PHOTONS_CUT, cut["path"], cut["bounce"], cut["light"])

    def _launch(self, arrays: Arrays, landed: bool) -> tuple[Arrays, NDArray[np.int32], NDArray[np.int32]]:
        """One launch of `trace_photons`; photons that land are stored.

        Args:
            arrays: photons in flight, as SCHEMAS[Kind.PHOTON].
            landed: whether their hits are final.

        Returns:
            the photons as they are after it, and of each its status and the cell that it goes to (kernels.photons.paths
            Fates), shape [photons].
        """
        replica, world = self._replica, self._replica.world
        launcher, device = replica.launcher, replica.launcher.device
        count = len(arrays["path"])
        chunks = launcher.chunks(count)
        capacity = max(LEAST_DEPOSITS, max(size for _, size in chunks) * DEPOSITS_A_PATH)
        flight = columns.upload(pf.Flight, arrays, device)
        deposits = self._store.room(capacity, len(chunks))
        fates = Fates()
        fates.status = wp.empty(count, dtype=wp.int32, device=device)
        fates.next_cell = wp.empty(count, dtype=wp.int32, device=device)
        fates.energy = wp.empty((count, 3), dtype=wp.float64, device=device)
        orders = TraceOrders()
        orders.landed = int(landed)
        orders.own_cell = self._cell
        orders.global_paths = world.global_map.paths
        orders.stores_direct = int(world.stores_direct)
        orders.seed = wp.uint32(world.seed)
        orders.max_depth = world.max_depth or 0
        launcher.run(
            replica.kernels.trace_photons,
            [
                (size, [self._scene, orders, flight, chunk, start, deposits, fates])
                for chunk, (start, size) in enumerate(chunks)
            ],
        )
        self.energy += [fate.sum() for fate in fates.energy.numpy().T]
        self._store.keep(deposits, capacity)
        return columns.download(flight, SCHEMAS[Kind.PHOTON]), fates.status.numpy(), fates.next_cell.numpy()
