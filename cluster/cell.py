"""All light transport in one partition: batches in, batches out; no socket, no file, no clock.

A cell holds the triangles that overlap it, the photons that landed in it, and the ghosts of its band. Whatever leaves
it says where it goes: rays to other cells, results to the home of their task.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Batch, Kind, by_destination, concatenate, take
from wdpm.cluster.partition import rows_near
from wdpm.cluster.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import bvh, cells, columns, lights, photon_map, surface
from wdpm.kernels import camera_samples as cs
from wdpm.kernels import photon_paths as pp
from wdpm.kernels.gather import gather_kernel
from wdpm.kernels.surface_points import reflect_gathered, spread
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.geometry import Triangles

GATHER_RUN = 32
"""Gathers that one Warp thread makes one after another: enough to profit from its last radius, and to share out."""

GATHER_GRAIN = 32
"""Runs of gathers that are worth a launch of their own."""

DEPOSITS_A_PATH = 6
"""Room for photons, a path, in one launch. What finds none waits for the next launch."""


@dataclass
class CellCounters:
    """What a cell has done, for the report."""

    energy: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    stored_by_light: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    gathers: int = 0
    gathers_truncated: int = 0
    gathers_left_band: int = 0
    nonfinite: dict[str, int] = field(default_factory=dict)


class Cell:
    """One partition of the scene.

    Args:
        number: which leaf of the top tree it is.
        triangles: those that overlap the cell.
        replica: what every worker has a copy of.
    """

    def __init__(self, number: int, triangles: Triangles, replica: Replica) -> None:
        self.number = number
        self.replica = replica
        self.triangle_count = len(triangles)
        device = replica.launcher.device
        materials = replica.world.materials
        self._bvh = bvh.build(triangles.positions, triangles.ids, replica.pad, device)
        self._surfaces = surface.upload(
            triangles,
            materials.reflectance,
            materials.texture,
            materials.twosided,
            replica.world.emitter_radiance,
            replica.textures,
            replica.world.extent,
            device,
        )
        self._photons: list[Arrays] = []
        self._ghosts: list[Arrays] = []
        self._deposits: Any = None
        self._map: Any = None
        self._own_points: Arrays = {}
        self._ghost_points: list[Arrays] = []
        self._points: Any = None
        self.photon_count = 0
        self.ghost_count = 0
        self.counters = CellCounters(stored_by_light=np.zeros(len(replica.world.lights.names), np.int64))

    def advance(self, batch: Batch) -> Iterator[Batch]:
        """Do what a batch asks for, and yield what follows from it."""
        if batch.kind in (Kind.SHADE, Kind.LANDED) and not self.triangle_count:
            raise ProtocolError(f"a {batch.kind.value} batch came for cell {self.number}, which holds no triangle")
        if batch.kind is Kind.CAMERA:
            yield from self._visit_camera(batch)
        elif batch.kind is Kind.PROBE:
            yield from self._probe(batch)
        elif batch.kind is Kind.SHADE:
            yield from self._shade(batch)
        elif batch.kind is Kind.SHADOW:
            yield from self._visit_shadow(batch)
        elif batch.kind in (Kind.PHOTON, Kind.LANDED):
            yield from self._trace(batch)
        elif batch.kind is Kind.GHOSTS:
            self._ghosts.append(batch.arrays)
            self.ghost_count += len(batch)
        elif batch.kind is Kind.POINTS:
            self._ghost_points.append(batch.arrays)
        else:
            raise ValueError(f"{batch.kind} is not for a cell")

    # Photons

    def _trace(self, batch: Batch) -> Iterator[Batch]:
        """Follow photons until each has left the cell or ended. Each carries a credit of one."""
        arrays, landed = batch.arrays, batch.kind is Kind.LANDED
        ended = 0
        while True:
            flown, status, destination = self._launch_trace(arrays, landed)
            ended += int(np.count_nonzero(status == pp.ENDED))
            for kind, code in ((Kind.PHOTON, pp.TRAVELS), (Kind.LANDED, pp.LANDS)):
                for cell, rows in by_destination(destination, status == code):
                    yield self._batch(batch, kind, cell, len(rows), take(flown, rows))
            waiting = np.flatnonzero(status == pp.WAITS)
            if not len(waiting):
                break
            arrays, landed = take(flown, waiting), True
        if ended:
            yield self._batch(batch, Kind.ENDED, self.number, ended, {})

    def _launch_trace(self, arrays: Arrays, landed: bool) -> tuple[Arrays, NDArray[np.int32], NDArray[np.int32]]:
        """One launch over photons in flight; keeps what was stored."""
        launcher, device, world = self.replica.launcher, self.replica.launcher.device, self.replica.world
        count = len(arrays["path"])
        chunks = launcher.chunks(count)
        capacity = max(size for _, size in chunks) * DEPOSITS_A_PATH
        flight = columns.upload(pp.Flight, arrays, device)
        deposits = self._room(capacity, len(chunks))
        status = wp.empty(count, dtype=wp.int32, device=device)
        destination = wp.empty(count, dtype=wp.int32, device=device)
        energy = wp.empty((count, 3), dtype=wp.float64, device=device)
        scene = [self._bvh, self._surfaces, self.replica.cells, flight]
        scalars = [int(landed), self.number, wp.uint32(world.seed), world.max_depth or 0]
        outputs = [deposits, status, destination, energy]
        launcher.run(
            pp.trace_photons,
            [(size, [*scene, *scalars, chunk, start, *outputs]) for chunk, (start, size) in enumerate(chunks)],
        )
        self.counters.energy += energy.numpy().sum(axis=0)
        self._keep(deposits, capacity)
        return columns.download(flight, SCHEMAS[Kind.PHOTON]), status.numpy(), destination.numpy()

    def _room(self, capacity: int, chunks: int) -> Any:
        """Room for photons, used again from launch to launch: fresh memory costs as much as the photons in it."""
        if self._deposits is None or len(self._deposits.id) < capacity * chunks:
            self._deposits = _empty_deposits(capacity * chunks, self.replica.launcher.device)
        self._deposits.capacity = capacity
        self._deposits.count = wp.zeros(chunks, dtype=wp.int32, device=self.replica.launcher.device)
        return self._deposits

    def _keep(self, deposits: Any, capacity: int) -> None:
        """Take stored photons out of the regions of a launch."""
        names = SCHEMAS[Kind.GHOSTS]
        regions = columns.download(deposits, [*names, "light"])
        for chunk, asked in enumerate(deposits.count.numpy()):
            kept = min(int(asked), capacity)
            if kept:
                region = slice(chunk * capacity, chunk * capacity + kept)
                photons = {name: regions[name][region].copy() for name in names}
                light = regions["light"][region]
                finite = np.isfinite(photons["flux"]).all(axis=1)
                if not finite.all():
                    self._count_nonfinite("photon", int(np.count_nonzero(~finite)))
                    photons, light = take(photons, np.flatnonzero(finite)), light[finite]
                self._photons.append(photons)
                self.photon_count += len(light)
                self.counters.stored_by_light += np.bincount(light, minlength=len(self.counters.stored_by_light))

    def ghosts(self) -> Iterator[Batch]:
        """For every other cell, the photons and surface points that lie in its band: two batches, even if empty."""
        world = self.replica.world
        low, high = cells.cell_boxes(world.top_tree.axis, world.top_tree.split)
        self._own_points = self._spread_points()
        photons = concatenate(self._photons, Kind.GHOSTS)
        self._photons = [photons]
        # Distances are rounded, and photons lie a rounding off their surfaces: pad covers both.
        band = world.band + self.replica.pad
        for cell in range(len(low)):
            if cell != self.number:
                rows = rows_near(photons["position"], low[cell], high[cell], band)
                yield Batch(Kind.GHOSTS, -1, self.replica.worker, cell, 0, take(photons, rows))
                rows = rows_near(self._own_points["position"], low[cell], high[cell], band)
                yield Batch(Kind.POINTS, -1, self.replica.worker, cell, 0, take(self._own_points, rows))

    def _spread_points(self) -> Arrays:
        """The surface points that lie in this cell."""
        replica = self.replica
        position, normal = spread(
            self._surfaces,
            replica.cells,
            self.number,
            self._surfaces.ids.numpy(),
            lights.triangle_areas(self._surfaces.corners.numpy()),
            replica.world.point_area,
            replica.launcher,
        )
        return {"position": position, "normal": normal}

    def build_map(self) -> None:
        """Build the trees of photons and of surface points, own and ghosts, and let go of what they are built from."""
        photons = concatenate([*self._photons, *self._ghosts], Kind.GHOSTS)
        self._photons, self._ghosts, self._deposits = [], [], None
        device, launch = self.replica.launcher.device, self.replica.launcher.build_launcher()
        self._map = photon_map.build(
            photons["position"], photons["flux"], photons["normal"], photons["direction"], photons["id"], device, launch
        )
        points = concatenate([self._own_points, *self._ghost_points], Kind.POINTS)
        self._own_points, self._ghost_points = {}, []
        none = np.zeros_like(points["position"])
        number = np.arange(len(none), dtype=np.int64)
        self._points = photon_map.build(points["position"], none, points["normal"], none, number, device, launch)

    def forget_photons(self) -> None:
        """Let go of all photons and what was counted about them."""
        self._photons, self._ghosts, self._map = [], [], None
        self._own_points, self._ghost_points, self._points = {}, [], None
        self.photon_count = self.ghost_count = 0
        self.counters.energy[:] = 0
        self.counters.stored_by_light[:] = 0
        self.counters.nonfinite.clear()

    def photons_so_far(self) -> Arrays:
        """The photons stored so far; only before the map is built."""
        return concatenate(self._photons, Kind.GHOSTS)

    # Camera samples

    def _visit_camera(self, batch: Batch) -> Iterator[Batch]:
        """Intersect camera rays; forward those that may find a nearer hit elsewhere."""
        rays, onward = self._intersect(batch.arrays)
        unit = self._credit_of_ray()
        for cell, rows in by_destination(onward, onward >= 0):
            yield self._batch(batch, Kind.CAMERA, cell, len(rows) * unit, take(rays, rows))
        final = onward < 0
        hit = rays["prim"] >= 0
        for cell, rows in by_destination(rays["owner"], final & hit):
            yield self._batch(batch, Kind.SHADE, cell, len(rows) * unit, take(rays, rows))
        missed = int(np.count_nonzero(final & ~hit))
        if missed:
            yield self._batch(batch, Kind.ENDED, self.number, missed * unit, {})

    def _probe(self, batch: Batch) -> Iterator[Batch]:
        """Intersect camera rays with this cell alone, and tell the home what was hit."""
        rays, _ = self._intersect({**batch.arrays, **no_hits(len(batch), self._view)})
        found = np.flatnonzero(rays["prim"] >= 0)
        yield self._batch(
            batch, Kind.PROBED, self.number, batch.credit, {name: rays[name][found] for name in SCHEMAS[Kind.PROBED]}
        )

    def _intersect(self, arrays: Arrays) -> tuple[Arrays, NDArray[np.int32]]:
        """Camera rays with their best hits refined by this cell, and the cell that each visits next or -1."""
        replica, device = self.replica, self.replica.launcher.device
        rays = columns.upload(cs.Rays, arrays, device)
        onward = wp.empty(len(arrays["slot"]), dtype=wp.int32, device=device)
        replica.launcher(
            cs.visit_camera_rays,
            len(arrays["slot"]),
            [self._bvh, self._surfaces, replica.cells, replica.camera, rays, self.number],
            [onward],
        )
        return columns.download(rays, SCHEMAS[Kind.CAMERA]), onward.numpy()

    def _shade(self, batch: Batch) -> Iterator[Batch]:
        """Light final hits in this cell: results for the home, and shadow segments."""
        replica, view, device = self.replica, self._view, self.replica.launcher.device
        count, shots = len(batch), self._view.light_samples
        rays = columns.upload(cs.Rays, batch.arrays, device)
        seen = columns.empty(cs.Seen, count, device)
        queries = columns.empty(cs.Queries, count, device)
        segments = columns.empty(cs.Segments, count * shots, device)
        replica.launcher(
            cs.shade_camera_hits,
            count,
            [self._surfaces, replica.lights, replica.camera, rays, shots, view.max_depth or 0],
            [seen, queries, segments],
        )
        samples = {
            "slot": batch.arrays["slot"],
            "indirect": self._gather(queries, seen.albedo),
            "cell": np.full(count, self.number, np.int32),
            **columns.download(seen, ("emission", "depth", "normal", "albedo")),
        }
        for cause in ("emission", "indirect"):
            samples[cause] = self._blacken_nonfinite(samples[cause], cause)
        yield self._batch(batch, Kind.SAMPLES, self.number, count, samples)
        yield from self._start_shadows(batch, segments, count * shots)

    def _gather(self, queries: Any, albedo: Any) -> NDArray[np.float32]:
        """Radiance reflected of the photons about each query, float32, shape [queries, 3]."""
        replica, view, device = self.replica, self._view, self.replica.launcher.device
        world, count = replica.world, len(albedo)
        indirect = wp.zeros(count, dtype=wp.vec3, device=device)
        if world.paths == 0:
            return np.asarray(indirect.numpy())
        irradiance = wp.empty(count, dtype=wp.vec3, device=device)
        used = wp.empty(count, dtype=wp.int32, device=device)
        radius = wp.empty(count, dtype=wp.float32, device=device)
        truncated = wp.empty(count, dtype=wp.bool, device=device)
        inputs = [self._map, queries.position, queries.normal, queries.shading_normal, view.k, world.radius]
        outputs = [GATHER_RUN, irradiance, used, radius, truncated]
        runs = -(-count // GATHER_RUN)
        replica.launcher(gather_kernel, runs, inputs, outputs, grain=GATHER_GRAIN)
        places = [self._points, queries.position, queries.front_normal, queries.clearance]
        found = [albedo, irradiance, radius, world.point_area, world.radius, 1.0 / world.paths]
        replica.launcher(reflect_gathered, count, [*places, *found], [indirect])
        self.counters.gathers += count
        self.counters.gathers_truncated += int(np.count_nonzero(truncated.numpy()))
        if world.band < world.radius:
            self._count_left_band(queries.position.numpy(), radius.numpy())
        return np.asarray(indirect.numpy())

    def _count_left_band(self, position: NDArray[np.float32], radius: NDArray[np.float32]) -> None:
        """Count gathers that reach beyond the photons that this cell has."""
        world = self.replica.world
        low, high = cells.cell_boxes(world.top_tree.axis, world.top_tree.split)
        margin = np.minimum(position - low[self.number], high[self.number] - position).min(axis=1)
        self.counters.gathers_left_band += int(np.count_nonzero(radius > margin + world.band))

    def _start_shadows(self, batch: Batch, segments: Any, count: int) -> Iterator[Batch]:
        """Send shadow segments to the first cell on their way; those that carry nothing end here."""
        replica = self.replica
        arrays = columns.download(segments, SCHEMAS[Kind.SHADOW])
        arrays["radiance"] = self._blacken_nonfinite(arrays["radiance"], "direct")
        if replica.world.top_tree.cells == 1:
            yield self._batch(batch, Kind.SHADOW, self.number, count, arrays)
            return
        first = wp.empty(count, dtype=wp.int32, device=replica.launcher.device)
        replica.launcher(cs.first_shadow_cells, count, [replica.cells, segments], [first])
        yield from self._send_shadows(batch, arrays, first.numpy())
        dark = int(np.count_nonzero(first.numpy() < 0))
        if dark:
            yield self._batch(batch, Kind.ENDED, self.number, dark, {})

    def _send_shadows(self, batch: Batch, arrays: Arrays, onward: NDArray[np.int32]) -> Iterator[Batch]:
        for cell, rows in by_destination(onward, onward >= 0):
            yield self._batch(batch, Kind.SHADOW, cell, len(rows), take(arrays, rows))

    def _visit_shadow(self, batch: Batch) -> Iterator[Batch]:
        """Look for what blocks shadow segments here; what is clear to its end is lit."""
        replica, device = self.replica, self.replica.launcher.device
        segments = columns.upload(cs.Segments, batch.arrays, device)
        onward_array = wp.empty(len(batch), dtype=wp.int32, device=device)
        replica.launcher(
            cs.visit_shadow_segments, len(batch), [self._bvh, replica.cells, segments, self.number], [onward_array]
        )
        onward = onward_array.numpy()
        yield from self._send_shadows(batch, batch.arrays, onward)
        clear = np.flatnonzero(onward == cs.SHADOW_CLEAR)
        if len(clear):
            lit = {name: batch.arrays[name][clear] for name in SCHEMAS[Kind.LIT]}
            yield self._batch(batch, Kind.LIT, self.number, len(clear), lit)
        blocked = int(np.count_nonzero(onward == cs.SHADOW_BLOCKED))
        if blocked:
            yield self._batch(batch, Kind.ENDED, self.number, blocked, {})

    def begin_view(self) -> None:
        """Count anew what is counted for each view."""
        self.counters.gathers = self.counters.gathers_truncated = self.counters.gathers_left_band = 0
        self.counters.nonfinite = {cause: n for cause, n in self.counters.nonfinite.items() if cause == "photon"}

    # Odds and ends

    @property
    def _view(self) -> View:
        if self.replica.view is None:
            raise ValueError("a camera batch came before a view was set")
        return self.replica.view

    def _credit_of_ray(self) -> int:
        """A camera ray's credit: one for its sample, one for each shadow segment that it may start."""
        return 1 + self._view.light_samples

    def _batch(self, cause: Batch, kind: Kind, cell: int, credit: int, arrays: Arrays) -> Batch:
        """What follows from a batch: the same task, the same home."""
        return Batch(kind, cause.task, cause.home, cell, credit, arrays)

    def _blacken_nonfinite(self, values: NDArray[np.float32], cause: str) -> NDArray[np.float32]:
        """Rows with a NaN or an infinity become black, since one would spoil its pixel, and are counted by cause."""
        if np.isfinite(values.sum(dtype=np.float64)):
            return values  # a sum is finite only if its terms are
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        blackened = values.copy()
        blackened[bad] = 0.0
        self._count_nonfinite(cause, len(bad))
        return blackened

    def _count_nonfinite(self, cause: str, count: int) -> None:
        if count:
            self.counters.nonfinite[cause] = self.counters.nonfinite.get(cause, 0) + count


def no_hits(count: int, view: View) -> dict[str, NDArray[Any]]:
    """Best hits of camera rays that have met nothing yet."""
    return {
        # As camera_ray computes it: the difference of two float32, rounded once.
        "t": np.full(count, np.float32(view.camera.far_clip) - np.float32(view.camera.near_clip)),
        "prim": np.full(count, -1, np.int32),
        "u": np.zeros(count, np.float32),
        "v": np.zeros(count, np.float32),
        "owner": np.full(count, -1, np.int32),
    }


def _empty_deposits(total: int, device: str) -> Any:
    deposits = pp.Deposits()
    deposits.id = wp.empty(total, dtype=wp.int64, device=device)
    deposits.light = wp.empty(total, dtype=wp.int32, device=device)
    for name in ("position", "flux", "normal", "direction"):
        setattr(deposits, name, wp.empty(total, dtype=wp.vec3, device=device))
    return deposits
