"""Launches of the kernel that follows samples, gather rays and paths: its scene, what it knows, scratch, counts."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.work.photon_gathers import fewer_of_rays, least_of
from wdpm.cluster.work.photon_store import PhotonStore
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera import add_samples, vertices
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.camera.rays import Rays
from wdpm.kernels.irradiance.record_rays import ArrivedRays, Sites
from wdpm.kernels.launch import arguments_of
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.two_level import Trees
from wdpm.kernels.whole_samples import indirect_light, leaving, trace

Counts = NDArray[np.int64]
"""By the numbers of kernels.whole_samples.indirect_light, VERTICES and so on."""

NO_COUNTS: Counts = np.zeros(int(indirect_light.COUNTS), np.int64)


class TraceLaunches:
    """Launches trace_samples in a cell.

    Args:
        trees, surfaces: its triangles on the device.
        store: its photons.

    Attributes:
        replica: that of its worker.
    """

    def __init__(self, trees: Trees, surfaces: Surfaces, store: PhotonStore, replica: Replica) -> None:
        self.replica = replica
        self._trees = trees
        self._surfaces = surfaces
        self._store = store
        self._scene: Any = None
        self._known: tuple[list[Any], Any] = ([], None)  # and what it was made of
        self._scratch: dict[tuple[int, int], tuple[Any, Any]] = {}  # by shadow rays, and by number of the launch

    def begin_view(self, scene: Any) -> None:
        """Look through the replica's view.

        Args:
            scene: kernels.camera.scene.Scene, in the cell.
        """
        self._scene, self._known = scene, ([], None)
        self._scratch.clear()

    def forget_photons(self) -> None:
        """Let go of maps, which nobody is to ask any more: others may be built before the next view."""
        self._known = ([], None)

    @property
    def can_be(self) -> bool:
        """Whether the kernel is there, and nobody looks on."""
        return self.replica.kernels.trace_samples is not None and self.replica.observer is None

    def launch(
        self,
        count: int,
        grain: int,
        of_chunk: Callable[[int, int], dict[str, Any]] | None = None,
        *,
        shots: int | None = None,
        **arguments: Any,
    ) -> list[Counts]:
        """Launch the kernel for some items: pixels, gather rays or paths.

        Args:
            grain: of these that are worth a chunk of their own.
            of_chunk: makes arguments that are of one chunk alone, by its first item and its size.
            shots: shadow rays of a vertex, at most; None for those of first ones.
            arguments: that are the same for all chunks, in place of none, pixel by pixel and ray by ray.

        Returns:
            what was counted, chunk by chunk.
        """
        replica = self.replica
        shots = self._view.light_samples if shots is None else shots
        arguments = {
            **_nothing(replica.launcher.device),
            "scene": self._scene,
            "trees": self._trees,
            "known": self._known_light(),
            "orders": replica.orders(shots, asks=self._asks),
            **arguments,
        }
        launches, notes = [], []
        names, _ = arguments_of(replica.kernels.trace_samples)
        for number, (first, size) in enumerate(replica.launcher.chunks(count, grain)):
            mine = {"first": first, "end": first + size, **(of_chunk(first, size) if of_chunk is not None else {})}
            mine["scratch"], mine["notes"] = self._scratch_of(shots, number)
            notes.append(mine["notes"])
            together = arguments | mine
            launches.append((1, [together[name] for name in names]))
        replica.launcher.run(replica.kernels.trace_samples, launches)
        return [each.counts.numpy().astype(np.int64) for each in notes]

    def _scratch_of(self, shots: int, number: int) -> tuple[Any, Any]:
        """Scratch of one vertex at a time, and blank notes: each of the launches that run at once has its own.

        Args:
            number: of the launch.
        """
        device = self.replica.launcher.device
        scratch, notes = self._scratch.get((shots, number), (None, None))
        if notes is None:
            rows = {"seen": 1, "queries": 1, "coats": 1, "shots": shots, "paths": 1}
            scratch, notes = columns.empty_nested(vertices.Shaded, rows, device), indirect_light.Notes()
            maps = int(indirect_light.GATHERED_MAPS)
            notes.counts = wp.zeros(int(indirect_light.COUNTS), dtype=wp.int32, device=device)
            notes.radius = wp.zeros(maps, dtype=wp.float32, device=device)
            notes.place = wp.zeros(maps, dtype=wp.vec3, device=device)
            self._scratch[shots, number] = scratch, notes
        notes.counts.numpy()[:] = 0  # on the CPU it is the same memory
        notes.radius.numpy()[:] = 0.0
        return scratch, notes

    @property
    def _asks(self) -> bool:
        """Whether some vertices may ask photons themselves."""
        world, view = self.replica.world, self._view
        if view.diffuse_light is DiffuseLight.FINAL_GATHER:
            return bool(world.caustic_map.paths) or world.features.coated or view.max_depth is not None
        return view.diffuse_light is DiffuseLight.PHOTON_MAP

    def _known_light(self) -> Any:
        """What is known of indirect light (kernels.whole_samples.indirect_light.KnownLight); it is made once."""
        made_of, known = self._known
        now = [*self._store.maps, self._store.irradiance, self.replica.records]
        if known is None or any(one is not other for one, other in zip(now, made_of, strict=True)):
            known = self._find_out()
            self._known = now, known
        return known

    def _find_out(self) -> Any:
        replica, store, view = self.replica, self._store, self._view
        known = indirect_light.KnownLight()
        known.even_sides = wp.array(replica.even_sides, dtype=wp.int32, device=replica.launcher.device)
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
        found, plan = indirect_light.GatheredMap(), self.replica.world.maps[number]
        built = self._store.built(number)
        if built is not None:
            found.there, found.photons, found.edges = 1, built.tree, built.edges
            found.points = self._store.points[number]
            found.k, found.k_of_rays = k, fewer_of_rays(k)
            found.r_max, found.r_least = plan.radius, least_of(plan, self.replica.world)
            found.point_area, found.scale = plan.point_area, 1.0 / plan.paths
            found.run, found.asks = self._view.caustic_turn if number == CAUSTIC_MAP else (1, 1)
            found.share = found.run / found.asks
        return found

    @property
    def _view(self) -> View:
        if self.replica.view is None:
            raise ValueError("samples were to be traced before a view was set")
        return self.replica.view


def _nothing(device: str) -> dict[str, Any]:
    """Arguments of the kernel for no item of any kind, of the whole scene."""
    return {
        "pixels": columns.empty(trace.Pixels, 0, device),
        "sites": columns.empty(Sites, 0, device),
        "rays": columns.empty(ArrivedRays, 0, device),
        "paths": columns.empty(Paths, 0, device),
        "camera_rays": columns.empty(Rays, 0, device),
        "together": columns.integers(0, device),
        "cell": int(leaving.WHOLE_SCENE),
        "visits": 0,
        "start": 0,
        "samples": 0,
        "sums": columns.empty(add_samples.Sums, 0, device),
        "leaving_out": _nothing_leaves(device),
        "sums_out": columns.empty(add_samples.Sums, 0, device),
        "hit_out": columns.integers(0, device),
        "radiance_out": _no_radiance(device),
        "distance_out": columns.array_over(np.zeros(0, np.float32), wp.float32, device),
    }


@functools.cache
def _nothing_leaves(device: str) -> Any:
    return columns.empty_nested(leaving.Leaving, {}, device)


@functools.cache
def _no_radiance(device: str) -> Any:
    return wp.zeros(0, dtype=wp.vec3d, device=device)


def sum_of(counts: Sequence[Counts]) -> Counts:
    """What several launches counted together."""
    return sum(counts, NO_COUNTS)
