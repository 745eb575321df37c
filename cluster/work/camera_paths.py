"""Camera samples in one cell: what their rays hit, how that is lit, and where their paths go on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Batch, Kind, by_destination, joined, take, take_in_order
from wdpm.cluster.rows import any_of, take_rows
from wdpm.cluster.runs import Runs
from wdpm.cluster.work import guards, parts
from wdpm.cluster.work.beams import Beams, start_beams
from wdpm.cluster.work.candidates import Candidates
from wdpm.cluster.work.final_gather import Actions, FinalGather
from wdpm.cluster.work.misses import first_cells, missed_light, no_hits, rest_of, start_paths
from wdpm.cluster.work.photon_gathers import PhotonGathering
from wdpm.cluster.work.photon_store import PhotonStore
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.work.shadows import Shadows
from wdpm.cluster.work.whole.brought import brought
from wdpm.cluster.work.whole.launches import Counts, TraceLaunches
from wdpm.cluster.work.whole.samples import RaysTracedWhole, RecordRays, WholeSamples, add_counts
from wdpm.cluster.work.whole.within_cell import FEW_TO_FOLLOW, WithinCell
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera import vertices
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.camera.rays import Rays
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP
from wdpm.kernels.ray_fields import HIT
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.two_level import Trees
from wdpm.kernels.whole_samples.indirect_light import VERTICES
from wdpm.scenes.errors import ProtocolError


class CameraPaths:
    """Traces camera paths through one cell, and finds the light along them.

    Args:
        cell: number of the cell.
        trees, surfaces: its triangles on the device.
        store: its photons.

    Attributes:
        vertices: of camera paths beyond their first surface that were shaded, in this view.
    """

    def __init__(self, cell: int, trees: Trees, surfaces: Surfaces, store: PhotonStore, replica: Replica) -> None:
        self._cell = cell
        self._trees = trees
        self._surfaces = surfaces
        self._store = store
        self._replica = replica
        self._scene: Any = None
        self.guards = guards.Guards(replica)
        self.shadows = Shadows(cell, trees, surfaces, replica, self.guards)
        self.beams = Beams(cell, store, replica, self.guards)
        self.gathering = PhotonGathering(cell, store, replica, self.guards)
        self.final_gather = FinalGather(surfaces, store, replica)
        self._launches = TraceLaunches(trees, surfaces, store, replica)
        self.whole = WholeSamples(self._launches)
        self.within = WithinCell(cell, self._launches)
        self._candidates = Candidates(cell, replica, self.final_gather)
        self.vertices = 0

    def begin_view(self) -> None:
        """Look through the replica's view, and count anew."""
        self._scene = self._replica.scene_of(self._surfaces)
        self.shadows.begin_view(self._scene)
        self.beams.begin_view()
        self.vertices = 0
        self.guards.counts.clear()
        self.gathering.begin_view()
        self.final_gather.begin_view(self._scene)
        self._launches.begin_view(self._scene)
        self.within.begin_view()

    def forget_photons(self) -> None:
        """Let go of what is made of photons."""
        self._launches.forget_photons()

    def trace_rays_whole(self, rays: RecordRays) -> RaysTracedWhole | None:
        """As WholeSamples.trace_rays, for rays as they set out."""
        self._visit(rays.paths, len(rays.distance), fresh=False)
        return self.whole.trace_rays(rays)

    def count_whole(self, counts: Counts) -> None:
        """Count what samples did that were followed to their ends, now that they are not rendered again."""
        self.vertices += int(counts[VERTICES])
        add_counts(counts, self.gathering.counters, self.final_gather.counters)

    # Rays from the camera

    def start_camera(self, batch: Batch) -> Iterator[Batch]:
        """Intersect those camera rays that come here first; send the others to where they do."""
        found = {**batch.arrays, **no_hits(len(batch), self._view)}
        arrays = {name: found[name] for name in SCHEMAS[Kind.CAMERA]}
        rays = columns.upload(Rays, arrays, self._replica.launcher.device, written=())
        follows = self._followed(batch, rays, first=True, together=batch.arrays["together"])
        if follows is not None:
            yield from follows
            return
        unit = parts.credit_of_camera_ray(self._view.light_samples)
        first = first_cells(self._replica, rays, len(batch))
        for cell, rows in by_destination(first, first >= 0):
            sent = Batch(Kind.CAMERA, cell, batch.runs.among(rows).with_unit(unit), take(arrays, rows))
            if cell == self._cell:
                yield from self.visit_camera(sent)
            else:
                yield sent

    def visit_camera(self, batch: Batch) -> Iterator[Batch]:
        """Intersect camera rays; forward those that may find a nearer hit elsewhere."""
        if self.within.can_be:
            fresh = columns.upload(Rays, batch.arrays, self._replica.launcher.device, written=())
            follows = self._followed(batch, fresh, first=True, visits=True)
            if follows is not None:
                yield from follows
                return
        rays, onward = self._intersect(batch.arrays)
        unit = parts.credit_of_camera_ray(self._view.light_samples)
        for cell, rows in by_destination(onward, onward >= 0):
            yield Batch(Kind.CAMERA, cell, batch.runs.among(rows).with_unit(unit), take(rays, rows))
        final = onward < 0
        hit = rays["prim"] >= 0
        for cell, rows in by_destination(rays["owner"], final & hit):
            yield Batch(Kind.SHADE, cell, batch.runs.among(rows).with_unit(unit), take(rays, rows))
        missed = np.flatnonzero(final & ~hit)
        if len(missed):
            runs = batch.runs.among(missed).with_unit(unit)
            yield from missed_light(self._replica, self.guards, runs, self._cell, rays, missed)

    def probe(self, batch: Batch) -> Iterator[Batch]:
        """Intersect camera rays with this cell alone, and tell the home what was hit."""
        rays, _ = self._intersect({**batch.arrays, **no_hits(len(batch), self._view)})
        found = np.flatnonzero(rays["prim"] >= 0)
        hits = {name: rays[name][found] for name in SCHEMAS[Kind.PROBED]}
        yield Batch(Kind.PROBED, self._cell, batch.runs.among(found).with_credit(batch.runs.credit), hits)

    def take_candidates(self, batch: Batch) -> Iterator[Batch]:
        """Take rays that look for places of irradiance records further."""
        return self._candidates.take(batch, self._visit, self._lead_on)

    def _intersect(self, arrays: Arrays) -> tuple[Arrays, NDArray[np.int32]]:
        """Camera rays with their best hits refined by this cell, and the cell that each visits next or -1."""
        replica, count = self._replica, len(arrays["slot"])
        rays = columns.upload(Rays, arrays, replica.launcher.device, HIT)
        onward = self._integers(count)
        replica.launcher(
            replica.kernels.visit_camera_rays,
            count,
            trees=self._trees,
            surfaces=self._surfaces,
            cells=replica.cells,
            camera=replica.camera,
            rays=rays,
            own_cell=self._cell,
            next_cell_out=onward,
        )
        return columns.download(rays, SCHEMAS[Kind.CAMERA]), onward.numpy()

    def shade_camera(self, batch: Batch) -> Iterator[Batch]:
        """Light final hits of camera rays in this cell."""
        kernels, device = self._replica.kernels, self._replica.launcher.device
        rays = columns.upload(Rays, batch.arrays, device, written=())
        follows = self._followed(batch, rays, first=True)
        if follows is not None:
            yield from follows
            return
        if kernels.shade_vertices is None:
            yield from self._shade_hits(batch, kernels.shade_camera_hits, rays, None)
            return
        paths = start_paths(self._replica, rays, len(batch))
        actions = self._decide(paths, {**batch.arrays, "diffuse": np.zeros(len(batch), np.int32)})
        ends = np.zeros(len(batch), np.bool_)
        if actions is not None and kernels.shade_camera_hits is not None:
            ends = actions.codes == int(vertices.CACHED)
        if not ends.any():
            yield from self._shade_hits(batch, kernels.shade_vertices, paths, actions)
            return
        unit = parts.credit_of_camera_ray(self._view.light_samples)
        for kernel, struct, items, chosen in (
            (kernels.shade_camera_hits, Rays, rays, ends),
            (kernels.shade_vertices, Paths, paths, ~ends),
        ):
            rows = np.flatnonzero(chosen)
            if len(rows):
                runs = batch.runs.among(rows).with_unit(unit)
                some = Batch(Kind.SHADE, self._cell, runs, take(batch.arrays, rows))
                few = items if len(rows) == len(batch) else columns.chosen(struct, items, rows, device)
                yield from self._shade_hits(some, kernel, few, None if actions is None else actions.take(rows))

    def _shade_hits(
        self, batch: Batch, kernel: wp.Kernel | None, items: Any, actions: Actions | None
    ) -> Iterator[Batch]:
        """Light some final hits of camera rays.

        Args:
            kernel: kernels.variants shade_camera_hits or shade_vertices.
            items: the hits, as that kernel takes them.
        """
        shaded = self._shade(kernel, items, len(batch), self._view.light_samples, actions)
        follows = list(self._send_on(batch, shaded))
        samples = {
            "slot": batch.arrays["slot"],
            "indirect": self._indirect(shaded, batch.arrays, actions, self._even(shaded, actions)),
            "cell": np.full(len(batch), self._cell, np.int32),
            **columns.download(shaded.seen, ("emission", "depth", "normal", "albedo")),
        }
        for name, cause in (("emission", guards.EMISSION), ("indirect", guards.INDIRECT)):
            samples[name] = self.guards.blacken(samples[name], cause, batch.arrays)
        follows += self._first_caustics(batch, shaded)
        yield Batch(Kind.SAMPLES, self._cell, batch.runs.with_credit(rest_of(batch.runs, follows)), samples)
        yield from follows

    def _first_caustics(self, batch: Batch, shaded: Any) -> list[Batch]:
        """Light of the caustic map at the first surface, in scenes that have one: a part like those further on."""
        if self._replica.world.caustic_map.paths == 0:
            return []
        radiance = self.gathering.reflected(CAUSTIC_MAP, shaded.queries, shaded.coats, batch.arrays)
        none = np.zeros(len(batch), np.int32)
        arrays = {**batch.arrays, "bounce": none, "diffuse": none}
        lit = self._part(batch.runs, arrays, parts.CAUSTIC, radiance)
        return [replace(lit, runs=lit.runs.with_credit(batch.runs.rows))]

    # Paths beyond their first surface

    def visit_paths(self, batch: Batch) -> Iterator[Batch]:
        """Intersect rays of paths; forward those that may find a nearer hit elsewhere.

        Gather rays of a few records end all over a cell. Vertices on the same triangle, or on triangles with like
        numbers, are shaded one after another: what they read (the triangle, irradiance near by, texels, the way to the
        lamps) is then in the processor's caches still. Of few rays all is done at once.
        """
        rays = columns.upload(Paths, batch.arrays, self._replica.launcher.device, HIT)
        follows = self._followed(batch, rays, first=False, visits=True) if len(batch) <= FEW_TO_FOLLOW else None
        if follows is not None:
            yield from follows
            return
        onward = self._visit(rays, len(batch), fresh=False)
        yield from self._sort_out(batch.runs, columns.download(rays, SCHEMAS[Kind.PATH]), onward)

    def start_paths(self, runs: Runs, paths: Any) -> Iterator[Batch]:
        """Send paths on their way, of which those that come to this cell first are intersected at once.

        Args:
            runs: whose they are.
            paths: kernels.camera.paths.Paths as they set out; those that carry nothing end.
        """
        onward = self._visit(paths, int(runs.rows.sum()), fresh=True)
        yield from self._sort_out(runs, columns.download(paths, SCHEMAS[Kind.PATH]), onward)

    def _visit(self, rays: Any, count: int, *, fresh: bool) -> NDArray[np.int32]:
        """The cell that each ray of a path visits next; -1 where its hit, if any, is final; or PATH_ENDED.

        Args:
            rays: kernels.camera.paths.Paths; best hits are refined in place.
            fresh: whether they have been nowhere yet: then this cell is asked only where it is the first.
        """
        replica, onward = self._replica, self._integers(count)
        replica.launcher(
            replica.kernels.visit_paths,
            count,
            trees=self._trees,
            surfaces=self._surfaces,
            cells=replica.cells,
            paths=rays,
            own_cell=self._cell,
            fresh=int(fresh),
            next_cell_out=onward,
        )
        next_cells: NDArray[np.int32] = onward.numpy()
        return next_cells

    def _sort_out(self, runs: Runs, paths: Arrays, onward: NDArray[np.int32]) -> Iterator[Batch]:
        """Send rays that this cell has been asked about where they are to go.

        Args:
            onward: as _visit tells it.
        """
        final, hit = onward == _FINAL, paths["prim"] >= 0
        yield from self._send_paths(runs, paths, onward)
        yield from self._send_vertices(runs, paths, final & hit)
        missed = np.flatnonzero(final & ~hit)
        if len(missed):
            left = self._with_credit(runs.among(missed), paths["bounce"][missed])
            yield from missed_light(self._replica, self.guards, left, self._cell, paths, missed)

    def shade_vertices(self, batch: Batch) -> Iterator[Batch]:
        """Light final hits of paths in this cell."""
        arrays = batch.arrays
        rays = columns.upload(Paths, arrays, self._replica.launcher.device, written=())
        followed = self._followed(batch, rays, first=False)
        if followed is not None:
            yield from followed
            return
        self.vertices += len(batch)
        actions = self._decide(rays, arrays)
        shaded = self._shade(self._replica.kernels.shade_vertices, rays, len(batch), int(vertices.SHOTS_LATER), actions)
        follows = list(self._send_on(batch, shaded))
        reaches = () if actions is None else actions.reaches(arrays, self._view.light_samples)
        even = self._even(shaded, actions)
        seen = {
            parts.EMISSION: columns.column(shaded.seen, "emission"),
            parts.INDIRECT: self._indirect(shaded, arrays, actions, even),
        }
        if self._replica.world.caustic_map.paths:
            seen[parts.CAUSTIC] = self._later_caustics(shaded, arrays, actions, even)
        lit_parts = [self._part(batch.runs, arrays, part, light) for part, light in seen.items()]
        lit_parts += [Batch(Kind.LIT, self._cell, batch.runs.among(rows), reach) for rows, reach in reaches]
        lit = joined(lit_parts)
        yield replace(lit, runs=lit.runs.with_credit(rest_of(batch.runs, follows)))
        yield from follows

    def _followed(self, batch: Batch, paths: Any, **how: Any) -> Iterator[Batch] | None:
        """What follows from paths that are followed as far as this cell reaches.

        Args:
            paths, how: of the batch, as WithinCell.follow takes them.

        Returns:
            None where they cannot be, or guards are to count what happens: it is then to be found vertex by vertex.
        """
        followed = self.within.follow(paths, len(batch), **how) if self.within.can_be else None
        if followed is None:
            return None
        self.count_whole(followed.counts)
        return brought(self._cell, batch.runs, followed, self.shadows, self._view.light_samples)

    def _decide(self, paths: Any, arrays: Arrays) -> Actions | None:
        """What the diffuse part of each vertex does, in views that leave a choice."""
        by_rays = self._view.diffuse_light is DiffuseLight.FINAL_GATHER
        return self.final_gather.decide(paths, arrays) if by_rays else None

    def _indirect(
        self, shaded: Any, arrays: Arrays, actions: Actions | None, even: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """Indirect light that is known at the vertices themselves, by photons or by what was computed from them."""
        if actions is None:
            return self.gathering.reflected(GLOBAL_MAP, shaded.queries, shaded.coats, arrays)
        # What other surfaces reflect depends on where the light comes from: these vertices ask the photons themselves.
        asks = actions.by_photons & (~even | actions.by_length)
        coats = shaded.coats if self._replica.world.features.coated else None
        radiance = actions.reflected(columns.column(shaded.queries, "weight"), coats, even & ~asks)
        if asks.any():
            radiance += self.gathering.reflected(GLOBAL_MAP, shaded.queries, shaded.coats, arrays, asks)
        return radiance

    def _later_caustics(
        self, shaded: Any, arrays: Arrays, actions: Actions | None, even: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """Light of the caustic map beyond the first surface; irradiance that was computed ahead has it in it."""
        asks = None if actions is None else ~(actions.by_photons & even & ~actions.by_length)
        return self.gathering.reflected(CAUSTIC_MAP, shaded.queries, shaded.coats, arrays, asks)

    def _even(self, shaded: Any, actions: Actions | None) -> NDArray[np.bool_]:
        """Of which vertices irradiance tells what the diffuse part reflects, shape [N]; of none where nobody asks."""
        if actions is None:
            return np.zeros(0, np.bool_)
        if not self._replica.world.features.coated:
            return np.ones(len(actions.codes), np.bool_)
        return columns.column(shaded.coats, "even")

    def _part(self, runs: Runs, arrays: Arrays, part: int, radiance: NDArray[np.float32]) -> Batch:
        """One part of each vertex, where it is not black, without credit."""
        radiance = self.guards.blacken(radiance, _CAUSE[part], arrays)
        rows = np.flatnonzero(any_of(radiance))
        place = parts.place_of(arrays["bounce"][rows], arrays["diffuse"][rows], part, self._view.light_samples)
        lit = {"slot": arrays["slot"][rows], "place": place, "radiance": take_rows(radiance, rows)}
        return Batch(Kind.LIT, self._cell, runs.among(rows), lit)

    def _shade(
        self, kernel: wp.Kernel | None, rays: Any, count: int, shots: int, does: Actions | None, *, looks: bool = False
    ) -> Any:
        """Run a kernel that shades vertices; returns kernels.camera.vertices.Shaded.

        Args:
            shots: shadow rays of each vertex.
            does: actions of each vertex (kernels.camera.shading); None where the view's diffuse light needs none.
            looks: whether rays only look where samples will come to.
        """
        if kernel is None:
            raise ProtocolError("a camera path goes on in a scene where none does")
        replica = self._replica
        outputs, device = replica.outputs, replica.launcher.device
        ends = kernel is replica.kernels.shade_camera_hits
        counts = {
            "seen": count,
            "queries": count,
            "coats": count if outputs.coated else 0,
            "shots": count * shots,
            "paths": 0 if ends else count,
            "stretches": count if outputs.media else 0,
        }
        shaded = columns.empty_nested(vertices.Shaded, counts, device)
        if ends:
            orders = replica.orders(shots, DiffuseLight.PHOTON_MAP, asks=self._asks(does))
            replica.launcher(kernel, count, scene=self._scene, rays=rays, orders=orders, shaded_out=shaded)
        else:
            orders = replica.orders(shots, asks=self._asks(does))
            codes = np.zeros(0, np.int32) if does is None else does.codes
            replica.launcher(
                kernel,
                count,
                scene=self._scene,
                paths=rays,
                orders=orders,
                actions=columns.array_over(codes, wp.int32, device),
                shaded_out=shaded,
            )
        if replica.observer is not None and not looks:
            replica.observer.shaded(self._scene, orders, rays, shaded)
        return shaded

    def _lead_on(self, paths: Any, count: int) -> Any:
        """Where rays that only look go on, by no diffuse part; None where no ray does."""
        kernel = self._replica.kernels.shade_vertices
        if kernel is None:
            return None
        none, numbers = np.zeros(count, np.bool_), np.zeros(count, np.float32)
        codes = np.full(count, int(vertices.CACHED), np.int32)
        actions = Actions(codes, none, none, np.zeros((count, 3), np.float32), numbers, numbers)
        return self._shade(kernel, paths, count, int(vertices.SHOTS_LATER), actions, looks=True).paths

    def _asks(self, actions: Actions | None) -> bool:
        """Whether photons may be asked for at some of the vertices: as _indirect and the caustics do."""
        world = self._replica.world
        if self._view.diffuse_light is DiffuseLight.PATHS:
            return False
        if actions is None or world.caustic_map.paths or world.features.coated:
            return True
        return bool((actions.by_photons & actions.by_length).any())

    def _send_on(self, cause: Batch, shaded: Any) -> Iterator[Batch]:
        """Everything that vertices start: shadow rays, paths that go on, stretches of medium."""
        features = self._replica.world.features
        yield from self.shadows.start(cause, shaded.shots)
        if columns.are_there(shaded.paths):
            yield from self._start_paths(cause, shaded.paths)
        if features.media:
            yield from start_beams(self._replica, cause.runs, shaded.stretches)

    def _start_paths(self, cause: Batch, going_on: Any) -> Iterator[Batch]:
        """Send rays of paths on their way: most begin where they are, so this cell is asked at once."""
        shaded = columns.download(going_on, ("throughput", "bounce"))
        throughput = self.guards.blacken(shaded["throughput"], guards.THROUGHPUT, cause.arrays)
        if throughput is not shaded["throughput"]:
            going_on.throughput = columns.array_over(throughput, wp.vec3, self._replica.launcher.device)
        # The kernel ends them all there; hardly any has not been ended by Russian roulette long before.
        self.guards.act(guards.PATHS_CUT, np.flatnonzero(shaded["bounce"] >= parts.LAST_BOUNCE), cause.arrays)
        if not throughput.any():
            return
        for batch in self.start_paths(cause.runs, going_on):
            if batch.kind is not Kind.ENDED:  # credit that never sets out goes home with the vertex's own light
                yield batch

    def _send_paths(self, runs: Runs, paths: Arrays, destination: NDArray[np.int32]) -> Iterator[Batch]:
        """Send paths to the cells where they are to go, none where that is negative."""
        for cell, rows in by_destination(destination, destination >= 0):
            sent = take(paths, rows)
            yield Batch(Kind.PATH, cell, self._with_credit(runs.among(rows), sent["bounce"]), sent)

    def _send_vertices(self, runs: Runs, paths: Arrays, chosen: NDArray[np.bool_]) -> Iterator[Batch]:
        """Send the chosen paths to the cells of their hits: those of a task in the order of the triangles."""
        for cell, rows in by_destination(paths["owner"], chosen):
            mine = runs.among(rows)
            sent = take_in_order(paths, rows, "prim", mine)
            yield Batch(Kind.VERTEX, cell, self._with_credit(mine, sent["bounce"]), sent)

    def _with_credit(self, runs: Runs, bounce: NDArray[np.int32]) -> Runs:
        """Runs of paths with the credit that these have."""
        return runs.with_credit(parts.credit_of(runs, bounce, self._view.light_samples))

    # Odds and ends

    @property
    def _view(self) -> View:
        if self._replica.view is None:
            raise ValueError("a camera batch came before a view was set")
        return self._replica.view

    def _integers(self, count: int) -> Any:
        return columns.integers(count, self._replica.launcher.device)


_FINAL: Final = -1
"""In place of the next cell: a ray need not be asked about in any other."""

_CAUSE = {
    parts.EMISSION: guards.EMISSION,
    parts.INDIRECT: guards.INDIRECT,
    parts.CAUSTIC: guards.CAUSTIC,
}
