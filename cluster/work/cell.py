"""All light transport in one partition: batches in, batches out; no socket, no file, no clock.

A cell holds the triangles that overlap it, the photons that landed in it, and the ghosts of its band. Whatever leaves
it says where it goes: rays to other cells, results to the home of their task.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import GHOSTS, SCHEMAS, Arrays, Batch, Kind, by_destination, take
from wdpm.cluster.host_cache import Wanted
from wdpm.cluster.work import tally
from wdpm.cluster.work.camera_paths import CameraLight
from wdpm.cluster.work.final_gather import FinalGatherCounters
from wdpm.cluster.work.guards import PHOTONS_CUT, added
from wdpm.cluster.work.photon_gathers import PhotonGatherCounters
from wdpm.cluster.work.photon_store import DEPOSITS_A_PATH, LEAST_DEPOSITS, PhotonStore
from wdpm.cluster.work.replica import Replica
from wdpm.kernels import columns
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.photons import flight as pf
from wdpm.kernels.photons.paths import Fates, TraceOrders, TraceScene
from wdpm.kernels.rays import cell_triangles as of_triangles
from wdpm.kernels.rays import two_level
from wdpm.kernels.rays.instances import upload_instances
from wdpm.kernels.rays.triangle import NO_HIT
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.room import lies_in_file

MANY_TRIANGLES = 1 << 20
"""100 MB of them: pages of less stay in memory from batch to batch."""

_NEEDS_SURFACE = (Kind.SHADE, Kind.CANDIDATE_HIT, Kind.VERTEX, Kind.SHADOW_WALK_HIT)


class Cell:
    """One partition of the scene.

    Args:
        number: which leaf of the top tree it is.
        triangles: those that overlap the cell.
        replica: what every worker has a copy of.

    Attributes:
        store: its photons.
        energy: what became of the photons' power here: absorbed, escaped, cut off [W x paths].
    """

    def __init__(self, number: int, triangles: Triangles, replica: Replica) -> None:
        self.number = number
        self.replica = replica
        self.triangle_count = triangles.total
        large = len(triangles) >= MANY_TRIANGLES and lies_in_file(triangles.positions)
        self._in_files = triangles if large else None

        def make() -> list[Any]:
            device = replica.launcher.device
            instances = upload_instances(triangles.instances, device)
            trees = two_level.build(triangles, instances, replica.pad, device)
            triangles.let_go()
            return [trees, of_triangles.upload(triangles, replica.world.extent, device, instances)]

        kinds = (two_level.Trees, of_triangles.Surfaces)
        self._trees, self._surfaces = replica.made.get(Wanted(f"cell {number}", kinds, make))
        self.store = PhotonStore(number, self._surfaces, triangles.instances, replica)
        self._light = CameraLight(number, self._trees, self._surfaces, self.store, replica)
        self._trace_scene = self._trace_scene_of(replica)
        self.energy = np.zeros(3)
        self._actions = {
            Kind.CAMERA: self._light.visit_camera,
            Kind.PROBE: self._light.probe,
            Kind.SHADE: self._light.shade_camera,
            Kind.CANDIDATE: self._light.visit_candidates,
            Kind.CANDIDATE_HIT: self._light.find_record_sites,
            Kind.PATH: self._light.visit_paths,
            Kind.VERTEX: self._light.shade_vertices,
            Kind.SHADOW: self._light.shadows.visit,
            Kind.SHADOW_WALK: self._light.shadows.visit_walks,
            Kind.SHADOW_WALK_HIT: self._light.shadows.pass_surfaces,
            Kind.BEAM: self._light.beams.visit,
            Kind.PHOTON: self._trace,
            Kind.LANDED: self._trace,
        }

    def advance(self, batch: Batch) -> Iterator[Batch]:
        """Do what a batch asks for, and yield what follows from it."""
        self._check(batch)
        if batch.kind in GHOSTS:
            self.store.add_ghosts(batch)
        elif batch.kind is Kind.COPIED_PHOTONS:
            self.store.add_copies(batch.arrays, batch.home)
        elif batch.kind is Kind.COPIED_ORDER:
            self.store.add_order(batch.arrays)
        elif batch.kind is Kind.COPIED_IRRADIANCE:
            self.store.add_irradiance(batch.arrays)
        elif batch.kind in self._actions:
            yield from self._actions[batch.kind](batch)
            if self._in_files is not None:
                self._in_files.let_go()
        else:
            raise ValueError(f"{batch.kind} is not for a cell")

    def _check(self, batch: Batch) -> None:
        """Raise ProtocolError if a batch asks for what this cell or this scene does not have."""
        needs = batch.kind in _NEEDS_SURFACE
        if batch.kind in (Kind.LANDED, Kind.VERTEX):  # in a medium, some land on no surface
            landed = batch.arrays["prim"] >= 0
            needs = bool(landed.any())
            view = self.replica.view
            collides = view is not None and view.diffuse_light is DiffuseLight.PATHS
            if batch.kind is Kind.VERTEX and not landed.all() and not collides:
                raise ProtocolError(f"a vertex batch came for cell {self.number} with paths that have hit nothing")
        if needs and not self.triangle_count:
            raise ProtocolError(f"a {batch.kind.value} batch came for cell {self.number}, which holds no triangle")

    @property
    def lets_go(self) -> bool:
        """Whether pages of its triangles leave memory after each batch: of very many that lie in files."""
        return self._in_files is not None

    @property
    def geometry(self) -> tuple[Any, Any]:
        """Its trees (kernels.rays.two_level.Trees) and surfaces (kernels.rays.cell_triangles.Surfaces)."""
        return self._trees, self._surfaces

    @property
    def vertices(self) -> int:
        """Of camera paths beyond their first surface that were shaded here, in this view."""
        return self._light.vertices

    @property
    def beams(self) -> int:
        """Stretches of medium that came here, in this view."""
        return self._light.beams.count

    @property
    def gathers(self) -> PhotonGatherCounters:
        """What gathers did here."""
        return self._light.gathering.counters

    @property
    def final_gather(self) -> FinalGatherCounters:
        """What final gathering did here."""
        return self._light.final_gather.counters

    @property
    def guards(self) -> dict[str, int]:
        """What guards did here, by cause: to camera samples of the view, and to photons."""
        return added([self._light.guards.counts, self.store.guards.counts])

    def all_counters(self) -> list[tally.Counter]:
        """All that is counted here."""
        of_guards = [self._light.guards.counts, self.store.guards.counts]
        of_photons = [self.energy, self.store.count, self.store.counters]
        of_paths = [tally.Number(self._light, "vertices"), tally.Number(self._light.beams, "count")]
        return [*of_photons, *of_guards, *of_paths, self.gathers, self.final_gather]

    def begin_view(self) -> None:
        """Count anew what is counted for each view."""
        self._light.begin_view()

    def forget_photons(self) -> None:
        """Let go of all photons and what was counted about them."""
        self.store.forget()
        self.energy[:] = 0

    def _trace(self, batch: Batch) -> Iterator[Batch]:
        """Follow photons until each has left the cell or ended. Each carries a credit of one.

        What a run has beyond that is of photons of its task that ended elsewhere.
        """
        arrays, landed, runs = batch.arrays, batch.kind is Kind.LANDED, batch.runs
        ended = np.maximum(runs.credit - runs.rows, 0)
        while True:
            flown, status, destination = self._launch_trace(arrays, landed)
            ended += runs.sums(status == pf.ENDED)
            self._count_cut(flown, status)
            for kind, code in ((Kind.PHOTON, pf.TRAVELS), (Kind.LANDED, pf.LANDS)):
                for cell, rows in by_destination(destination, status == code):
                    yield Batch(kind, cell, runs.among(rows).with_unit(), take(flown, rows))
            waiting = np.flatnonzero(status == pf.WAITS)
            if not len(waiting):
                break
            arrays, landed, runs = take(flown, waiting), True, runs.among(waiting)
        if ended.any():
            yield Batch(Kind.ENDED, self.number, runs.without_rows(ended), {})

    def _count_cut(self, flown: Arrays, status: NDArray[np.int32]) -> None:
        """Count the photons that ended at the limit of bounces, and not because they left the scene there."""
        at_limit = (status == pf.ENDED) & (flown["bounce"] >= pf.BOUNCE_LIMIT)
        if at_limit.any():
            left = (flown["prim"] < 0) & (flown["t"] >= np.float32(NO_HIT))
            cut = take(flown, np.flatnonzero(at_limit & ~left))
            self.store.guards.act_on_photons(PHOTONS_CUT, cut["path"], cut["bounce"], cut["light"])

    def _launch_trace(self, arrays: Arrays, landed: bool) -> tuple[Arrays, NDArray[np.int32], NDArray[np.int32]]:
        """One launch over photons in flight; keeps what was stored."""
        replica, world = self.replica, self.replica.world
        launcher, device = replica.launcher, replica.launcher.device
        count = len(arrays["path"])
        chunks = launcher.chunks(count)
        capacity = max(LEAST_DEPOSITS, max(size for _, size in chunks) * DEPOSITS_A_PATH)
        flight = columns.upload(pf.Flight, arrays, device)
        deposits = self.store.room(capacity, len(chunks))
        fates = Fates()
        fates.status = wp.empty(count, dtype=wp.int32, device=device)
        fates.next_cell = wp.empty(count, dtype=wp.int32, device=device)
        fates.energy = wp.empty((count, 3), dtype=wp.float64, device=device)
        orders = TraceOrders()
        orders.landed = int(landed)
        orders.own_cell = self.number
        orders.global_paths = world.global_map.paths
        orders.stores_direct = int(world.stores_direct)
        orders.seed = wp.uint32(world.seed)
        orders.max_depth = world.max_depth or 0
        launcher.run(
            replica.kernels.trace_photons,
            [
                (size, [self._trace_scene, orders, flight, chunk, start, deposits, fates])
                for chunk, (start, size) in enumerate(chunks)
            ],
        )
        self.energy += fates.energy.numpy().sum(axis=0)
        self.store.keep(deposits, capacity)
        return columns.download(flight, SCHEMAS[Kind.PHOTON]), fates.status.numpy(), fates.next_cell.numpy()

    def take_materials(self) -> None:
        """Trace photons among the replica's materials."""
        self._trace_scene = self._trace_scene_of(self.replica)

    def _trace_scene_of(self, replica: Replica) -> TraceScene:
        """What photons need of this cell."""
        scene = TraceScene()
        scene.trees, scene.surfaces, scene.cells = self._trees, self._surfaces, replica.cells
        scene.materials, scene.textures, scene.media = replica.materials, replica.textures, replica.media
        return scene
