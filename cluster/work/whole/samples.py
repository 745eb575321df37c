"""Samples and gather rays that one launch follows to their ends: where one cell is all (kernels.whole_samples)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.records import RAY_SAMPLES
from wdpm.cluster.rows import put_rows, take_rows
from wdpm.cluster.work.final_gather import FinalGatherCounters
from wdpm.cluster.work.photon_gathers import PhotonGatherCounters, fewer_of_rays, least_of
from wdpm.cluster.work.photon_store import PhotonStore
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera import add_samples, vertices
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.irradiance.record_rays import ArrivedRays, Sites
from wdpm.kernels.launch import arguments_of
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.two_level import Trees
from wdpm.kernels.whole_samples import indirect_light, trace

WHOLE_GRAIN = 256
"""Samples below which handing a chunk of them to another thread costs more than it saves: of half a microsecond at
least, mostly of several."""

Counts = NDArray[np.int64]
"""By the numbers of kernels.whole_samples.indirect_light, VERTICES and so on."""

NO_COUNTS: Counts = np.zeros(int(indirect_light.COUNTS), np.int64)


class TracedWhole(NamedTuple):
    """What samples come to that were followed to their ends.

    Attributes:
        sums: of their pixels, with theirs (kernels.camera.add_samples.Sums).
        hit: of each pixel, whether the first of them met a surface.
        counts: what they did, which counts once they do.
    """

    sums: Any
    hit: NDArray[np.bool_]
    counts: Counts


class RecordRays(NamedTuple):
    """Gather rays of records as they set out.

    Attributes:
        paths: kernels.camera.paths.Paths; what they meet is written there.
        distance: inf, or negative where one is not shot, float32, shape [rays].
        sites: of their records (kernels.irradiance.record_rays.Sites).
        record: the site of each, int32, shape [rays].
        ray: its number among those of its record, int32, shape [rays].
    """

    paths: Any
    distance: NDArray[np.float32]
    sites: Any
    record: NDArray[np.int32]
    ray: NDArray[np.int32]


class RaysTracedWhole(NamedTuple):
    """What gather rays of records brought that were followed to their ends.

    Attributes:
        radiance: float64, shape [rays, 3] [W/(m² sr)].
        distance: of what each met [scene units]; inf if nothing, negative if it was not shot. Float32.
        counts: as of TracedWhole.
    """

    radiance: NDArray[np.float64]
    distance: NDArray[np.float32]
    counts: Counts


class WholeSamples:
    """Traces samples and gather rays in the only cell.

    Args:
        trees, surfaces: its triangles on the device.
        store: its photons.
    """

    def __init__(self, trees: Trees, surfaces: Surfaces, store: PhotonStore, replica: Replica) -> None:
        self._trees = trees
        self._surfaces = surfaces
        self._store = store
        self._replica = replica
        self._scene: Any = None
        self._known: tuple[list[Any], Any] = ([], None)  # and what it was made of

    def begin_view(self, scene: Any) -> None:
        """Look through the replica's view.

        Args:
            scene: kernels.camera.scene.Scene, in the cell.
        """
        self._scene, self._known = scene, ([], None)

    @property
    def can_be(self) -> bool:
        """Whether samples can be followed from the camera to their ends in one launch, with the same bits.

        In one cell, which has all that they meet, and where nobody looks on.
        """
        replica, world = self._replica, self._replica.world
        return replica.kernels.trace_samples is not None and replica.observer is None and world.top_tree.cells == 1

    def trace(self, pixels: Arrays, start: int, samples: int, sums: Any) -> TracedWhole | None:
        """Add samples `start` to `start + samples` of some pixels to their sums.

        Args:
            pixels: columns of kernels.whole_samples.trace.Pixels.
            sums: so far (kernels.camera.add_samples.Sums), which stay what they are.

        Returns:
            what they come to; None where something happened that guards count: then all that is under way with them is
            to be rendered in the other way.
        """
        device, count = self._replica.launcher.device, len(pixels["pixel"])
        sums_out = columns.zeros(add_samples.Sums, count, device)
        hit = columns.integers(count, device)
        uploaded = columns.upload(trace.Pixels, pixels, device, written=())
        counts = self._launch(
            count,
            max(1, WHOLE_GRAIN // samples),
            pixels=uploaded,
            sites=columns.empty(Sites, 0, device),
            rays=columns.empty(ArrivedRays, 0, device),
            start=start,
            samples=samples,
            sums=sums,
            sums_out=sums_out,
            hit_out=hit,
            radiance_out=wp.zeros(0, dtype=wp.vec3d, device=device),
            distance_out=columns.array_over(np.zeros(0, np.float32), wp.float32, device),
        )
        return None if counts[indirect_light.SPOILT] else TracedWhole(sums_out, hit.numpy() > 0, counts)

    def trace_rays(self, rays: RecordRays) -> RaysTracedWhole | None:
        """Follow gather rays of records, which have met what they meet first, to their ends.

        They are taken in the order of what they met: see CameraPaths.visit_paths. One that has met nothing brings
        nothing: what shines from beyond the scene is direct light.

        Returns:
            what they bring; None as of `trace`.
        """
        device, prim = self._replica.launcher.device, columns.column(rays.paths, "prim")
        met = np.flatnonzero((prim >= 0) & (rays.distance >= 0))
        order = met.take(prim.take(met).argsort())
        arrived = {name: columns.column(rays.paths, name) for name in ("direction", "t", "prim", "u", "v")}
        arrived |= {"record": rays.record, "ray": rays.ray}
        some = {name: take_rows(column, order) for name, column in arrived.items()}
        count, distance = len(order), np.empty(len(order), np.float32)
        radiance = wp.empty(count, dtype=wp.vec3d, device=device)
        counts = self._launch(
            count,
            WHOLE_GRAIN,
            pixels=columns.empty(trace.Pixels, 0, device),
            sites=rays.sites,
            rays=columns.upload(ArrivedRays, some, device, written=()),
            start=RAY_SAMPLES,
            samples=0,
            sums=columns.empty(add_samples.Sums, 0, device),
            sums_out=columns.empty(add_samples.Sums, 0, device),
            hit_out=columns.integers(0, device),
            radiance_out=radiance,
            distance_out=columns.array_over(distance, wp.float32, device),
        )
        if counts[indirect_light.SPOILT]:
            return None
        brought, reach = np.zeros((len(prim), 3)), rays.distance.copy()
        put_rows(brought, order, radiance.numpy())
        put_rows(reach, order, distance)
        return RaysTracedWhole(brought, reach, counts)

    def _launch(self, count: int, grain: int, **arguments: Any) -> Counts:
        """Launch trace_samples for some pixels or rays.

        Args:
            grain: of these that are worth a chunk of their own.
            arguments: of the kernel that are the same for all chunks, and that not all launches share.

        Returns:
            what was counted.
        """
        replica, view = self._replica, self._view
        device, shots = replica.launcher.device, view.light_samples
        arguments |= {
            "scene": self._scene,
            "trees": self._trees,
            "known": self._known_light(),
            "orders": replica.orders(shots, asks=self._asks),
        }
        # Of one vertex at a time, and each launch has its own: they run at once.
        rows, launches, notes = {"seen": 1, "queries": 1, "coats": 1, "shots": shots, "paths": 1}, [], []
        names, _ = arguments_of(replica.kernels.trace_samples)
        for first, size in replica.launcher.chunks(count, grain):
            scratch = columns.empty_nested(vertices.Shaded, rows, device)
            notes.append(_blank_notes(device))
            of_chunk = arguments | {"first": first, "end": first + size, "scratch": scratch, "notes": notes[-1]}
            launches.append((1, [of_chunk[name] for name in names]))
        replica.launcher.run(replica.kernels.trace_samples, launches)
        return sum((each.counts.numpy().astype(np.int64) for each in notes), NO_COUNTS)

    @property
    def _asks(self) -> bool:
        """Whether some vertices may ask photons themselves."""
        world, view = self._replica.world, self._view
        if view.diffuse_light is DiffuseLight.FINAL_GATHER:
            return bool(world.caustic_map.paths) or world.features.coated or view.max_depth is not None
        return view.diffuse_light is DiffuseLight.PHOTON_MAP

    def _known_light(self) -> Any:
        """What is known of indirect light (kernels.whole_samples.indirect_light.KnownLight); it is made once."""
        made_of, known = self._known
        now = [*self._store.maps, self._store.irradiance, self._replica.records]
        if known is None or any(one is not other for one, other in zip(now, made_of, strict=True)):
            known = self._find_out()
            self._known = now, known
        return known

    def _find_out(self) -> Any:
        replica, store, view = self._replica, self._store, self._view
        known = indirect_light.KnownLight()
        known.lambertian_sides = wp.array(replica.lambertian_sides, dtype=wp.int32, device=replica.launcher.device)
        if self._asks:
            if not replica.world.gathers_ahead:
                known.global_map = self._gathered(GLOBAL_MAP, view.k)
            known.caustic_map = self._gathered(CAUSTIC_MAP, view.caustic_k)
        if view.diffuse_light is DiffuseLight.FINAL_GATHER:
            plan = replica.world.irradiance
            known.reach, known.longest = plan.reach, plan.longest
            if store.irradiance is not None:
                known.read_ahead, known.points = 1, store.irradiance
            if replica.cache is not None:
                known.interpolates, known.records = 1, replica.cache
                known.rounds, known.wanted = view.cache.rounds, view.cache.wanted
        return known

    def _gathered(self, number: int, k: int) -> Any:
        """A map that vertices ask (kernels.whole_samples.indirect_light.GatheredMap)."""
        found, plan = indirect_light.GatheredMap(), self._replica.world.maps[number]
        built = self._store.built(number)
        if built is not None:
            found.there, found.photons, found.edges = 1, built.tree, built.edges
            found.points = self._store.points[number]
            found.k, found.k_of_rays = k, fewer_of_rays(k)
            found.r_max, found.r_least = plan.radius, least_of(plan, self._replica.world)
            found.point_area, found.scale = plan.point_area, 1.0 / plan.paths
        return found

    @property
    def _view(self) -> View:
        if self._replica.view is None:
            raise ValueError("samples were to be traced before a view was set")
        return self._replica.view


def add_counts(counts: Counts, gathers: PhotonGatherCounters, final_gather: FinalGatherCounters) -> None:
    """Count what samples did, all but their vertices, now that they are not rendered again."""
    gathers.gathers += int(counts[indirect_light.GATHERS])
    gathers.truncated += int(counts[indirect_light.TRUNCATED])
    final_gather.rays += int(counts[indirect_light.RAYS])
    final_gather.short += int(counts[indirect_light.SHORT])
    final_gather.unread += int(counts[indirect_light.UNREAD])
    final_gather.interpolated += int(counts[indirect_light.INTERPOLATED])
    final_gather.uncovered += int(counts[indirect_light.UNCOVERED])


def _blank_notes(device: str) -> Any:
    notes, maps = indirect_light.Notes(), int(indirect_light.GATHERED_MAPS)
    notes.counts = wp.zeros(int(indirect_light.COUNTS), dtype=wp.int32, device=device)
    notes.radius = wp.zeros(maps, dtype=wp.float32, device=device)
    notes.place = wp.zeros(maps, dtype=wp.vec3, device=device)
    return notes
