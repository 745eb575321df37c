"""Stretches of camera rays in a medium, on their way through the cells that they pass."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays, Batch, Kind, by_destination, take
from wdpm.cluster.rows import any_of
from wdpm.cluster.runs import Runs
from wdpm.cluster.work import guards, parts
from wdpm.cluster.work.photon_store import PhotonStore
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera.shadow_rays import Ways, next_way_cells
from wdpm.kernels.photons import beam
from wdpm.kernels.photons.deposits import VOLUME_MAP
from wdpm.kernels.ray_fields import BEAM, STRETCH

_SUMS = [name for name in BEAM if name not in STRETCH]
"""Red, green and blue."""


class Beams:
    """Light that the volume photons of one cell scatter into stretches of camera rays.

    Args:
        cell: number of the cell.
        guard: of camera samples.

    Attributes:
        count: of stretches that came, in this view.
    """

    def __init__(self, cell: int, store: PhotonStore, replica: Replica, guard: guards.Guards) -> None:
        self._cell = cell
        self._store = store
        self._replica = replica
        self._guards = guard
        self.count = 0

    def begin_view(self) -> None:
        """Count anew."""
        self.count = 0

    def visit(self, batch: Batch) -> Iterator[Batch]:
        """Add what this cell's volume photons scatter into stretches of camera rays."""
        replica, world, device = self._replica, self._replica.world, self._replica.launcher.device
        built = self._store.maps[VOLUME_MAP]
        count = len(batch)
        self.count += count
        beams = columns.upload(beam.Beams, {**batch.arrays, "clamped": np.zeros(count, np.int32)}, device)
        kernel = replica.kernels.add_beams
        if built is not None and kernel is not None:
            plan = world.volume_map
            replica.launcher(
                kernel,
                count,
                photons=built.tree,
                media=replica.media,
                cells=replica.cells,
                beams=beams,
                own_cell=self._cell,
                radius=plan.radius,
                unit=world.volume_unit,
            )
        sums = columns.download(beams, [*_SUMS, "clamped"])
        clamped = sums.pop("clamped")
        arrays = {**batch.arrays, **sums}
        arrays["radiance"] = self._mark_clamped(arrays["radiance"], clamped)
        onward = next_beam_cells(replica, arrays, self._cell)
        for cell, rows in by_destination(onward, onward >= 0):
            yield Batch(Kind.BEAM, cell, batch.runs.among(rows).with_unit(), take(arrays, rows))
        ended = np.flatnonzero(onward < 0)
        if len(ended):
            lit = self._end(take(arrays, ended))
            yield Batch(Kind.LIT, self._cell, batch.runs.among(ended).with_unit(), lit)

    def _mark_clamped(self, throughput: NDArray[np.float32], clamped: NDArray[np.int32]) -> NDArray[np.float32]:
        """Count what was clamped. Whose beam it is only the home knows: in a strict render a NaN tells it."""
        if not clamped.any():
            return throughput
        if not self._guards.strict:
            self._guards.act(guards.BEAMS_CLAMPED, np.flatnonzero(clamped), {}, int(clamped.sum()))
            return throughput
        return np.where((clamped > 0)[:, None], np.float32(np.nan), throughput)

    def _end(self, arrays: Arrays) -> Arrays:
        """What beams bring home; in a strict render that which is not finite, too, for the home to tell whose it is."""
        with np.errstate(over="ignore"):
            lit = dict(beam_light(self._replica, arrays))
        if not self._guards.strict:
            lit["radiance"] = self._guards.blacken(lit["radiance"], guards.VOLUME, lit)
        return lit


def start_beams(replica: Replica, runs: Runs, stretches: Any) -> Iterator[Batch]:
    """Send the stretches that lie in a medium to the first cell on their way. Each carries a credit of one.

    Args:
        runs: whose they are.
    """
    if replica.world.volume_map.paths == 0:
        return
    arrays = columns.download(stretches, [*STRETCH, "sample"])
    weight = weight_of_beams(replica.view, arrays.pop("sample"), arrays["place"])
    lit = (arrays["medium"] >= 0) & (arrays["length"] > 0) & any_of(arrays["radiance"])
    rows = np.flatnonzero(lit & (weight > 0))
    if not len(rows):
        return
    arrays["radiance"] = arrays["radiance"] * weight[:, None]
    beams = {**take(arrays, rows), **{name: np.zeros(len(rows), np.int64) for name in _SUMS}}
    first = next_beam_cells(replica, beams, -1)
    lit_runs = runs.among(rows)
    for cell, sent in by_destination(first, first >= 0):
        yield Batch(Kind.BEAM, cell, lit_runs.among(sent).with_unit(), take(beams, sent))


def weight_of_beams(view: View | None, sample: NDArray[np.int32], place: NDArray[np.int32]) -> NDArray[np.float32]:
    """What the light of each stretch counts for; 0 where nobody looks for it.

    Gather rays look for it all: each goes its own way, and those of a record are no samples of a pixel. How many more
    a record shoots through a stratum goes by what its neighbours brought, and what one in many brought for all would
    count most where few look.

    Args:
        sample: that each stretch is of.
        place: of each, of a part BEAM.
    """
    if view is None:
        raise ValueError("a stretch of a camera ray came before a view was set")
    chosen, share = chosen_samples(view, sample)
    weight = np.where(chosen, share, np.float32(0.0))
    return np.where(parts.is_of_gather_ray(place, view.light_samples), np.float32(1.0), weight)


def chosen_samples(view: View, sample: NDArray[np.int32]) -> tuple[NDArray[np.bool_], np.float32]:
    """Which samples look for light in media, for the others of their pixel too, and what theirs counts for.

    What a beam brings changes little within a pixel, next to the noise of the photons themselves.
    """
    stride = -(-view.spp // view.volume_samples)
    number = sample - view.first_sample
    if len(view.allotment):  # of any run of spp samples, whichever it begins with, as many are chosen
        number %= view.spp
    return number % stride == 0, np.float32(view.spp / -(-view.spp // stride))


def next_beam_cells(replica: Replica, arrays: Arrays, current: int) -> NDArray[np.int32]:
    """The cell that each stretch visits after `current` (-1: before the first), or -1 when none is left."""
    launcher, count = replica.launcher, len(arrays["slot"])
    if replica.world.top_tree.cells == 1:
        return np.full(count, -1 - current, np.int32)
    destination = columns.integers(count, launcher.device)
    ways = columns.upload(Ways, arrays, launcher.device)
    launcher(next_way_cells, count, cells=replica.cells, ways=ways, current=current, next_cell_out=destination)
    return np.asarray(destination.numpy())


def beam_light(replica: Replica, arrays: Arrays) -> Arrays:
    """What stretches that have passed all cells bring home: exact sums turned into radiance, once."""
    world = replica.world
    scale = world.volume_unit / world.volume_map.paths
    sums = np.stack([arrays[name] for name in _SUMS], axis=1).astype(np.float64) * scale
    radiance = (sums * arrays["radiance"]).astype(np.float32)
    return {"slot": arrays["slot"], "place": arrays["place"], "radiance": radiance}
