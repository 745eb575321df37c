"""Shadow rays in one cell: from the vertices of camera paths to lights, through what lets light pass."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Batch, Kind, by_destination, take
from wdpm.cluster.runs import Runs
from wdpm.cluster.work import guards
from wdpm.cluster.work.replica import Replica
from wdpm.kernels import columns
from wdpm.kernels.camera import shadow_rays as sr
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.two_level import Trees
from wdpm.scenes.errors import ProtocolError


class Shadows:
    """Shadow rays of one cell.

    Args:
        cell: number of the cell.
        trees, surfaces: its triangles on the device.
        guard: of camera samples.
    """

    def __init__(self, cell: int, trees: Trees, surfaces: Surfaces, replica: Replica, guard: guards.Guards) -> None:
        self._cell = cell
        self._trees = trees
        self._surfaces = surfaces
        self._replica = replica
        self._guards = guard
        self._scene: Any = None

    def begin_view(self, scene: Any) -> None:
        """Look at the scene (kernels.camera.scene.Scene) through another camera."""
        self._scene = scene

    def start(self, cause: Batch, shots: Any) -> Iterator[Batch]:
        """Send shadow segments on their way; those that carry nothing, and those that this cell settles, end here.

        Most begin where they are: so this cell looks for blockers at once, and has but those to send that go on.
        """
        replica = self._replica
        arrays = columns.download(shots, SCHEMAS[Kind.SHADOW])
        each = len(arrays["slot"]) // len(cause)
        runs = cause.runs.times(each)
        radiance = self._guards.blacken(arrays["radiance"], guards.DIRECT, cause.arrays, each)
        blackened = radiance is not arrays["radiance"]
        arrays["radiance"] = radiance
        segments = columns.part_of(sr.Segments, shots)
        if blackened:
            segments.radiance = columns.array_over(radiance, wp.vec3, replica.launcher.device)
        if not replica.world.features.walks:
            onward = self._look_for_blockers(segments, len(radiance), fresh=True)
            yield from self._send(runs, Kind.SHADOW, arrays, onward)
            yield from self._arrive(runs, arrays, onward)
            return
        count = len(radiance)
        first = self._integers(count)
        replica.launcher(sr.first_shadow_cells, count, cells=replica.cells, segments=segments, next_cell_out=first)
        medium = columns.column(shots, "medium") if replica.world.features.media else np.full(count, -1, np.int32)
        arrays = {**arrays, "medium": medium, **_no_blockers(count)}
        destination = first.numpy()
        # What meets nothing still passes its medium, which is looked after where it starts.
        destination = np.where(destination == sr.SHADOW_CLEAR, np.int32(self._cell), destination)
        yield from self._send(runs, Kind.SHADOW_WALK, arrays, destination)

    def send_on(self, runs: Runs, shots: Arrays) -> Iterator[Batch]:
        """Send segments to the cells that they are to visit next, which this one has been asked about.

        Args:
            runs: whose the paths are that they set out from.
            shots: Kind.SHADOW; `whose` path each is of, ascending; and where each goes `onward`.
        """
        kind, count = Kind.SHADOW, len(shots["slot"])
        if self._replica.world.features.walks:
            kind, shots = Kind.SHADOW_WALK, {**shots, "medium": np.full(count, -1, np.int32), **_no_blockers(count)}
        arrays = {name: shots[name] for name in SCHEMAS[kind]}
        for cell, rows in by_destination(shots["onward"], shots["onward"] >= 0):
            yield Batch(kind, cell, runs.among(shots["whose"].take(rows)).with_unit(), take(arrays, rows))

    def visit(self, batch: Batch) -> Iterator[Batch]:
        """Look for blockers."""
        segments = columns.upload(sr.Segments, batch.arrays, self._replica.launcher.device, written=())
        onward = self._look_for_blockers(segments, len(batch), fresh=False)
        yield from self._send(batch.runs, Kind.SHADOW, batch.arrays, onward)
        yield from self._end(batch.runs, batch.arrays, onward)

    def _look_for_blockers(self, segments: sr.Segments, count: int, *, fresh: bool) -> NDArray[np.int32]:
        """The cell that each segment visits next, SHADOW_BLOCKED or SHADOW_CLEAR, shape [count].

        Args:
            fresh: whether they have been nowhere yet: then this cell is asked only where it is the first.
        """
        replica, onward = self._replica, self._integers(count)
        replica.launcher(
            replica.kernels.visit_shadow_segments,
            count,
            trees=self._trees,
            cells=replica.cells,
            segments=segments,
            own_cell=self._cell,
            fresh=int(fresh),
            next_cell_out=onward,
        )
        next_cells: NDArray[np.int32] = onward.numpy()
        return next_cells

    def visit_walks(self, batch: Batch) -> Iterator[Batch]:
        """Look for the next surface on the way of segments that may pass through some."""
        replica = self._replica
        kernel = replica.kernels.visit_walks
        if kernel is None:
            raise ProtocolError("a shadow ray is walked in a scene where none is")
        walks = columns.upload(sr.Walks, batch.arrays, replica.launcher.device)
        array = self._integers(len(batch))
        replica.launcher(
            kernel,
            len(batch),
            trees=self._trees,
            surfaces=self._surfaces,
            media=replica.media,
            cells=replica.cells,
            walks=walks,
            own_cell=self._cell,
            next_cell_out=array,
        )
        arrays, onward = columns.download(walks, SCHEMAS[Kind.SHADOW_WALK]), array.numpy()
        yield from self._send(batch.runs, Kind.SHADOW_WALK, arrays, onward)
        met = (onward < 0) & (arrays["prim"] >= 0)
        yield from self._send(batch.runs, Kind.SHADOW_WALK_HIT, arrays, np.where(met, arrays["owner"], -1))
        yield from self._end(batch.runs, arrays, np.where(met, 0, onward))

    def pass_surfaces(self, batch: Batch) -> Iterator[Batch]:
        """Take segments through the surface that they have met, if it lets light pass."""
        replica = self._replica
        kernel = replica.kernels.pass_surfaces
        if kernel is None:
            raise ProtocolError("a shadow ray passes a surface in a scene where none does")
        walks = columns.upload(sr.Walks, batch.arrays, replica.launcher.device)
        array = self._integers(len(batch))
        replica.launcher(kernel, len(batch), scene=self._scene, walks=walks, next_cell_out=array)
        arrays, onward = columns.download(walks, SCHEMAS[Kind.SHADOW_WALK_HIT]), array.numpy()
        yield from self._send(batch.runs, Kind.SHADOW_WALK, arrays, onward)
        yield from self._end(batch.runs, arrays, onward)

    def _send(self, runs: Runs, kind: Kind, arrays: Arrays, destination: NDArray[np.int32]) -> Iterator[Batch]:
        for cell, rows in by_destination(destination, destination >= 0):
            yield Batch(kind, cell, runs.among(rows).with_unit(), take(arrays, rows))

    def _end(self, runs: Runs, arrays: Arrays, onward: NDArray[np.int32]) -> Iterator[Batch]:
        """Bring home what arrived, and the credit of what did not."""
        yield from self._arrive(runs, arrays, onward)
        blocked = onward == sr.SHADOW_BLOCKED
        if blocked.any():
            yield Batch(Kind.ENDED, self._cell, runs.without_rows(runs.sums(blocked)), {})

    def _arrive(self, runs: Runs, arrays: Arrays, onward: NDArray[np.int32]) -> Iterator[Batch]:
        """Bring home what arrived."""
        clear = np.flatnonzero(onward == sr.SHADOW_CLEAR)
        if len(clear):
            lit = take({name: arrays[name] for name in SCHEMAS[Kind.LIT]}, clear)
            yield Batch(Kind.LIT, self._cell, runs.among(clear).with_unit(), lit)

    def _integers(self, count: int) -> Any:
        return columns.integers(count, self._replica.launcher.device)


def _no_blockers(count: int) -> dict[str, NDArray[Any]]:
    """Best hits of shadow segments that have met nothing yet."""
    return {
        "t": np.full(count, np.float32(sr.SEGMENT_END)),
        "prim": np.full(count, -1, np.int32),
        "u": np.zeros(count, np.float32),
        "v": np.zeros(count, np.float32),
        "owner": np.full(count, -1, np.int32),
    }
