"""Rays through candidates for irradiance records, in one cell: to where a record is wanted, or on by what is smooth.

In a mirror, and through smooth glass, the camera sees as sharply as without them: samples that arrive there read
records, so there are some. Behind what is rough each sample sees another place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Batch, Kind, by_destination, take
from wdpm.cluster.rows import any_of
from wdpm.cluster.runs import Runs
from wdpm.cluster.work.final_gather import FinalGather
from wdpm.cluster.work.misses import rest_of
from wdpm.cluster.work.replica import Replica
from wdpm.kernels import columns
from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.ray_fields import HIT

MOST_BEYOND: Final = 8
"""Mirrors, and surfaces of glass, that a place for a record is looked for behind."""


Visit = Callable[..., NDArray[np.int32]]
LeadOn = Callable[[Any, int], Any]


class Candidates:
    """Takes rays through candidates to their ends. Each carries a credit of one.

    How rays are met with the cell, and where they go on, CameraPaths tells with each call (`_visit`, `_lead_on`): were
    it kept here, each would hold the other, and a cell would outlive its use.

    Args:
        cell: number of the cell.
    """

    def __init__(self, cell: int, replica: Replica, final_gather: FinalGather) -> None:
        self._cell = cell
        self._replica = replica
        self._final_gather = final_gather

    def take(self, batch: Batch, visit: Visit, lead_on: LeadOn) -> Iterator[Batch]:
        """Meet rays with this cell, or, where their hits are final, look for places of records."""
        if batch.kind is Kind.CANDIDATE_HIT:
            return self._find_sites(batch, visit, lead_on)
        return self._meet(batch, visit)

    def _meet(self, batch: Batch, visit: Visit) -> Iterator[Batch]:
        """As CameraPaths.visit_paths."""
        paths = columns.upload(Paths, batch.arrays, self._replica.launcher.device, HIT)
        yield from self._send(batch.runs, paths, visit(paths, len(batch), fresh=False))

    def _find_sites(self, batch: Batch, visit: Visit, lead_on: LeadOn) -> Iterator[Batch]:
        """Tell the home where among final hits a record is wanted; where none serves, rays may go on."""
        paths = columns.upload(Paths, batch.arrays, self._replica.launcher.device, written=())
        rows, sites, serve = self._final_gather.sites(paths, batch.arrays["slot"])
        looks = np.flatnonzero(~serve & (batch.arrays["bounce"] < MOST_BEYOND))
        follows = list(self._look_beyond(batch.runs, paths, looks, visit, lead_on))
        left = rest_of(batch.runs, follows)
        if left.any():
            yield Batch(Kind.RECORD_SITES, self._cell, batch.runs.among(rows).with_credit(left), sites)
        yield from follows

    def _look_beyond(
        self, runs: Runs, paths: Any, rows: NDArray[np.intp], visit: Visit, lead_on: LeadOn
    ) -> Iterator[Batch]:
        """Send rays on by mirrors, and through smooth glass, as camera samples go.

        Args:
            paths: at final hits.
            rows: those of them that may go on.
        """
        device = self._replica.launcher.device
        onward = lead_on(columns.chosen(Paths, paths, rows, device), len(rows)) if len(rows) else None
        if onward is None:
            return
        sharp = (columns.column(onward, "pdf") == 0) & (columns.column(onward, "diffuse") == 0)
        going = np.flatnonzero(sharp & any_of(columns.column(onward, "throughput")))
        if len(going):
            rays = columns.chosen(Paths, onward, going, device)
            visited = visit(rays, len(going), fresh=True)
            yield from self._send(runs.among(rows[going]).with_unit(), rays, visited)

    def _send(self, runs: Runs, paths: Any, onward: NDArray[np.int32]) -> Iterator[Batch]:
        """Send rays where they are to go.

        Args:
            onward: as `visit` of CameraPaths tells it.
        """
        arrays = columns.download(paths, SCHEMAS[Kind.CANDIDATE])
        final, hit = onward == -1, arrays["prim"] >= 0
        for cell, rows in by_destination(onward, onward >= 0):
            yield Batch(Kind.CANDIDATE, cell, runs.among(rows).with_unit(), take(arrays, rows))
        for cell, rows in by_destination(arrays["owner"], final & hit):
            yield Batch(Kind.CANDIDATE_HIT, cell, runs.among(rows).with_unit(), take(arrays, rows))
        missed = final & ~hit
        if missed.any():
            yield Batch(Kind.ENDED, self._cell, runs.without_rows(runs.sums(missed)), {})
