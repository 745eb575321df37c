"""Samples and gather rays that one launch follows to their ends: where one cell is all (kernels.whole_samples)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.rows import put_rows, take_rows
from wdpm.cluster.work.final_gather import FinalGatherCounters
from wdpm.cluster.work.photon_gathers import PhotonGatherCounters
from wdpm.cluster.work.whole.launches import Counts, TraceLaunches, sum_of
from wdpm.kernels import columns
from wdpm.kernels.camera import add_samples
from wdpm.kernels.irradiance.record_rays import ArrivedRays
from wdpm.kernels.limits import RAY_SAMPLES
from wdpm.kernels.whole_samples import indirect_light, trace

WHOLE_GRAIN = 256
"""Samples below which handing a chunk of them to another thread costs more than it saves: of half a microsecond at
least, mostly of several."""


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
    """Traces samples and gather rays in the only cell."""

    def __init__(self, launches: TraceLaunches) -> None:
        self._launches = launches

    @property
    def can_be(self) -> bool:
        """Whether samples can be followed from the camera to their ends in one launch, with the same bits.

        In one cell, which has all that they meet, and where nobody looks on.
        """
        return self._launches.can_be and self._launches.replica.world.top_tree.cells == 1

    def trace(self, pixels: Arrays, start: int, samples: int, sums: Any) -> TracedWhole | None:
        """Add samples `start` to `start + samples` of some pixels to their sums.

        Args:
            pixels: columns of kernels.whole_samples.trace.Pixels.
            sums: so far (kernels.camera.add_samples.Sums), which stay what they are.

        Returns:
            what they come to; None where something happened that guards count: then all that is under way with them is
            to be rendered in the other way.
        """
        device, count = self._launches.replica.launcher.device, len(pixels["pixel"])
        sums_out = columns.zeros(add_samples.Sums, count, device)
        hit = columns.integers(count, device)
        uploaded = columns.upload(trace.Pixels, pixels, device, written=())
        counts = sum_of(
            self._launches.launch(
                count,
                max(1, WHOLE_GRAIN // samples),
                pixels=uploaded,
                start=start,
                samples=samples,
                sums=sums,
                sums_out=sums_out,
                hit_out=hit,
            )
        )
        return None if counts[indirect_light.SPOILT] else TracedWhole(sums_out, hit.numpy() > 0, counts)

    def trace_rays(self, rays: RecordRays) -> RaysTracedWhole | None:
        """Follow gather rays of records, which have met what they meet first, to their ends.

        They are taken in the order of what they met: see CameraPaths.visit_paths. One that has met nothing brings
        nothing: what shines from beyond the scene is direct light.

        Returns:
            what they bring; None as of `trace`.
        """
        device, prim = self._launches.replica.launcher.device, columns.column(rays.paths, "prim")
        met = np.flatnonzero((prim >= 0) & (rays.distance >= 0))
        order = met.take(prim.take(met).argsort())
        arrived = {name: columns.column(rays.paths, name) for name in ("direction", "t", "prim", "u", "v")}
        arrived |= {"record": rays.record, "ray": rays.ray}
        some = {name: take_rows(column, order) for name, column in arrived.items()}
        count, distance = len(order), np.empty(len(order), np.float32)
        radiance = wp.empty(count, dtype=wp.vec3d, device=device)
        counts = sum_of(
            self._launches.launch(
                count,
                WHOLE_GRAIN,
                sites=rays.sites,
                rays=columns.upload(ArrivedRays, some, device, written=()),
                start=RAY_SAMPLES,
                radiance_out=radiance,
                distance_out=columns.array_over(distance, wp.float32, device),
            )
        )
        if counts[indirect_light.SPOILT]:
            return None
        brought, reach = np.zeros((len(prim), 3)), rays.distance.copy()
        put_rows(brought, order, radiance.numpy())
        put_rows(reach, order, distance)
        return RaysTracedWhole(brought, reach, counts)


def add_counts(counts: Counts, gathers: PhotonGatherCounters, final_gather: FinalGatherCounters) -> None:
    """Count what samples did, all but their vertices, now that they are not rendered again."""
    gathers.gathers += int(counts[indirect_light.GATHERS])
    gathers.truncated += int(counts[indirect_light.TRUNCATED])
    final_gather.rays += int(counts[indirect_light.RAYS])
    final_gather.short += int(counts[indirect_light.SHORT])
    final_gather.unread += int(counts[indirect_light.UNREAD])
    final_gather.interpolated += int(counts[indirect_light.INTERPOLATED])
    final_gather.uncovered += int(counts[indirect_light.UNCOVERED])
