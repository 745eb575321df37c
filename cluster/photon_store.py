"""The photons of a cell: its own, copies of its neighbours' in its band, and the maps that are made of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Batch, Kind, concatenate, take
from wdpm.cluster.partition import rows_near
from wdpm.cluster.replica import Replica
from wdpm.cluster.world import MapPlan
from wdpm.kernels import cells, columns, photon_map
from wdpm.kernels import photon_paths as pp
from wdpm.kernels.limits import MAPS
from wdpm.kernels.surface import Surfaces
from wdpm.kernels.surface_points import spread
from wdpm.scenes.areas import triangle_areas

DEPOSITS_A_PATH = 6
"""Room for photons, a path, in one launch. What finds none waits for the next launch."""


@dataclass
class PhotonCounters:
    """What was stored, for the report.

    Attributes:
        by_light: photons that each light has in each map, shape [MAPS, lights].
        flux_by_light: their flux, mean of RGB [W x paths], shape [MAPS, lights].
    """

    by_light: NDArray[np.int64]
    flux_by_light: NDArray[np.float64]
    nonfinite: int = 0


@dataclass(eq=False)
class BuiltMap:
    """A map that gathers may read.

    Attributes:
        edges: of the photons' paths, in the order of their numbers.
    """

    tree: Any
    edges: Any


class PhotonStore:
    """Photons of one cell.

    Args:
        cell: number of the cell.
        surfaces: its triangles on the device.
    """

    def __init__(self, cell: int, surfaces: Surfaces, replica: Replica) -> None:
        self._cell = cell
        self._surfaces = surfaces
        self._replica = replica
        self._own: list[Arrays] = []
        self._ghosts: list[Arrays] = []
        self._deposits: Any = None
        self._own_points: Arrays = {}
        self._ghost_points: list[Arrays] = []
        self.maps: list[BuiltMap | None] = [None] * MAPS
        self.points: Any = None
        self.count = np.zeros(MAPS, np.int64)
        self.ghost_count = np.zeros(MAPS, np.int64)
        number = len(replica.world.lights.names)
        self.counters = PhotonCounters(np.zeros((MAPS, number), np.int64), np.zeros((MAPS, number)))

    def room(self, capacity: int, chunks: int) -> Any:
        """Room for photons, used again from launch to launch: fresh memory costs as much as the photons in it."""
        device = self._replica.launcher.device
        if self._deposits is None or len(self._deposits.id) < capacity * chunks:
            self._deposits = _empty_deposits(capacity * chunks, device)
        self._deposits.capacity = capacity
        self._deposits.count = wp.zeros(chunks, dtype=wp.int32, device=device)
        return self._deposits

    def keep(self, deposits: Any, capacity: int) -> None:
        """Take stored photons out of the regions of a launch."""
        names = SCHEMAS[Kind.GHOSTS]
        regions = columns.download(deposits, [*names, "light"])
        for chunk, asked in enumerate(deposits.count.numpy()):
            kept = min(int(asked), capacity)
            if kept:
                region = slice(chunk * capacity, chunk * capacity + kept)
                photons = {name: regions[name][region].copy() for name in names}
                light = regions["light"][region].copy()
                finite = np.isfinite(photons["flux"]).all(axis=1)
                if not finite.all():
                    self.counters.nonfinite += int(np.count_nonzero(~finite))
                    photons, light = take(photons, np.flatnonzero(finite)), light[finite]
                self._own.append(photons)
                self._count(photons, light)

    def _count(self, photons: Arrays, light: NDArray[np.int32]) -> None:
        number = self.counters.by_light.shape[1]
        key = photons["map"].astype(np.int64) * number + light
        counted = np.bincount(key, minlength=MAPS * number).reshape(MAPS, number)
        self.counters.by_light += counted
        self.count += counted.sum(axis=1)
        flux = photons["flux"].mean(axis=1, dtype=np.float64)
        self.counters.flux_by_light += np.bincount(key, flux, MAPS * number).reshape(MAPS, number)

    def so_far(self) -> Arrays:
        """The photons stored so far; only before the maps are built."""
        return concatenate(self._own, Kind.GHOSTS)

    def add_ghosts(self, batch: Batch) -> None:
        """Take in copies of a neighbour's photons, or of its surface points."""
        if batch.kind is Kind.POINTS:
            self._ghost_points.append(batch.arrays)
        else:
            self._ghosts.append(batch.arrays)
            self.ghost_count += np.bincount(batch.arrays["map"], minlength=MAPS)

    def ghosts(self) -> Iterator[Batch]:
        """For every other cell, the photons and surface points that lie in its band: two batches, even if empty."""
        replica, world = self._replica, self._replica.world
        low, high = cells.cell_boxes(world.top_tree.axis, world.top_tree.split)
        self._own_points = self._spread_points()
        photons = concatenate(self._own, Kind.GHOSTS)
        self._own = [photons]
        of_map = [np.flatnonzero(photons["map"] == number) for number in range(MAPS)]
        places = [photons["position"][rows] for rows in of_map]
        # Distances are rounded, and photons lie a rounding off their surfaces: pad covers both.
        bands = [plan.band + replica.pad if plan.paths else 0.0 for plan in world.maps]
        for cell in range(len(low)):
            if cell != self._cell:
                near = [
                    rows[rows_near(place, low[cell], high[cell], band)]
                    for rows, place, band in zip(of_map, places, bands, strict=True)
                ]
                yield Batch(Kind.GHOSTS, -1, replica.worker, cell, 0, take(photons, np.sort(np.concatenate(near))))
                rows = rows_near(self._own_points["position"], low[cell], high[cell], max(bands))
                yield Batch(Kind.POINTS, -1, replica.worker, cell, 0, take(self._own_points, rows))

    def _spread_points(self) -> Arrays:
        """The surface points that lie in this cell."""
        replica = self._replica
        position, normal = spread(
            self._surfaces,
            replica.cells,
            self._cell,
            self._surfaces.ids.numpy(),
            triangle_areas(self._surfaces.corners.numpy()),
            replica.world.point_area,
            replica.launcher,
        )
        return {"position": position, "normal": normal}

    def build(self) -> None:
        """Build the trees of photons and of surface points, own and ghosts, and let go of what they are built from."""
        photons = concatenate([*self._own, *self._ghosts], Kind.GHOSTS)
        self._own, self._ghosts, self._deposits = [], [], None
        for number, plan in enumerate(self._replica.world.maps):
            self.maps[number] = self._built(photons, number, plan)
        points = concatenate([self._own_points, *self._ghost_points], Kind.POINTS)
        self._own_points, self._ghost_points = {}, []
        none = np.zeros_like(points["position"])
        order = np.arange(len(none), dtype=np.int64)
        launcher = self._replica.launcher
        self.points = photon_map.build(
            points["position"], none, points["normal"], none, order, launcher.device, launcher.build_launcher()
        )

    def _built(self, photons: Arrays, number: int, plan: MapPlan) -> BuiltMap | None:
        if plan.paths == 0:
            return None
        launcher = self._replica.launcher
        chosen = take(photons, np.flatnonzero(photons["map"] == number))
        tree = photon_map.build(
            chosen["position"],
            chosen["flux"],
            chosen["normal"],  # of volume photons: (medium, 0, 0)
            chosen["direction"],
            chosen["id"],
            launcher.device,
            launcher.build_launcher(),
        )
        edges = np.ascontiguousarray(chosen["edges"][np.argsort(chosen["id"])])
        return BuiltMap(tree, wp.array(edges, dtype=wp.int32, device=launcher.device))

    def forget(self) -> None:
        """Let go of all photons and what was counted about them."""
        self._own, self._ghosts = [], []
        self._own_points, self._ghost_points, self.points = {}, [], None
        self.maps = [None] * MAPS
        self.count[:] = 0
        self.ghost_count[:] = 0
        self.counters.by_light[:] = 0
        self.counters.flux_by_light[:] = 0.0
        self.counters.nonfinite = 0


def _empty_deposits(total: int, device: str) -> Any:
    deposits = pp.Deposits()
    deposits.id = wp.empty(total, dtype=wp.int64, device=device)
    for name in ("edges", "map", "light"):
        setattr(deposits, name, wp.empty(total, dtype=wp.int32, device=device))
    for name in ("position", "flux", "normal", "direction"):
        setattr(deposits, name, wp.empty(total, dtype=wp.vec3, device=device))
    return deposits
