"""The photons of a cell: its own, copies of its neighbours' in its band, and the maps that are made of them."""

from __future__ import annotations

import functools
import itertools
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Batch, Kind, concatenate, take, zeros
from wdpm.cluster.host_cache import CacheEntry
from wdpm.cluster.rows import take_rows
from wdpm.cluster.work import tree_orders
from wdpm.cluster.work.guards import PHOTON, Guards
from wdpm.cluster.work.overlap_band import Region, along, rows_in_bands, rows_near
from wdpm.cluster.work.photon_buffers import ColumnBuffer, MapBuffers, Numbered, PositionsOf
from wdpm.cluster.work.reflected_light import GATHER_GRAIN, GATHER_RUN, Places, Reflected, Walled, by_white, of_white
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.work.surface_points import PointSpreader
from wdpm.cluster.work.tally import no_photons
from wdpm.kernels import columns
from wdpm.kernels.irradiance import at_photons
from wdpm.kernels.limits import MAPS
from wdpm.kernels.photons import photon_map
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP, Deposits
from wdpm.kernels.photons.flight import BOUNCE_BITS
from wdpm.kernels.photons.gather_at_photons import gather_at_photons
from wdpm.kernels.photons.kd_order import over
from wdpm.kernels.photons.surface_points import least_radius
from wdpm.kernels.rays import cells
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.instance_areas import InstanceAreas
from wdpm.kernels.rays.two_level import Trees
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.arrays import Triangles

CARRIED = ("id", "position", "normal", "front")
"""What is kept of photons that carry irradiance, until that is worked out."""

SURFACE_MAPS = (int(GLOBAL_MAP), int(CAUSTIC_MAP))
"""Those whose gathers divide by a measured area."""


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
        trees: of its triangles.
        surfaces: its triangles on the device.
        triangles: the same as they came; of them, the instances and what area comes before each are kept.
    """

    def __init__(self, cell: int, trees: Trees, surfaces: Surfaces, triangles: Triangles, replica: Replica) -> None:
        self._cell = cell
        self._replica = replica
        self._geometry = trees, surfaces
        self.instance_areas = InstanceAreas(triangles.instances, surfaces.instances, replica.launcher)
        self._spreader = PointSpreader(
            cell, surfaces, triangles.area_before, triangles.instances, self.instance_areas, replica
        )
        self._own = MapBuffers(Kind.GHOST_PHOTONS)
        self._copies = MapBuffers(Kind.GHOST_PHOTONS)
        self._ghosts = MapBuffers(Kind.GHOST_PHOTONS)
        self._lent: Any = None
        self._some_missing = False
        self._numbered: dict[int, Numbered] = {}
        self._deposits: Any = None
        self._own_points = MapBuffers(Kind.GHOST_POINTS)
        self._points_ahead: Future[list[Sequence[Any]]] | None = None  # their trees, if they were begun before photons
        self._ghost_points = MapBuffers(Kind.GHOST_POINTS)
        self.maps: list[BuiltMap | None] = [None] * MAPS
        self.points: list[Any] = [None] * MAPS
        self.irradiance: Any = None
        self._sites: Arrays = {}
        self._carriers = 0
        self._region: Region | None = None  # where irradiance is worked out here, if not everywhere
        self._order_parts: list[Arrays] = []
        self._irradiance_parts: list[Arrays] = []  # of this store first, once it has one
        self.irradiance_count = 0
        self.irradiance_s = 0.0
        self.count = np.zeros(MAPS, np.int64)
        self.copy_count = np.zeros(MAPS, np.int64)
        self.ghost_count = np.zeros(MAPS, np.int64)
        self.guards = Guards(replica)
        self.counters = no_photons(len(replica.world.lights.names))

    def room(self, capacity: int, chunks: int) -> Any:
        """Room for photons, used again from launch to launch: fresh memory costs as much as the photons in it."""
        device = self._replica.launcher.device
        if self._deposits is None or len(self._deposits.photons.id) < capacity * chunks:
            self._deposits = columns.empty_nested(Deposits, {"photons": capacity * chunks}, device)
        self._deposits.capacity = capacity
        self._deposits.count = wp.zeros(chunks, dtype=wp.int32, device=device)
        return self._deposits

    def keep(self, deposits: Any, capacity: int) -> None:
        """Take stored photons out of the regions of a launch."""
        names = [*SCHEMAS[Kind.GHOST_PHOTONS], "light"]
        kept = [(chunk * capacity, min(int(asked), capacity)) for chunk, asked in enumerate(deposits.count.numpy())]
        for photons in columns.download_parts(deposits.photons, names, [part for part in kept if part[1]]):
            light = photons.pop("light")
            there = np.isfinite(photons["flux"])
            if not there.all():
                finite = there.all(axis=1)
                bad, number = np.flatnonzero(~finite), photons["id"]
                bounce = number[bad] & ((1 << BOUNCE_BITS) - 1)
                self.guards.act_on_photons(PHOTON, number[bad] >> BOUNCE_BITS, bounce, light[bad])
                photons, light = take(photons, np.flatnonzero(finite)), light[finite]
            self._own.add(photons)
            self.count += self.counters.add(photons, light)

    def add_copies(self, photons: Arrays, lender: int) -> None:
        """Take in photons of this cell that landed in another team. They are counted there.

        Args:
            photons: none where they lie in memory that all share.
            lender: number of the worker that they come from.
        """
        if len(photons["map"]) or not self._replica.host_cache.is_shared:
            self._copies.add(photons)
            self.copy_count += np.bincount(photons["map"], minlength=MAPS)
            return
        try:
            lent = self._replica.host_cache.borrow(self._cache_name(f"photons of {lender}"))
            self._some_missing |= lent is None
            self.copy_count += self._copies.borrow(lent or {})
        except ValueError:  # of a process that is not what it says it is
            self._some_missing = True

    def lend(self) -> bool:
        """Have all workers of this machine read the photons that landed here where they lie, if that can be."""
        name = self._cache_name(f"photons of {self._replica.worker}")
        # None at all, sent, would be taken to lie there: others, who found nothing, would trace every path themselves.
        self._lent = self._replica.host_cache.lend(name, self._own.columns, surely=not self._own.nbytes)
        return self._lent is not None

    def so_far(self) -> Arrays:
        """The photons that landed here so far; only before the maps are built."""
        return self._own.whole()

    def region(self, corners: NDArray[np.float32]) -> Region:
        """A region of protocol.BuildMaps; pad covers what positions and distances are off by."""
        low, high = corners
        return Region(low, high, self._replica.world.global_map.radius + 2 * self._replica.pad)

    def work_in(self, region: Region) -> None:
        """Work out irradiance in a region alone, and let go of photons that this takes not; others do the rest."""
        self._region = region
        landed = self._own.whole()
        self._own.clear()
        self._own.add(region.photons(landed, GLOBAL_MAP))

    def built(self, number: int) -> BuiltMap | None:
        """A map that may be read anywhere in this cell; None if there is none."""
        if number == GLOBAL_MAP and self._region is not None:
            raise AssertionError("the global map was taken for one that is read ahead alone")
        return self.maps[number]

    def add_ghosts(self, batch: Batch) -> None:
        """Take in copies of a neighbour's photons, or of its surface points."""
        if batch.kind is Kind.GHOST_POINTS:
            self._ghost_points.add(batch.arrays)
        else:
            self._ghosts.add(batch.arrays)
            self.ghost_count += np.bincount(batch.arrays["map"], minlength=MAPS)

    def ghosts(self) -> Iterator[Batch]:
        """For every other cell, the photons and surface points that lie in its band: two batches, even if empty."""
        replica, world = self._replica, self._replica.world
        low, high = cells.cell_boxes(world.top_tree.axis, world.top_tree.split)
        self._own.join(self._copies)
        if replica.host_cache.is_shared:
            return  # there is no other cell, and points are spread by whoever makes their tree
        if self._points_ahead is None:
            self._spread_points(SURFACE_MAPS)
        if len(low) == 1:
            return
        copied = [(Kind.GHOST_PHOTONS, self._own), (Kind.GHOST_POINTS, self._own_points)]
        # Distances are rounded, and photons lie a rounding off their surfaces: pad covers both.
        bands = [plan.band + replica.pad if plan.paths else 0.0 for plan in world.maps]
        for cell in range(len(low)):
            if cell != self._cell:
                near = functools.partial(rows_in_bands, low[cell], high[cell], bands)
                for kind, buffers in copied:
                    yield Batch.of_task(kind, -1, replica.worker, cell, 0, buffers.chosen(near))

    def begin_points(self) -> None:
        """Spread surface points and build their trees from now on, on a thread of its own, while photons are traced.

        For who has the whole scene and shares no trees: points do not depend on photons, which take longer.
        """
        if self._points_ahead is None and self._replica.launcher.threads > 1:
            self._points_ahead = self._replica.launcher.begin(self._points_made)

    def _points_made(self) -> list[Sequence[Any]]:
        self._spread_points(SURFACE_MAPS)
        return self._replica.host_cache.get_all([self._point_tree(number, None) for number in SURFACE_MAPS])

    def _spread_points(self, of_maps: Sequence[int]) -> None:
        """Spread surface points over this cell and keep them: for each of these maps as many as suit it."""
        plans = {number: self._replica.world.maps[number] for number in of_maps}
        used = {number: plan for number, plan in plans.items() if plan.paths and plan.read}
        for number, position, normal in self._spreader.spread(used):
            region = self._region if number == GLOBAL_MAP else None
            near = None if region is None else region.near(position)
            self._own_points[number].add({"position": position, "normal": normal}, near)

    def sort(self, part: int, parts: int) -> Arrays | None:
        """Sort a part of the trees for all who hold this cell, and own it whole; None if that is not worth it.

        Photons and points are all here then, but those of no other cell.
        """
        of_photons, of_points = self._read_maps(), SURFACE_MAPS
        counts = [len(self._own[number]) for number in of_photons] + [len(self._own_points[n]) for n in of_points]
        shared = self._replica.host_cache.is_shared
        if shared or self._region is not None or not tree_orders.worth_sharing(counts, parts):
            return None
        self._deposits = None
        self._number(of_photons)
        positions = [PositionsOf(self._own[number], self._numbered[number]) for number in of_photons]
        positions += [PositionsOf(self._own_points[number]) for number in of_points]
        found = tree_orders.sort_part(positions, part, parts, self._replica.launcher.build_launcher())
        self.add_order(found)
        return found

    def add_order(self, part: Arrays) -> None:
        """Take in what somebody has sorted."""
        self._order_parts.append(part)

    def build(self, part: int = 0, parts: int = 1) -> None:
        """Build the trees of photons and of surface points, own and ghosts, and let go of what they are built from.

        Irradiance is worked out at one of so many parts of the photons that carry it; the others come from others.
        """
        self._own.join(self._ghosts)
        self._own_points.join(self._ghost_points)
        self._deposits = None
        of_photons, of_points = self._read_maps(), SURFACE_MAPS
        counts = [len(self._own[number]) for number in of_photons] + [len(self._own_points[n]) for n in of_points]
        orders: Sequence[NDArray[np.int32] | None] = [None] * len(counts)
        if self._order_parts:
            orders = tree_orders.joined(self._order_parts, counts)
        self._order_parts = []
        trees = [self._photon_tree(*each) for each in zip(of_photons, orders, strict=False)]
        others = [self._point_tree(*each) for each in zip(of_points, orders[len(of_photons) :], strict=True)]
        got = self._made(trees, others, part)
        self._own.clear()
        self._own_points.clear()
        sites: Arrays = {}
        for number, (tree, told) in zip(of_photons, got, strict=False):
            edges = told.pop("edges")
            self.maps[number] = BuiltMap(tree, over(edges, wp.int32).to(self._replica.launcher.device))
            sites |= told
        for number, (tree,) in zip(of_points, got[len(of_photons) :], strict=True):
            self.points[number] = tree
        if sites:
            self._compute_irradiance(sites, part, parts)
        if self._region is not None:  # nothing else reads what is a part of a map
            self.maps[GLOBAL_MAP], self.points[GLOBAL_MAP] = None, None

    def _made(self, trees: list[CacheEntry], others: list[CacheEntry], part: int) -> list[Sequence[Any]]:
        """Trees of photons and of points: at once, or on one thread one after the other, when photons go before."""
        host_cache, launcher = self._replica.host_cache, self._replica.launcher
        if host_cache.is_shared:
            return host_cache.get_all([*trees, *others], part)

        def of_photons() -> list[Sequence[Any]]:
            made = host_cache.get_all(trees)
            self._own.clear()
            return made

        ahead, self._points_ahead = self._points_ahead, None
        of_points = functools.partial(host_cache.get_all, others) if ahead is None else ahead.result
        return list(itertools.chain(*launcher.at_once(of_photons, of_points)))

    def _photon_tree(self, number: int, order: NDArray[np.int32] | None) -> CacheEntry:
        """The tree of a map; the edges of its photons' paths, and those of them that carry irradiance, in order."""

        def make() -> list[Any]:
            if self._some_missing:
                self._some_missing = False
                self._own.clear()
                self._replica.trace_all()
            self._number([number])
            launcher, numbered = self._replica.launcher, self._numbered.pop(number)
            run = launcher.build_launcher()
            sites = self._sites if number == GLOBAL_MAP else {}
            # Of volume photons the normal is (medium, 0, 0).
            tree, in_order = launcher.at_once(
                lambda: photon_map.build_of(self._own[number], numbered.ranks, launcher.device, run, order),
                lambda: self._in_order(sites),
            )
            return [tree, {"edges": numbered.edges, **in_order}]

        kinds = (photon_map.PhotonMap, dict)
        return CacheEntry(self._cache_name(f"map {number}"), kinds, make, self._is_private(number))

    def _point_tree(self, number: int, order: NDArray[np.int32] | None) -> CacheEntry:
        """The tree of the surface points of a map."""

        def make() -> list[Any]:
            launcher = self._replica.launcher
            if self._replica.host_cache.is_shared:
                self._spread_points([number])
            run = launcher.build_launcher()
            return [photon_map.build_points(self._own_points[number], launcher.device, run, order)]

        return CacheEntry(self._cache_name(f"points {number}"), (photon_map.PhotonMap,), make, self._is_private(number))

    def _is_private(self, number: int) -> bool:
        """Whether a map has but the photons near a part of space, and nobody else the same."""
        return number == GLOBAL_MAP and self._region is not None

    def _cache_name(self, what: str) -> str:
        """A name for what depends on the photons."""
        return f"{what} of {self._replica.world.photon_plan}"

    def _in_order(self, sites: Arrays) -> Arrays:
        """Photons that carry irradiance in an order that all who hold the cell have.

        By number first. Then neighbours one after another: the search for one begins with the radius of the one before.
        """
        if not sites:
            return {}
        by_number = np.argsort(sites["id"])
        order = by_number[np.lexsort(along(sites["position"][by_number], self._replica.world.global_map.radius))]
        return {name: column[order] for name, column in sites.items()}

    def _read_maps(self) -> list[int]:
        """Numbers of the maps that are read."""
        return [number for number, plan in enumerate(self._replica.world.maps) if plan.paths and plan.read]

    def _number(self, of_maps: Sequence[int]) -> None:
        """Find out in which order the photons of some maps are by their ids, of which no more is needed then."""
        for number in of_maps:
            if number in self._numbered:
                continue
            buffer = self._own[number]
            photon_map.check(buffer)
            carries = number == GLOBAL_MAP and self._replica.world.irradiance.share
            chosen = self._carriers_among(buffer) if carries else None
            self._numbered[number] = numbered = Numbered(buffer)
            if chosen is not None:
                ranks = [rank[rows] for rank, (rows, _) in zip(numbered.ranks, chosen, strict=True)]
                self._sites = {name: buffer.joined(name, [each[name] for _, each in chosen]) for name in CARRIED}
                self._sites["rank"] = np.concatenate([np.empty(0, np.int32), *ranks])

    def _carriers_among(self, buffer: ColumnBuffer) -> list[tuple[NDArray[np.intp], Arrays]]:
        """Of each chunk, those that carry irradiance which gather rays of this cell may read: rows and columns."""
        world, pad = self._replica.world, self._replica.pad
        low, high = cells.cell_boxes(world.top_tree.axis, world.top_tree.split)
        found: list[tuple[NDArray[np.intp], Arrays]] = []
        for chunk in buffer.peek():
            position = chunk["position"]
            if self._region is None:
                rows = rows_near(position, low[self._cell], high[self._cell], world.irradiance.reach + pad)
            else:
                rows = self._region.within(position)
            rows = rows[at_photons.chosen(chunk["id"][rows], world.irradiance.share)]
            found.append((rows, {name: take_rows(chunk[name], rows) for name in CARRIED}))
        return found

    def irradiance_part(self) -> Arrays:
        """What was worked out here, as COPIED_IRRADIANCE."""
        return self._irradiance_parts[0] if self._irradiance_parts else zeros(Kind.COPIED_IRRADIANCE)

    def add_irradiance(self, part: Arrays) -> None:
        """Take in what was worked out elsewhere. It may come before this store has built its maps."""
        self._irradiance_parts.append(part)

    def finish(self) -> None:
        """Build the tree of irradiance: all parts are here, so everyone has mapped the photons that were lent."""
        self._lent = None
        points, self._irradiance_parts = concatenate(self._irradiance_parts, Kind.COPIED_IRRADIANCE), []
        count = len(points["id"])
        if self._region is None and count != self._carriers:
            raise ProtocolError(f"irradiance came for {count} photons of cell {self._cell}; expected {self._carriers}")
        if not count:
            return
        began = time.perf_counter()
        launcher = self._replica.launcher

        def make() -> list[Any]:
            position, radiance, grazing, normal = (points[n] for n in ("position", "radiance", "grazing", "normal"))
            others = points["radius"], points["room"], points["id"], launcher.device, launcher.build_launcher()
            return [at_photons.build(position, radiance, grazing, normal, *others)]

        tree = CacheEntry(self._cache_name("irradiance"), (photon_map.PhotonMap,), make)
        (self.irradiance,) = self._replica.host_cache.get(tree)
        self.irradiance_s += time.perf_counter() - began

    def _compute_irradiance(self, photons: Arrays, part: int, parts: int) -> None:
        """Estimate what reaches the surface at some photons, own ones and all that gather rays of this cell may read.

        The photons about a ghost within reach are all here, since the band is that much wider than the radius: its
        estimate is the same, bit for bit, as in the cell that owns it.

        Args:
            photons: as `_in_order` has them.
        """
        began = time.perf_counter()
        replica, world = self._replica, self._replica.world
        plan, launcher = world.global_map, replica.launcher
        self._carriers = whole = len(photons["id"])
        if self._region is None:
            photons = take(photons, slice(whole * part // parts, whole * (part + 1) // parts))
        count, device = len(photons["id"]), launcher.device
        facing = np.where(photons["front"][:, None] == 1, photons["normal"], -photons["normal"])
        position, normal, front = (
            columns.array_over(a, wp.vec3, device) for a in (photons["position"], photons["normal"], facing)
        )
        rank = columns.array_over(photons["rank"], wp.int32, device)
        irradiance = wp.empty(count, dtype=wp.vec3, device=device)
        radius = wp.empty(count, dtype=wp.float32, device=device)
        grazing = wp.empty(count if self._grazes else 0, dtype=wp.float32, device=device)
        launcher(
            gather_at_photons,
            -(-count // GATHER_RUN),
            grain=GATHER_GRAIN,
            photons=self.maps[GLOBAL_MAP].tree,
            rank=rank,
            position=position,
            normal=normal,
            k=world.irradiance.k,
            r_max=plan.radius,
            r_least=least_radius(plan.point_area, plan.radius),
            share=world.irradiance.share,
            reach=world.irradiance.reach,
            run=GATHER_RUN,
            irradiance_out=irradiance,
            radius_out=radius,
            grazing_out=grazing,
        )
        places = Places(position, normal, front)
        radiance = by_white(irradiance, radius, self.points[GLOBAL_MAP], plan, places, launcher)
        light = Reflected(radiance, grazing.numpy())
        trees = self.maps[GLOBAL_MAP].tree, self.points[GLOBAL_MAP]
        walled = Walled(replica.kernels.feel_for_walls, *self._geometry, *trees, rank, plan, world.irradiance)
        told = walled.gather(places, radius, light, launcher)
        light = self._with_caustics(Reflected(told["radiance"], told["grazing"]), places)
        self.irradiance_count = count
        own = {**{name: photons[name] for name in ("id", "position", "normal")}, **told, **vars(light)}
        if not self._grazes:
            own["grazing"] = np.zeros(count, np.float32)
        self._irradiance_parts.insert(0, own)
        self.irradiance_s = time.perf_counter() - began

    @property
    def _grazes(self) -> bool:
        """Whether somebody asks how much light grazes surfaces: where some of them are no Lambertian ones."""
        return self._replica.world.features.coated

    def _with_caustics(self, light: Reflected, places: Places) -> Reflected:
        """What a white Lambertian surface reflects at some places; of the caustic map, too."""
        world, built = self._replica.world, self.maps[CAUSTIC_MAP]
        if built is None or not len(places.position):
            return light
        k, plan, points = world.irradiance.caustic_k, world.caustic_map, self.points[CAUSTIC_MAP]
        return light.with_more(of_white(built.tree, points, plan, k, places, self._grazes, self._replica.launcher))

    def forget(self) -> None:
        """Let go of all photons and what was counted about them."""
        if self._points_ahead is not None:
            wait([self._points_ahead])
            self._points_ahead = None
        for buffers in (self._own, self._copies, self._ghosts, self._own_points, self._ghost_points):
            buffers.clear()
        self._lent, self._some_missing = None, False
        self._numbered, self._sites, self.points = {}, {}, [None] * MAPS
        self.maps = [None] * MAPS
        self.irradiance, self.irradiance_count, self.irradiance_s = None, 0, 0.0
        self._carriers, self._irradiance_parts, self._order_parts = 0, [], []
        self._region = None
        self.count[:] = 0
        self.copy_count[:] = 0
        self.ghost_count[:] = 0
        self.counters.by_light[:] = 0
        self.counters.flux_by_light[:] = 0.0
        self.guards.counts.clear()
