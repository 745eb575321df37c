"""Final gathering in one cell: what the diffuse part of each vertex does, and what gather rays read (Jensen 1996).

A camera path that leaves a surface by its diffuse part is a gather ray. Where it arrives, light straight from lights is
found by a shadow ray, and the irradiance of all other light, caustics included, has been computed ahead at some of the
photons (Christensen 1999): the nearest one is read. Photons straight from the lights would be most of all, and lie
where these shine: under a lamp that lights a room by way of its ceiling few would be left for the room.

A ray that is shorter than the radius of that estimate would see it blurred, in corners above all: it goes on for one
more bounce instead, as does one that finds none within reach, for as long as it takes. With an irradiance cache, gather
rays start from its records, and elsewhere only where no record is near. And where rays would go on records are read,
if there are any: those of earlier rounds tell those of later ones. What a bounce brings is one sample of all the light
of a place, and in corners a third of a record's rays are short.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.work import parts
from wdpm.cluster.work.photon_store import PhotonStore
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera import vertices
from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.constants import INV_PI
from wdpm.kernels.irradiance.arrivals import ARRIVALS, read_arrivals
from wdpm.kernels.irradiance.at_camera_hits import OF_RECORDS, read_records
from wdpm.kernels.irradiance.at_photons import read_irradiance
from wdpm.kernels.irradiance.cache import interpolate
from wdpm.kernels.irradiance.gather_places import Places, places_of_paths
from wdpm.kernels.limits import RAY_SAMPLES
from wdpm.kernels.rays.cell_triangles import Surfaces


@dataclass
class FinalGatherCounters:
    """What final gathering did, for the report.

    Attributes:
        rays: gather rays that arrived on a surface.
        short: that went on since they were shorter than the estimate's radius, and no record was near.
        unread: that went on since no irradiance was within reach, and no record near.
        interpolated: vertices whose indirect light came from records.
        uncovered: vertices that a record might have served, had there been one near.
        read_s, interpolated_s: wall-clock time of reading the map and the cache [s].
    """

    rays: int = 0
    short: int = 0
    unread: int = 0
    interpolated: int = 0
    uncovered: int = 0
    read_s: float = 0.0
    interpolated_s: float = 0.0


@dataclass(eq=False)
class Actions:
    """What the diffuse parts of some vertices do.

    Attributes:
        codes: TRACE_ON or CACHED of kernels.camera.vertices, int32, shape [N].
        by_photons: which are told by photons: they end gather rays, shape [N].
        by_length: those of them that ask the photons themselves, which know how long their paths are, shape [N].
        radiance: what a white Lambertian surface reflects there, where the code is not TRACE_ON, float32, shape [N, 3].
        grazing: how much that light grazes the surface (kernels.maths.schlick), float32, shape [N].
        length: of the rays that arrived [scene units], float32, shape [N].
    """

    codes: NDArray[np.int32]
    by_photons: NDArray[np.bool_]
    by_length: NDArray[np.bool_]
    radiance: NDArray[np.float32]
    grazing: NDArray[np.float32]
    length: NDArray[np.float32]

    def reflected(self, weight: NDArray[np.float32], coats: Any, among: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Light that even diffuse parts reflect of what was read, float32, shape [N, 3].

        Args:
            weight: of the vertices' queries.
            coats: kernels.camera.vertices.Coats; None where there are none.
            among: the vertices that this is asked of.
        """
        reads = among & (self.codes != int(vertices.TRACE_ON))
        radiance = weight * self.radiance
        if coats is not None:
            radiance *= columns.column(coats, "reflectance")
            by_grazing = np.float32(1.0) + columns.column(coats, "grazing_gain") * self.grazing
            radiance *= np.maximum(np.float32(0.0), by_grazing)[:, None]
        if reads.all():
            return radiance
        return np.where(reads[:, None], radiance, np.float32(0.0)).astype(np.float32)

    def read(self, rows: NDArray[np.intp], told: Arrays, known: NDArray[np.bool_]) -> None:
        """Take what records tell of some of the vertices.

        Args:
            told: "irradiance" and "grazing" of the rows.
            known: which of the rows.
        """
        self.codes[rows[known]] = int(vertices.CACHED)
        self.radiance[rows[known]] = told["irradiance"][known] * np.float32(INV_PI)
        self.grazing[rows[known]] = told["grazing"][known]

    def take(self, rows: NDArray[np.intp]) -> Actions:
        """Those of some vertices, ascending."""
        if len(rows) == len(self.codes):
            return self
        told = self.by_photons[rows], self.by_length[rows]
        return Actions(self.codes[rows], *told, self.radiance[rows], self.grazing[rows], self.length[rows])

    def reaches(self, arrays: Arrays, light_samples: int) -> Iterator[tuple[NDArray[np.intp], Arrays]]:
        """How far gather rays of records went: which rays, and parts for their homes.

        Args:
            arrays: of the paths.
        """
        rows = np.flatnonzero((arrays["sample"] >= RAY_SAMPLES) & (arrays["bounce"] == 1))
        if len(rows):
            how_far = np.zeros((len(rows), 3), np.float32)
            how_far[:, 0] = self.length[rows]
            place = parts.place_of(arrays["bounce"][rows], arrays["diffuse"][rows], parts.REACH, light_samples)
            yield rows, {"slot": arrays["slot"][rows], "place": place, "radiance": how_far}


class FinalGather:
    """Decides about vertices in a cell."""

    def __init__(self, surfaces: Surfaces, store: PhotonStore, replica: Replica) -> None:
        self._surfaces = surfaces
        self._store = store
        self._replica = replica
        self._scene: Any = None
        self.counters = FinalGatherCounters()

    def begin_view(self, scene: Any) -> None:
        """Count anew.

        Args:
            scene: kernels.camera.scene.Scene of the cell.
        """
        self._scene = scene
        self.counters = FinalGatherCounters()

    def decide(self, paths: Any, arrays: Arrays) -> Actions:
        """What the diffuse part of each vertex does.

        Args:
            paths: kernels.camera.paths.Paths with final hits in this cell.
            arrays: the same.
        """
        count = len(arrays["slot"])
        arrived = arrays["diffuse"] > 0
        turns = self._turns()
        if not turns and self._store.irradiance is not None and arrived.all():
            actions, found = self._arrive(self._store.irradiance, paths, arrays)
            self._read_records(paths, arrays, found, actions)
            return actions
        # Records are made for paths of one edge: from others all light is as many edges longer.
        later = arrays["edges"] > 1 if "edges" in arrays else np.zeros(count, np.bool_)
        later &= self._is_too_long(arrays, 1)
        if not turns and self._replica.cache is not None and not arrived.any() and not later.any():
            return self._ask_records(self._replica.cache, paths, arrays)
        places = self._places(paths, count)
        actions = Actions(
            np.full(count, int(vertices.TRACE_ON), np.int32),
            np.zeros(count, np.bool_),
            self._is_too_long(arrays, 0),
            np.zeros((count, 3), np.float32),
            np.zeros(count, np.float32),
            columns.column(places, "length"),
        )
        found = self._read(places, np.flatnonzero(arrived), arrays["diffuse"], actions)
        self._read_records(paths, arrays, found, actions)
        self._interpolate(places, np.flatnonzero(~arrived & ~later), actions)
        return actions

    def _ask_records(self, cache: Any, paths: Any, arrays: Arrays) -> Actions:
        """As _interpolate, of all, for which one kernel does it all.

        Args:
            cache: irradiance records.
            paths, arrays: see decide; without a diffuse scattering so far.
        """
        count = len(arrays["slot"])
        sides = columns.array_over(self._replica.even_sides, wp.int32, self._replica.launcher.device)
        told, seconds = self._tell(read_records, OF_RECORDS, count, cache=cache, sides=sides, paths=paths)
        self.counters.interpolated_s += seconds
        covered = int(np.count_nonzero(told["code"] == int(vertices.CACHED)))
        self.counters.interpolated += covered
        self.counters.uncovered += int(np.count_nonzero(told["asked"])) - covered
        none = np.zeros(count, np.bool_)
        by_length = self._is_too_long(arrays, 0)
        return Actions(told["code"], none, by_length, told["value"], told["grazing"], told["length"])

    def _arrive(self, points: Any, paths: Any, arrays: Arrays) -> tuple[Actions, NDArray[np.bool_]]:
        """As _read, where all are gather rays that have arrived, for which one kernel does it all.

        Args:
            points: irradiance at photons.
            paths, arrays: see decide.
        """
        count, reach = len(arrays["slot"]), self._replica.world.irradiance.reach
        told, seconds = self._tell(read_arrivals, ARRIVALS, count, points=points, paths=paths, reach=reach)
        self.counters.read_s += seconds
        self.counters.rays += count
        reads = told["code"] == np.int32(vertices.CACHED)
        by_length = self._is_too_long(arrays, 0)
        actions = Actions(told["code"], reads, by_length, told["value"], told["grazing"], told["length"])
        return actions, told["found"].astype(np.bool_, copy=False)

    def _tell(self, kernel: Any, outputs: Mapping[str, Any], count: int, **arguments: Any) -> tuple[Arrays, float]:
        """What a kernel tells of hits of this cell, by name, and how long it took [s].

        Args:
            outputs: the type of each.
        """
        launcher = self._replica.launcher
        made = columns.outputs(outputs, count, launcher.device)
        began = time.perf_counter()
        results = {f"{name}_out": array for name, array in made.items()}
        launcher(kernel, count, surfaces=self._surfaces, **arguments, **results)
        return columns.to_host(made), time.perf_counter() - began

    def _turns(self) -> bool:
        """Whether there are sheets whose places are those on their other side."""
        return self._replica.world.features.translucent and self._replica.kernels.light_places is not None

    def _is_too_long(self, arrays: Arrays, onward: int) -> NDArray[np.bool_]:
        """Where light of photons may be of longer paths than there are to be, shape [N].

        Args:
            arrays: of camera paths.
            onward: edges that lie between them and photons.
        """
        count, most = len(arrays["slot"]), self._view.max_depth
        if most is None:
            return np.zeros(count, np.bool_)
        edges = arrays["edges"] if "edges" in arrays else np.ones(count, np.int32)
        longer: NDArray[np.bool_] = edges + (onward + self._replica.world.irradiance.longest) > most
        return longer

    def sites(self, paths: Any, slot: NDArray[np.int32]) -> tuple[NDArray[np.intp], Arrays, NDArray[np.bool_]]:
        """The final hits where a record is wanted.

        Args:
            paths: rays through candidates, as kernels.camera.paths.Paths.

        Returns:
            which, what kernels.ray_fields.SITE says of them, and where records may serve at all, shape [N].
        """
        places = self._places(paths, len(slot))
        serve = self._cacheable(places)
        if self._replica.world.features.media:  # gather rays of records set out in the camera's medium
            serve &= columns.column(paths, "medium") == self._replica.camera.medium
        rows = np.flatnonzero(serve)
        if self._replica.cache is not None and len(rows):
            weight = self._from_cache(places, rows)["weight"]
            rows = rows[weight < np.float32(self._view.cache.wanted)]
        pixel, position = np.float32(self._replica.pixel_width), columns.column(places, "position")[rows]
        across = np.ones(len(rows), np.float32)
        if not self._view.camera.orthographic:
            x, y, z = (position - np.array(self._replica.camera.eye, np.float32)).T
            beyond = columns.column(paths, "bounce")[rows] > 0  # in a mirror at least as far as it is straight
            across = np.where(beyond, np.sqrt(x * x + y * y + z * z), columns.column(paths, "t")[rows])
        return (
            rows,
            {
                "slot": slot[rows],
                "position": position,
                "normal": columns.column(places, "normal")[rows],
                "shading_normal": columns.column(places, "shading_normal")[rows],
                "footprint": pixel * across,
            },
            serve,
        )

    def _read(
        self, places: Any, rays: NDArray[np.intp], diffuse: NDArray[np.int32], actions: Actions
    ) -> NDArray[np.bool_]:
        """Have gather rays that have arrived read irradiance at photons.

        Args:
            diffuse: diffuse scatterings before each vertex.

        Returns:
            the vertices that have any within reach, shape [N].
        """
        points, plan = self._store.irradiance, self._replica.world.irradiance
        within = np.zeros(len(diffuse), np.bool_)
        self.counters.rays += len(rays)
        if points is None or not len(rays):
            return within
        launcher, device = self._replica.launcher, self._replica.launcher.device
        kinds = {"value": wp.vec3, "grazing": wp.float32, "radius": wp.float32, "found": wp.bool}
        made = columns.outputs(kinds, len(rays), device)
        began = time.perf_counter()
        launcher(
            read_irradiance,
            len(rays),
            points=points,
            **self._some(places, ("position", "normal"), rays),
            reach=plan.reach,
            **{f"{name}_out": array for name, array in made.items()},
        )
        self.counters.read_s += time.perf_counter() - began
        value, grazing, radius, found = columns.to_host(made).values()
        near = found.astype(bool)
        long = (actions.length[rays] >= radius) | (diffuse[rays] > 1)
        reads = near & long
        actions.codes[rays[reads]] = int(vertices.CACHED)
        actions.by_photons[rays[reads]] = True
        actions.radiance[rays[reads]] = value[reads]
        actions.grazing[rays[reads]] = grazing[reads]
        within[rays] = near
        return within

    def _read_records(self, paths: Any, arrays: Arrays, found: NDArray[np.bool_], actions: Actions) -> None:
        """Have gather rays that would go on read records, where these tell of the place as well as records ask for.

        What records read was read by others before them, at most one of each round: where light of too long paths might
        be among it, none is read.

        Args:
            found: the vertices that have irradiance at a photon within reach.
        """
        going_on = (arrays["diffuse"] > 0) & (actions.codes == int(vertices.TRACE_ON))
        rows = np.flatnonzero(going_on & ~self._is_too_long(arrays, self._view.cache.rounds))
        if self._replica.cache is not None and len(rows):
            device = self._replica.launcher.device
            places = self._places(columns.chosen(Paths, paths, rows, device), len(rows))
            among = np.flatnonzero(self._cacheable(places))
            told = self._from_cache(places, among)
            known = (told["weight"] > 0) & (told["weight"] >= np.float32(self._view.cache.wanted))
            actions.read(rows[among], told, known)
            going_on[rows[among[known]]] = False
        self.counters.unread += int(np.count_nonzero(going_on & ~found))
        self.counters.short += int(np.count_nonzero(going_on & found))

    def _interpolate(self, places: Any, rows: NDArray[np.intp], actions: Actions) -> None:
        """Decide about vertices that camera paths reach without a diffuse scattering."""
        if self._replica.cache is None or not len(rows):
            return
        rows = rows[self._cacheable(places)[rows]]
        if not len(rows):
            return
        told = self._from_cache(places, rows)
        covered = told["weight"] > 0
        self.counters.interpolated += int(np.count_nonzero(covered))
        self.counters.uncovered += int(np.count_nonzero(~covered))
        actions.read(rows, told, covered)

    def _from_cache(self, places: Any, rows: NDArray[np.intp]) -> Arrays:
        """What records tell: "irradiance" [rows, 3], "grazing" [rows], and their "weight" [rows], float32."""
        launcher, device = self._replica.launcher, self._replica.launcher.device
        kinds = {"irradiance": wp.vec3, "grazing": wp.float32, "weight": wp.float32, "count": wp.int32}
        made = columns.outputs(kinds, len(rows), device)
        began = time.perf_counter()
        launcher(
            interpolate,
            len(rows),
            cache=self._replica.cache,
            **self._some(places, ("position", "shading_normal"), rows),
            **{f"{name}_out": array for name, array in made.items()},
        )
        self.counters.interpolated_s += time.perf_counter() - began
        return columns.to_host({name: made[name] for name in ("irradiance", "grazing", "weight")})

    def _cacheable(self, places: Any) -> NDArray[np.bool_]:
        """Where the diffuse part is even, on the side that it is lit from."""
        material, front = np.divmod(columns.column(places, "side"), 2)
        seen: NDArray[np.bool_] = (self._replica.even_sides[material] & (2 - front)) != 0
        return seen

    def _some(self, places: Any, names: tuple[str, ...], rows: NDArray[np.intp]) -> dict[str, Any]:
        """Some rows of the named columns of places."""
        found = {name: columns.argument(places, name) for name in names}
        if len(rows) == columns.length(places, "position"):
            return found
        return columns.rows_of(found, rows, self._replica.launcher.device)

    def _places(self, paths: Any, count: int) -> Any:
        launcher = self._replica.launcher
        places = columns.empty(Places, count, launcher.device)
        launcher(places_of_paths, count, surfaces=self._surfaces, paths=paths, places_out=places)
        if self._turns():
            launcher(self._replica.kernels.light_places, count, scene=self._scene, paths=paths, places=places)
        return places

    @property
    def _view(self) -> View:
        if self._replica.view is None:
            raise ValueError("a camera path came before a view was set")
        return self._replica.view
