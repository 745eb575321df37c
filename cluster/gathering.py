"""Gathers of camera samples in one cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.photon_store import BuiltMap, PhotonStore
from wdpm.cluster.replica import Replica
from wdpm.cluster.world import MapPlan
from wdpm.kernels import cells
from wdpm.kernels.gather import gather_kernel
from wdpm.kernels.photon_paths import CAUSTIC_MAP
from wdpm.kernels.surface_points import reflect_gathered

GATHER_RUN = 32
"""Gathers that one Warp thread makes one after another: enough to profit from its last radius, and to share out."""

GATHER_GRAIN = 32
"""Runs of gathers that are worth a launch of their own."""


@dataclass
class GatherCounters:
    """What gathers did, for the report."""

    gathers: int = 0
    truncated: int = 0
    left_band: int = 0


class Gathering:
    """Asks the photons of one cell.

    Args:
        cell: number of the cell.
    """

    def __init__(self, cell: int, store: PhotonStore, replica: Replica) -> None:
        self._cell = cell
        self._store = store
        self._replica = replica
        self.counters = GatherCounters()

    def begin_view(self) -> None:
        """Count anew."""
        self.counters = GatherCounters()

    def reflected(self, number: int, queries: Any, coats: Any) -> NDArray[np.float32]:
        """Radiance reflected of the photons of a map about each query, float32, shape [queries, 3].

        Args:
            number: of the map.
            queries, coats: kernels.shading.Queries and Coats.
        """
        replica, device = self._replica, self._replica.launcher.device
        count = len(queries.weight)
        plan, built = replica.world.maps[number], self._store.maps[number]
        if built is None or replica.view is None:
            return np.zeros((count, 3), np.float32)
        radiance = wp.empty(count, dtype=wp.vec3, device=device)
        irradiance = wp.empty(count, dtype=wp.vec3, device=device)
        used = wp.empty(count, dtype=wp.int32, device=device)
        radius = wp.empty(count, dtype=wp.float32, device=device)
        truncated = wp.empty(count, dtype=wp.bool, device=device)
        k = replica.view.caustic_k if number == CAUSTIC_MAP else replica.view.k
        self._gather(built, plan, queries, coats, k, [GATHER_RUN, irradiance, used, radius, truncated])
        places = [self._store.points, queries.position, queries.front_normal, queries.clearance]
        surface_maps = (replica.world.global_map, replica.world.caustic_map)
        reach = max(surface.radius for surface in surface_maps if surface.paths)  # surface points reach as far
        found = [queries.weight, irradiance, radius, replica.world.point_area, reach, 1.0 / plan.paths]
        replica.launcher(reflect_gathered, count, [*places, *found], [radiance])
        self._count(plan, queries, radius.numpy(), truncated.numpy())
        return np.asarray(radiance.numpy())

    def _gather(self, built: BuiltMap, plan: MapPlan, queries: Any, coats: Any, k: int, outputs: list[Any]) -> None:
        replica, view = self._replica, self._replica.view
        features, kernel = replica.world.features, replica.kernels.gather_glossy
        runs = -(-len(queries.weight) // GATHER_RUN)
        depth = 0 if view is None else view.max_depth or 0
        if kernel is not None and (features.coated or depth):
            inputs = [built.tree, built.edges, queries, coats, k, plan.radius, depth]
            replica.launcher(kernel, runs, inputs, outputs, grain=GATHER_GRAIN)
        else:
            places = [queries.position, queries.normal, queries.shading_normal]
            inputs = [built.tree, *places, k, plan.radius]
            replica.launcher(gather_kernel, runs, inputs, outputs, grain=GATHER_GRAIN)

    def _count(self, plan: MapPlan, queries: Any, radius: NDArray[np.float32], truncated: NDArray[np.bool_]) -> None:
        wanted = queries.weight.numpy().max(axis=1) > 0
        self.counters.gathers += int(np.count_nonzero(wanted))
        self.counters.truncated += int(np.count_nonzero(truncated & wanted))
        if plan.band < plan.radius:
            tree = self._replica.world.top_tree
            low, high = cells.cell_boxes(tree.axis, tree.split)
            position = queries.position.numpy()
            margin = np.minimum(position - low[self._cell], high[self._cell] - position).min(axis=1)
            self.counters.left_band += int(np.count_nonzero((radius > margin + plan.band) & wanted))
