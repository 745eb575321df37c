"""Stretches of camera rays in a medium, on their way through the cells that they pass."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays, Batch, Kind, by_destination, take
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera.shadow_rays import Ways, next_way_cells
from wdpm.kernels.ray_fields import BEAM, STRETCH

_SUMS = [name for name in BEAM if name not in STRETCH]
"""Red, green and blue."""


def start_beams(replica: Replica, cause: Batch, stretches: Any) -> Iterator[Batch]:
    """Send the stretches that lie in a medium to the first cell on their way. Each carries a credit of one."""
    if replica.world.volume_map.paths == 0:
        return
    arrays = columns.download(stretches, STRETCH)
    chosen, weight = chosen_samples(replica.view, stretches.sample.numpy())
    lit = (arrays["medium"] >= 0) & (arrays["length"] > 0) & arrays["radiance"].any(axis=1)
    rows = np.flatnonzero(lit & chosen)
    if not len(rows):
        return
    arrays["radiance"] = arrays["radiance"] * weight
    beams = {**take(arrays, rows), **{name: np.zeros(len(rows), np.int64) for name in _SUMS}}
    first = next_beam_cells(replica, beams, -1)
    for cell, sent in by_destination(first, first >= 0):
        yield Batch(Kind.BEAM, cause.task, cause.home, cell, len(sent), take(beams, sent))


def chosen_samples(view: View | None, sample: NDArray[np.int32]) -> tuple[NDArray[np.bool_], np.float32]:
    """Which samples look for light in media, for the others of their pixel too, and what theirs counts for.

    What a beam brings changes little within a pixel, next to the noise of the photons themselves.
    """
    if view is None:
        raise ValueError("a stretch of a camera ray came before a view was set")
    stride = -(-view.spp // view.volume_samples)
    return (sample - view.first_sample) % stride == 0, np.float32(view.spp / -(-view.spp // stride))


def next_beam_cells(replica: Replica, arrays: Arrays, current: int) -> NDArray[np.int32]:
    """The cell that each stretch visits after `current` (-1: before the first), or -1 when none is left."""
    launcher, count = replica.launcher, len(arrays["slot"])
    if replica.world.top_tree.cells == 1:
        return np.full(count, -1 - current, np.int32)
    destination = wp.empty(count, dtype=wp.int32, device=launcher.device)
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
