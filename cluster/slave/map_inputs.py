"""Inputs of photon maps that other slaves send, counted by batches, so that none is missing when maps are built.

First come photons from slaves of other teams that hold the same cells, then ghosts from slaves of the same team, which
may be of photons that were copied. Then come parts of the trees of both, where teams share the sorting. Last comes the
irradiance at photons that other teams have worked out, each a part.
"""

from __future__ import annotations

from collections import Counter, deque

from wdpm.cluster.batch import GHOSTS, Batch, Kind
from wdpm.cluster.messages.protocol import BuildMaps
from wdpm.cluster.slave import jobs
from wdpm.scenes.errors import ProtocolError

PHOTONS, GHOST, ORDER, IRRADIANCE = (
    "copies of photons",
    "ghosts and points",
    "parts of trees",
    "copies of irradiance",
)

_COPIED = {Kind.COPIED_PHOTONS: PHOTONS, Kind.COPIED_ORDER: ORDER, Kind.COPIED_IRRADIANCE: IRRADIANCE}


class MapInputs:
    """Batches that wait to be taken in, and how many more are due before the next step.

    Batches may come before the order to build maps, since others may have had theirs earlier.
    """

    def __init__(self) -> None:
        self._waiting: deque[Batch] = deque()
        self._came: Counter[str] = Counter()
        self._due: dict[str, int] = {}
        self._order: BuildMaps | None = None

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, batch: Batch) -> None:
        """Let a batch wait. It is counted, so it must not be joined with others."""
        self._waiting.append(batch)

    def pop(self) -> Batch:
        """The batch that came first."""
        return self._waiting.popleft()

    def ordered(self, order: BuildMaps) -> list[jobs.Job]:
        """The master wants maps: what is to be done first."""
        self._order = order
        self._due[PHOTONS] = order.awaited
        first: list[jobs.Job] = [jobs.SendCopies(order.copies, order.part, order.regions)] if order.copies else []
        return first + self._next()

    def handled(self, batch: Batch) -> list[jobs.Job]:
        """A batch was taken in: what is to be done next."""
        self._came[GHOST if batch.kind in GHOSTS else _COPIED[batch.kind]] += 1
        return self._next()

    def exchanged(self, ghosts_due: int) -> list[jobs.Job]:
        """The slave's own ghosts are on their way, and it knows how many come: what is to be done next."""
        self._due[GHOST] = ghosts_due
        return self._next()

    def sent(self, job: jobs.SendCopies | jobs.SortTrees | jobs.BuildMaps, batches: int) -> list[jobs.Job]:
        """A job's batches are on their way to other teams, which send as many: what is to be done next."""
        if self._order is not None and isinstance(job, jobs.SortTrees):
            self._due[ORDER] = self._order.awaited if batches else 0
        if self._order is not None and isinstance(job, jobs.BuildMaps):
            self._due[IRRADIANCE] = self._order.awaited
        return self._next()

    def _next(self) -> list[jobs.Job]:
        if self._order is None:
            return []
        share = self._order.copies, self._order.part, self._order.parts
        if self._complete(PHOTONS):
            return [jobs.ExchangeGhosts()]
        if self._complete(GHOST):
            return [jobs.SortTrees(*share) if self._order.copies else jobs.BuildMaps(*share)]
        if self._complete(ORDER):
            return [jobs.BuildMaps(*share)]
        if self._complete(IRRADIANCE):
            self._order = None
            return [jobs.FinishMaps()]
        return []

    def _complete(self, what: str) -> bool:
        """Whether all is here that a step waits for, which happens once."""
        due = self._due.get(what)
        if due is None or self._came[what] < due:
            return False
        if self._came[what] > due:
            raise ProtocolError(f"{self._came[what]} batches of {what} came; expected {due}")
        del self._due[what], self._came[what]
        return True
