"""Camera samples in one cell: what their rays hit, how that is lit, and where their paths go on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster import guards, parts
from wdpm.cluster.batch import SCHEMAS, Arrays, Batch, Kind, by_destination, concatenate, take
from wdpm.cluster.beams import beam_light, next_beam_cells, start_beams
from wdpm.cluster.gathering import Gathering
from wdpm.cluster.misses import missed_light, no_hits, start_paths
from wdpm.cluster.photon_store import PhotonStore
from wdpm.cluster.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import beam, columns
from wdpm.kernels import camera_rays as cr
from wdpm.kernels import shading as sh
from wdpm.kernels import shadow_rays as sr
from wdpm.kernels.bvh import Bvh
from wdpm.kernels.photon_paths import CAUSTIC_MAP, GLOBAL_MAP, VOLUME_MAP
from wdpm.kernels.surface import Surfaces
from wdpm.scenes.errors import ProtocolError


@dataclass
class CameraCounters:
    """What camera samples did in a cell, for the report.

    Attributes:
        vertices: of camera paths beyond their first surface.
        beams: stretches of medium.
    """

    vertices: int = 0
    beams: int = 0


@dataclass(eq=False)
class Shaded:
    """What a kernel of shading.py leaves behind: structures of arrays on the device."""

    seen: Any
    queries: Any
    coats: Any
    shots: Any
    paths: Any
    stretches: Any


class CameraLight:
    """Light along camera paths, in one cell.

    Args:
        cell: number of the cell.
        scene: its triangles' tree and surfaces on the device.
        store: its photons.
    """

    def __init__(self, cell: int, tree: Bvh, surfaces: Surfaces, store: PhotonStore, replica: Replica) -> None:
        self._cell = cell
        self._bvh = tree
        self._surfaces = surfaces
        self._store = store
        self._replica = replica
        self.guards = guards.Guards(replica)
        self.gathering = Gathering(cell, store, replica, self.guards)
        self.counters = CameraCounters()

    def begin_view(self) -> None:
        """Count anew."""
        self.counters = CameraCounters()
        self.guards.counts.clear()
        self.gathering.begin_view()

    # Rays from the camera

    def visit_camera(self, batch: Batch) -> Iterator[Batch]:
        """Intersect camera rays; forward those that may find a nearer hit elsewhere."""
        rays, onward = self._intersect(batch.arrays)
        unit = parts.credit_of_camera_ray(self._view.light_samples)
        for cell, rows in by_destination(onward, onward >= 0):
            yield self._batch(batch, Kind.CAMERA, cell, len(rows) * unit, take(rays, rows))
        final = onward < 0
        hit = rays["prim"] >= 0
        for cell, rows in by_destination(rays["owner"], final & hit):
            yield self._batch(batch, Kind.SHADE, cell, len(rows) * unit, take(rays, rows))
        missed = np.flatnonzero(final & ~hit)
        if len(missed):
            rest = take(rays, missed)
            yield from missed_light(self._replica, self.guards, batch, self._cell, rest, len(missed) * unit)

    def probe(self, batch: Batch) -> Iterator[Batch]:
        """Intersect camera rays with this cell alone, and tell the home what was hit."""
        rays, _ = self._intersect({**batch.arrays, **no_hits(len(batch), self._view)})
        found = np.flatnonzero(rays["prim"] >= 0)
        yield self._batch(
            batch, Kind.PROBED, self._cell, batch.credit, {name: rays[name][found] for name in SCHEMAS[Kind.PROBED]}
        )

    def _intersect(self, arrays: Arrays) -> tuple[Arrays, NDArray[np.int32]]:
        """Camera rays with their best hits refined by this cell, and the cell that each visits next or -1."""
        replica, count = self._replica, len(arrays["slot"])
        rays = columns.upload(cr.Rays, arrays, replica.launcher.device)
        onward = self._integers(count)
        inputs = [self._bvh, self._surfaces, replica.cells, replica.camera, rays, self._cell]
        replica.launcher(replica.kernels.visit_camera_rays, count, inputs, [onward])
        return columns.download(rays, SCHEMAS[Kind.CAMERA]), onward.numpy()

    def shade_camera(self, batch: Batch) -> Iterator[Batch]:
        """Light final hits of camera rays in this cell."""
        kernels = self._replica.kernels
        rays = columns.upload(cr.Rays, batch.arrays, self._replica.launcher.device)
        if kernels.shade_camera_hits is not None:
            shaded = self._shade(kernels.shade_camera_hits, rays, len(batch))
        else:
            shaded = self._shade(kernels.shade_vertices, start_paths(self._replica, rays, len(batch)), len(batch))
        follows = list(self._send_on(batch, shaded))
        samples = {
            "slot": batch.arrays["slot"],
            "indirect": self.gathering.reflected(GLOBAL_MAP, shaded.queries, shaded.coats, batch.arrays),
            "cell": np.full(len(batch), self._cell, np.int32),
            **columns.download(shaded.seen, ("emission", "depth", "normal", "albedo")),
        }
        for name, cause in (("emission", guards.EMISSION), ("indirect", guards.INDIRECT)):
            samples[name] = self.guards.blacken(samples[name], cause, batch.arrays)
        follows += self._first_caustics(batch, shaded)
        yield self._batch(batch, Kind.SAMPLES, self._cell, rest_of(batch.credit, follows), samples)
        yield from follows

    def _first_caustics(self, batch: Batch, shaded: Shaded) -> list[Batch]:
        """Light of the caustic map at the first surface, in scenes that have one: a part like those further on."""
        if self._replica.world.caustic_map.paths == 0:
            return []
        radiance = self.gathering.reflected(CAUSTIC_MAP, shaded.queries, shaded.coats, batch.arrays)
        none = np.zeros(len(batch), np.int32)
        arrays = {**batch.arrays, "bounce": none, "diffuse": none}
        return [self._batch(batch, Kind.LIT, self._cell, len(batch), self._part(arrays, parts.CAUSTIC, radiance))]

    # Paths beyond their first surface

    def visit_paths(self, batch: Batch) -> Iterator[Batch]:
        """Intersect rays of paths; forward those that may find a nearer hit elsewhere."""
        replica, count = self._replica, len(batch)
        rays = columns.upload(cr.Paths, batch.arrays, replica.launcher.device)
        array = self._integers(count)
        replica.launcher(cr.visit_paths, count, [self._bvh, self._surfaces, replica.cells, rays, self._cell], [array])
        onward, paths = array.numpy(), columns.download(rays, SCHEMAS[Kind.PATH])
        hit = paths["prim"] >= 0
        yield from self._send_paths(batch, Kind.PATH, paths, onward, onward >= 0)
        yield from self._send_paths(batch, Kind.VERTEX, paths, paths["owner"], (onward < 0) & hit)
        missed = np.flatnonzero((onward < 0) & ~hit)
        if len(missed):
            rest = take(paths, missed)
            credit = parts.credit_of(rest["bounce"], self._view.light_samples)
            yield from missed_light(replica, self.guards, batch, self._cell, rest, credit)

    def shade_vertices(self, batch: Batch) -> Iterator[Batch]:
        """Light final hits of paths in this cell."""
        arrays = batch.arrays
        self.counters.vertices += len(batch)
        rays = columns.upload(cr.Paths, arrays, self._replica.launcher.device)
        shaded = self._shade(self._replica.kernels.shade_vertices, rays, len(batch))
        follows = list(self._send_on(batch, shaded))
        seen = {
            parts.EMISSION: shaded.seen.emission.numpy(),
            parts.INDIRECT: self.gathering.reflected(GLOBAL_MAP, shaded.queries, shaded.coats, arrays),
            parts.CAUSTIC: self.gathering.reflected(CAUSTIC_MAP, shaded.queries, shaded.coats, arrays),
        }
        lit = concatenate([self._part(arrays, part, radiance) for part, radiance in seen.items()], Kind.LIT)
        yield self._batch(batch, Kind.LIT, self._cell, rest_of(batch.credit, follows), lit)
        yield from follows

    def _part(self, arrays: Arrays, part: int, radiance: NDArray[np.float32]) -> Arrays:
        """One part of each vertex, where it is not black."""
        radiance = self.guards.blacken(radiance, _CAUSE[part], arrays)
        rows = np.flatnonzero(radiance.any(axis=1))
        place = parts.place_of(arrays["bounce"][rows], arrays["diffuse"][rows], part, self._view.light_samples)
        return {"slot": arrays["slot"][rows], "place": place, "radiance": radiance[rows]}

    def _shade(self, kernel: wp.Kernel | None, rays: Any, count: int, actions: Any = None) -> Shaded:
        """Run a kernel that shades vertices.

        Args:
            actions: of each vertex (kernels.shading); None where the view's way needs none.
        """
        if kernel is None:
            raise ProtocolError("a camera path goes on in a scene where none does")
        replica, view = self._replica, self._view
        features, device = replica.world.features, replica.launcher.device
        shaded = Shaded(
            columns.empty(sh.Seen, count, device),
            columns.empty(sh.Queries, count, device),
            columns.empty(sh.Coats, count if features.coated else 0, device),
            columns.empty(sh.Shots, count * view.light_samples, device),
            columns.empty(cr.Paths, count if features.goes_on else 0, device),
            columns.empty(sh.Stretches, count if features.media else 0, device),
        )
        scene = [self._surfaces, replica.materials, replica.textures, replica.media, replica.lights, replica.camera]
        scalars: list[Any] = [view.light_samples, view.max_depth or 0]
        if kernel is not replica.kernels.shade_camera_hits:
            scalars += [view.way, self._integers(0) if actions is None else actions]
        outputs = [shaded.seen, shaded.queries, shaded.coats, shaded.shots, shaded.paths, shaded.stretches]
        replica.launcher(kernel, count, [*scene, rays, *scalars], outputs)
        if replica.observer is not None:
            replica.observer.shaded(self._surfaces, rays, shaded.shots, shaded.paths)
        return shaded

    def _send_on(self, cause: Batch, shaded: Shaded) -> Iterator[Batch]:
        """Everything that vertices start: shadow rays, paths that go on, stretches of medium."""
        features = self._replica.world.features
        yield from self._start_shadows(cause, shaded.shots)
        if features.goes_on:
            yield from self._start_paths(cause, shaded.paths)
        if features.media:
            yield from start_beams(self._replica, cause, shaded.stretches)

    def _start_paths(self, cause: Batch, going_on: Any) -> Iterator[Batch]:
        replica = self._replica
        paths = columns.download(going_on, SCHEMAS[Kind.PATH])
        paths["throughput"] = self.guards.blacken(paths["throughput"], guards.THROUGHPUT, cause.arrays)
        # The kernel ends them all there; hardly any has not been ended by Russian roulette long before.
        self.guards.act(guards.PATHS_CUT, np.flatnonzero(paths["bounce"] >= parts.LAST_BOUNCE), cause.arrays)
        if not paths["throughput"].any():
            return
        first = self._integers(len(paths["slot"]))
        rays = columns.upload(cr.Paths, paths, replica.launcher.device)
        replica.launcher(cr.first_path_cells, len(paths["slot"]), [replica.cells, rays], [first])
        yield from self._send_paths(cause, Kind.PATH, paths, first.numpy(), first.numpy() >= 0)

    def _send_paths(
        self, cause: Batch, kind: Kind, paths: Arrays, destination: NDArray[np.int32], chosen: NDArray[np.bool_]
    ) -> Iterator[Batch]:
        for cell, rows in by_destination(destination, chosen):
            sent = take(paths, rows)
            yield self._batch(cause, kind, cell, parts.credit_of(sent["bounce"], self._view.light_samples), sent)

    # Shadow rays

    def _start_shadows(self, cause: Batch, shots: Any) -> Iterator[Batch]:
        """Send shadow segments to the first cell on their way; those that carry nothing end here."""
        replica = self._replica
        arrays = columns.download(shots, SCHEMAS[Kind.SHADOW])
        each = self._view.light_samples
        arrays["radiance"] = self.guards.blacken(arrays["radiance"], guards.DIRECT, cause.arrays, each)
        count = len(arrays["slot"])
        if replica.world.top_tree.cells == 1 and not replica.world.features.walks:
            yield self._batch(cause, Kind.SHADOW, self._cell, count, arrays)
            return
        segments = columns.upload(sr.Segments, arrays, replica.launcher.device)
        first = self._integers(count)
        replica.launcher(sr.first_shadow_cells, count, [replica.cells, segments], [first])
        if replica.world.features.walks:
            medium = shots.medium.numpy() if replica.world.features.media else np.full(count, -1, np.int32)
            arrays = {**arrays, "medium": medium, **no_blockers(count)}
            yield from self._send_shadows(cause, Kind.WALK, arrays, first.numpy())
        else:
            yield from self._send_shadows(cause, Kind.SHADOW, arrays, first.numpy())

    def visit_shadows(self, batch: Batch) -> Iterator[Batch]:
        """Look for blockers."""
        replica = self._replica
        segments = columns.upload(sr.Segments, batch.arrays, replica.launcher.device)
        array = self._integers(len(batch))
        inputs = [self._bvh, replica.cells, segments, self._cell]
        replica.launcher(sr.visit_shadow_segments, len(batch), inputs, [array])
        onward = array.numpy()
        yield from self._send_shadows(batch, Kind.SHADOW, batch.arrays, onward)
        yield from self._end_shadows(batch, batch.arrays, onward)

    def visit_walks(self, batch: Batch) -> Iterator[Batch]:
        """Look for the next surface on the way of segments that may pass through some."""
        replica = self._replica
        walks = columns.upload(sr.Walks, batch.arrays, replica.launcher.device)
        array = self._integers(len(batch))
        inputs = [self._bvh, self._surfaces, replica.media, replica.cells, walks, self._cell]
        replica.launcher(sr.visit_walks, len(batch), inputs, [array])
        arrays, onward = columns.download(walks, SCHEMAS[Kind.WALK]), array.numpy()
        yield from self._send_shadows(batch, Kind.WALK, arrays, onward)
        met = (onward < 0) & (arrays["prim"] >= 0)
        yield from self._send_shadows(batch, Kind.PANE, arrays, np.where(met, arrays["owner"], -1))
        yield from self._end_shadows(batch, arrays, np.where(met, 0, onward))

    def pass_panes(self, batch: Batch) -> Iterator[Batch]:
        """Take segments through the surface that they have met, if it lets light pass."""
        replica = self._replica
        kernel = replica.kernels.pass_panes
        if kernel is None:
            raise ProtocolError("a shadow ray passes a surface in a scene where none does")
        walks = columns.upload(sr.Walks, batch.arrays, replica.launcher.device)
        array = self._integers(len(batch))
        scene = [self._surfaces, replica.materials, replica.textures, replica.media, replica.cells, walks]
        replica.launcher(kernel, len(batch), scene, [array])
        arrays, onward = columns.download(walks, SCHEMAS[Kind.PANE]), array.numpy()
        yield from self._send_shadows(batch, Kind.WALK, arrays, onward)
        yield from self._end_shadows(batch, arrays, onward)

    def _send_shadows(
        self, cause: Batch, kind: Kind, arrays: Arrays, destination: NDArray[np.int32]
    ) -> Iterator[Batch]:
        for cell, rows in by_destination(destination, destination >= 0):
            yield self._batch(cause, kind, cell, len(rows), take(arrays, rows))

    def _end_shadows(self, cause: Batch, arrays: Arrays, onward: NDArray[np.int32]) -> Iterator[Batch]:
        """Bring home what arrived, and the credit of what did not."""
        clear = np.flatnonzero(onward == sr.SHADOW_CLEAR)
        if len(clear):
            lit = {name: arrays[name][clear] for name in SCHEMAS[Kind.LIT]}
            yield self._batch(cause, Kind.LIT, self._cell, len(clear), lit)
        blocked = int(np.count_nonzero(onward == sr.SHADOW_BLOCKED))
        if blocked:
            yield self._batch(cause, Kind.ENDED, self._cell, blocked, {})

    # Media

    def visit_beams(self, batch: Batch) -> Iterator[Batch]:
        """Add what this cell's volume photons scatter into stretches of camera rays."""
        replica, world, device = self._replica, self._replica.world, self._replica.launcher.device
        built = self._store.maps[VOLUME_MAP]
        count = len(batch)
        self.counters.beams += count
        clamped = np.zeros(count, np.int32)
        beams = columns.upload(beam.Beams, {**batch.arrays, "clamped": clamped}, device)
        if built is not None:
            plan = world.volume_map
            inputs = [built.tree, replica.media, replica.cells, beams, self._cell, plan.radius, world.volume_unit]
            replica.launcher(beam.add_beams, count, inputs, [])
            clamped = beams.clamped.numpy()
        arrays = {**batch.arrays, **columns.download(beams, ("red", "green", "blue"))}
        arrays["radiance"] = self._told_of(arrays["radiance"], clamped)
        onward = next_beam_cells(replica, arrays, self._cell)
        for cell, rows in by_destination(onward, onward >= 0):
            yield self._batch(batch, Kind.BEAM, cell, len(rows), take(arrays, rows))
        ended = np.flatnonzero(onward < 0)
        if len(ended):
            lit = self._end_beams(take(arrays, ended))
            yield self._batch(batch, Kind.LIT, self._cell, len(ended), lit)

    def _told_of(self, throughput: NDArray[np.float32], clamped: NDArray[np.int32]) -> NDArray[np.float32]:
        """Count what was clamped. Whose beam it is only the home knows: in a strict render a NaN tells it."""
        if not clamped.any():
            return throughput
        if not self.guards.strict:
            self.guards.act(guards.BEAMS_CLAMPED, np.flatnonzero(clamped), {}, int(clamped.sum()))
            return throughput
        return np.where((clamped > 0)[:, None], np.float32(np.nan), throughput)

    def _end_beams(self, arrays: Arrays) -> Arrays:
        """What beams bring home; in a strict render that which is not finite, too, for the home to tell whose it is."""
        with np.errstate(over="ignore"):
            lit = dict(beam_light(self._replica, arrays))
        if not self.guards.strict:
            lit["radiance"] = self.guards.blacken(lit["radiance"], guards.VOLUME, lit)
        return lit

    # Odds and ends

    @property
    def _view(self) -> View:
        if self._replica.view is None:
            raise ValueError("a camera batch came before a view was set")
        return self._replica.view

    def _integers(self, count: int) -> Any:
        return wp.empty(count, dtype=wp.int32, device=self._replica.launcher.device)

    def _batch(self, cause: Batch, kind: Kind, cell: int, credit: int, arrays: Arrays) -> Batch:
        """What follows from a batch: the same task, the same home."""
        return Batch(kind, cause.task, cause.home, cell, credit, arrays)


_CAUSE = {
    parts.EMISSION: guards.EMISSION,
    parts.INDIRECT: guards.INDIRECT,
    parts.CAUSTIC: guards.CAUSTIC,
}


def rest_of(credit: int, follows: Sequence[Batch]) -> int:
    """What is left of a batch's credit for its result."""
    return credit - sum(batch.credit for batch in follows)


def no_blockers(count: int) -> dict[str, NDArray[Any]]:
    """Best hits of shadow segments that have met nothing yet."""
    return {
        "t": np.full(count, np.float32(sr.SEGMENT_END)),
        "prim": np.full(count, -1, np.int32),
        "u": np.zeros(count, np.float32),
        "v": np.zeros(count, np.float32),
        "owner": np.full(count, -1, np.int32),
    }
