"""All light transport in one partition: batches in, batches out; no socket, no file, no clock.

A cell holds the triangles that overlap it, the photons that landed in it, and the ghosts of its band. Whatever leaves
it says where it goes: rays to other cells, results to the home of their task.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import GHOSTS, Arrays, Batch, Kind
from wdpm.cluster.host_cache import CacheEntry, HostCache
from wdpm.cluster.runs import Runs
from wdpm.cluster.work import tally
from wdpm.cluster.work.camera_paths import CameraPaths
from wdpm.cluster.work.final_gather import FinalGatherCounters
from wdpm.cluster.work.photon_gathers import PhotonGatherCounters
from wdpm.cluster.work.photon_paths import PhotonPaths
from wdpm.cluster.work.photon_store import PhotonStore
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.work.whole.launches import Counts
from wdpm.cluster.work.whole.samples import RaysTracedWhole, RecordRays, TracedWhole
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.lights import lights
from wdpm.kernels.rays import cell_triangles, two_level
from wdpm.kernels.rays.instances import upload_instances
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
            balls = lights.balls(replica.lights)
            trees = two_level.build(triangles, instances, replica.pad, device, balls, replica.launcher.run_on_host)
            triangles.let_go()
            return [trees, cell_triangles.upload(triangles, replica.world.extent, device, instances)]

        self._trees, self._surfaces = replica.host_cache.get(self._entry(make))
        self.store = PhotonStore(number, self._trees, self._surfaces, triangles, replica)
        self._camera_paths = CameraPaths(number, self._trees, self._surfaces, self.store, replica)
        self._photon_paths = PhotonPaths(number, self._trees, self._surfaces, self.store, replica)
        self._actions = {
            Kind.START: self._camera_paths.start_camera,
            Kind.CAMERA: self._camera_paths.visit_camera,
            Kind.PROBE: self._camera_paths.probe,
            Kind.SHADE: self._camera_paths.shade_camera,
            Kind.CANDIDATE: self._camera_paths.take_candidates,
            Kind.CANDIDATE_HIT: self._camera_paths.take_candidates,
            Kind.PATH: self._camera_paths.visit_paths,
            Kind.VERTEX: self._camera_paths.shade_vertices,
            Kind.SHADOW: self._camera_paths.shadows.visit,
            Kind.SHADOW_WALK: self._camera_paths.shadows.visit_walks,
            Kind.SHADOW_WALK_HIT: self._camera_paths.shadows.pass_surfaces,
            Kind.BEAM: self._camera_paths.beams.visit,
            Kind.PHOTON: self._photon_paths.trace,
            Kind.LANDED: self._photon_paths.trace,
        }

    def _entry(self, make: Callable[[], Sequence[Any]]) -> CacheEntry:
        """The tree and the tables of its triangles, as workers of one machine share them."""
        return CacheEntry(f"cell {self.number}", (two_level.Trees, cell_triangles.Surfaces), make)

    def lend(self, host_cache: HostCache) -> Sequence[Any]:
        """Have workers that share this cache map what was made of the triangles here; what keeps that there."""
        return host_cache.get(self._entry(lambda: [self._trees, self._surfaces]))

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

    @property
    def traces_whole(self) -> bool:
        """As WholeSamples.can_be."""
        return self._camera_paths.whole.can_be

    def trace_whole(self, pixels: Arrays, start: int, samples: int, sums: Any) -> TracedWhole | None:
        """As WholeSamples.trace."""
        added = self._camera_paths.whole.trace(pixels, start, samples, sums)
        if self._in_files is not None:
            self._in_files.let_go()
        return added

    def trace_rays_whole(self, rays: RecordRays) -> RaysTracedWhole | None:
        """As CameraPaths.trace_rays_whole."""
        traced = self._camera_paths.trace_rays_whole(rays)
        if self._in_files is not None:
            self._in_files.let_go()
        return traced

    def start_paths(self, runs: Runs, paths: Any) -> Iterator[Batch]:
        """As CameraPaths.start_paths."""
        yield from self._camera_paths.start_paths(runs, paths)
        if self._in_files is not None:
            self._in_files.let_go()

    def count_whole(self, counts: Counts) -> None:
        """As CameraPaths.count_whole."""
        self._camera_paths.count_whole(counts)

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
        # What first vertices show is written down where camera rays are lit; in a medium they are collisions.
        first = batch.kind is Kind.VERTEX and not self.replica.world.features.media
        if first and len(batch) and batch.arrays["bounce"].min() < 1:
            raise ProtocolError(f"a vertex batch came for cell {self.number} with paths that have left no vertex")
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
    def energy(self) -> NDArray[np.float64]:
        """Power of photons that were absorbed, escaped, or were cut off here [W x paths], shape [3]."""
        return self._photon_paths.energy

    @property
    def vertices(self) -> int:
        """Of camera paths beyond their first surface that were shaded here, in this view."""
        return self._camera_paths.vertices

    @property
    def beams(self) -> int:
        """Stretches of medium that came here, in this view."""
        return self._camera_paths.beams.count

    @property
    def gathers(self) -> PhotonGatherCounters:
        """What gathers did here."""
        return self._camera_paths.gathering.counters

    @property
    def final_gather(self) -> FinalGatherCounters:
        """What final gathering did here."""
        return self._camera_paths.final_gather.counters

    @property
    def guards(self) -> dict[str, int]:
        """What guards did here to camera samples of the view, by cause."""
        return dict(self._camera_paths.guards.counts)

    def all_counters(self) -> list[tally.Counter]:
        """All that is counted here."""
        of_guards = [self._camera_paths.guards.counts, self.store.guards.counts]
        of_photons = [self.energy, self.store.count, self.store.counters]
        of_paths = [tally.Number(self._camera_paths, "vertices"), tally.Number(self._camera_paths.beams, "count")]
        return [*of_photons, *of_guards, *of_paths, self.gathers, self.final_gather]

    def begin_view(self) -> None:
        """Count anew what is counted for each view."""
        self._camera_paths.begin_view()

    def forget_photons(self) -> None:
        """Let go of all photons and what was counted about them."""
        self.store.forget()
        self._camera_paths.forget_photons()
        self.energy[:] = 0

    def update_materials(self) -> None:
        """Trace photons among the replica's materials, which have changed."""
        self._photon_paths.update_materials()
