"""Gathers of photons for camera samples in one cell. (Final gathering, by rays, is in final_gather.)"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays, take
from wdpm.cluster.rows import largest_of
from wdpm.cluster.work.guards import COINCIDENT, Guards
from wdpm.cluster.work.photon_store import BuiltMap, PhotonStore
from wdpm.cluster.work.reflected_light import GATHER_GRAIN, GATHER_RUN
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import MapPlan, World
from wdpm.kernels import columns
from wdpm.kernels.camera.vertices import Coats, Queries
from wdpm.kernels.constants import MIN_GATHER_RADIUS
from wdpm.kernels.photons.deposits import CAUSTIC_MAP
from wdpm.kernels.photons.gather import gather_kernel
from wdpm.kernels.photons.surface_points import least_radius, reflect_gathered
from wdpm.kernels.rays import cells

COINCIDENT_WITHIN = 2.0**-20
"""Share of the largest radius: where more than k photons lie as near as this to a gather that found no radius, they lie
in one place, and its radius is not that of a photon which happens to be just so far away."""

K_SHARE_OF_RAYS = 0.25
"""Photons that a gather looks for where a gather ray arrives, as a share of those where the camera looks: nobody sees
the noise of the few, as many rays are averaged over, and each costs less than half as much. The blur is less, too."""

LEAST_K_OF_RAYS = 8
"""Of these, at least, unless fewer are asked for everywhere."""


_GATHERED = {
    "irradiance": wp.vec3,
    "count": wp.int32,
    "radius": wp.float32,
    "truncated": wp.bool,
    "radiance": wp.vec3,
}
"""What gathers tell of each query, and what is reflected of it."""


def fewer_of_rays(k: int) -> int:
    """Photons that a gather looks for where a gather ray arrives, by those where the camera looks."""
    return min(k, max(LEAST_K_OF_RAYS, round(k * K_SHARE_OF_RAYS)))


def least_of(plan: MapPlan, world: World) -> float:
    """Least radius of gathers of a map at vertices: a caustic stays as sharp as its photons lie densely."""
    return 0.0 if plan is world.caustic_map else least_radius(plan.point_area, plan.radius)


@dataclass
class PhotonGatherCounters:
    """What gathers did, for the report; `seconds` is wall-clock time."""

    gathers: int = 0
    truncated: int = 0
    left_band: int = 0
    seconds: float = 0.0


class PhotonGathering:
    """Asks the photons of one cell.

    Args:
        cell: number of the cell.
        guards: of camera samples.
    """

    def __init__(self, cell: int, store: PhotonStore, replica: Replica, guards: Guards) -> None:
        self._cell = cell
        self._store = store
        self._replica = replica
        self._guards = guards
        self.counters = PhotonGatherCounters()

    def begin_view(self) -> None:
        """Count anew."""
        self.counters = PhotonGatherCounters()

    def reflected(
        self, number: int, queries: Any, coats: Any, rays: Arrays, among: NDArray[np.bool_] | None = None
    ) -> NDArray[np.float32]:
        """Radiance reflected of the photons of a map about each query, float32, shape [queries, 3].

        Args:
            number: of the map.
            queries, coats: kernels.camera.vertices.Queries and Coats.
            rays: what came to the places of the queries; where diffuse surfaces sent it on, fewer photons are enough.
            among: which of the queries ask; None for all that want photons.

        Where the camera looks, some samples ask the caustic map for others, too (View.caustic_turn).
        """
        replica, count = self._replica, columns.length(queries, "weight")
        radiance = np.zeros((count, 3), np.float32)
        if self._store.built(number) is None or replica.view is None:
            return radiance
        k = replica.view.caustic_k if number == CAUSTIC_MAP else replica.view.k
        wants = largest_of(columns.column(queries, "weight")) > 0  # glass and mirrors gather nothing
        if among is not None:
            wants &= among
        ends = rays["diffuse"] > 0 if "diffuse" in rays else np.zeros(count, np.bool_)
        run, asks = replica.view.caustic_turn if number == CAUSTIC_MAP else (1, 1)
        if asks < run:
            wants &= ends | (rays["sample"] % run < asks)
        for some, of_some in ((wants & ~ends, k), (wants & ends, fewer_of_rays(k))):
            rows = np.flatnonzero(some)
            if len(rows) == count:
                radiance = self._reflected(number, queries, coats, rays, of_some)
            elif len(rows):
                device = replica.launcher.device
                few = columns.chosen(Queries, queries, rows, device)
                few_coats = columns.chosen(Coats, coats, rows, device) if replica.outputs.coated else coats
                radiance[rows] = self._reflected(number, few, few_coats, take(rays, rows), of_some)
        if asks < run:
            radiance[~ends] *= np.float32(run / asks)
        return radiance

    def _reflected(self, number: int, queries: Any, coats: Any, rays: Arrays, k: int) -> NDArray[np.float32]:
        """As `reflected`, for every query that is given, by k photons each."""
        replica, device = self._replica, self._replica.launcher.device
        count = columns.length(queries, "weight")
        plan, built = replica.world.maps[number], self._store.built(number)
        if built is None or replica.view is None:
            raise AssertionError(f"map {number} is not there")
        made = columns.outputs(_GATHERED, count, device)
        began = time.perf_counter()
        outputs = ("irradiance", "count", "radius", "truncated")
        self._gather(built, plan, queries, coats, k, {f"{name}_out": made[name] for name in outputs})
        self.counters.seconds += time.perf_counter() - began
        replica.launcher(
            reflect_gathered,
            count,
            points=self._store.points[number],
            position=columns.argument(queries, "position"),
            front_normal=columns.argument(queries, "front_normal"),
            clearance=columns.argument(queries, "clearance"),
            albedo=columns.argument(queries, "weight"),
            irradiance=made["irradiance"],
            radius=made["radius"],
            point_area=plan.point_area,
            r_max=plan.radius,
            scale=1.0 / plan.paths,
            radiance_out=made["radiance"],
        )
        told = columns.to_host({name: made[name] for name in ("radius", "truncated", "radiance")})
        self._count(built, plan, queries, k, told["radius"], told["truncated"], rays)
        if replica.observer is not None:
            replica.observer.gathered(number, queries, made["count"], made["radius"], made["truncated"])
        return told["radiance"]

    def _gather(
        self, built: BuiltMap, plan: MapPlan, queries: Any, coats: Any, k: int, outputs: Mapping[str, Any]
    ) -> None:
        replica, view = self._replica, self._replica.view
        features, kernel = replica.world.features, replica.kernels.gather_glossy
        runs = -(-columns.length(queries, "weight") // GATHER_RUN)
        depth = 0 if view is None else view.max_depth or 0
        search = {"photons": built.tree, "k": k, "r_max": plan.radius, "run": GATHER_RUN, **outputs}
        search["r_least"] = least_of(plan, replica.world)
        if kernel is not None and (features.coated or depth):
            replica.launcher(
                kernel,
                runs,
                grain=GATHER_GRAIN,
                photon_edges=built.edges,
                queries=queries,
                coats=coats,
                max_depth=depth,
                **search,
            )
        else:
            replica.launcher(
                gather_kernel,
                runs,
                grain=GATHER_GRAIN,
                position=columns.argument(queries, "position"),
                normal=columns.argument(queries, "normal"),
                shading_normal=columns.argument(queries, "shading_normal"),
                **search,
            )

    def _in_one_place(
        self, built: BuiltMap, plan: MapPlan, queries: Any, k: int, rows: NDArray[np.intp]
    ) -> NDArray[np.bool_]:
        """Which of some queries have more than k photons next to themselves, shape [rows]."""
        launcher, count = self._replica.launcher, len(rows)
        names = ("position", "normal", "shading_normal")
        places = columns.rows_of({name: columns.argument(queries, name) for name in names}, rows, launcher.device)
        made = columns.outputs(_GATHERED, count, launcher.device)
        launcher(
            gather_kernel,
            count,
            photons=built.tree,
            **places,
            k=k,
            r_max=max(plan.radius * COINCIDENT_WITHIN, MIN_GATHER_RADIUS),
            r_least=0.0,
            run=1,
            irradiance_out=made["irradiance"],
            count_out=made["count"],
            radius_out=made["radius"],
            truncated_out=made["truncated"],
        )
        return ~np.asarray(made["truncated"].numpy(), np.bool_)

    def _count(
        self,
        built: BuiltMap,
        plan: MapPlan,
        queries: Any,
        k: int,
        radius: NDArray[np.float32],
        truncated: NDArray[np.bool_],
        rays: Arrays,
    ) -> None:
        wanted = largest_of(columns.column(queries, "weight")) > 0
        self.counters.gathers += int(np.count_nonzero(wanted))
        self.counters.truncated += int(np.count_nonzero(truncated & wanted))
        # A gather of more than k that yet reports the largest radius has no radius of its own (gather.nearest).
        doubtful = np.flatnonzero(~truncated & (radius == np.float32(plan.radius)) & wanted)
        if len(doubtful):
            self._guards.act(COINCIDENT, doubtful[self._in_one_place(built, plan, queries, k, doubtful)], rays)
        if plan.band < plan.radius:
            tree = self._replica.world.top_tree
            low, high = cells.cell_boxes(tree.axis, tree.split)
            position = columns.column(queries, "position")
            margin = np.minimum(position - low[self._cell], high[self._cell] - position).min(axis=1)
            self.counters.left_band += int(np.count_nonzero((radius > margin + plan.band) & wanted))
