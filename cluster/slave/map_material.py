"""What photon maps are built of, as it comes from other slaves: counted by batches, so that nothing is missing.

First come copies of photons from slaves of other teams that hold the same cells, then ghosts from slaves of the same
team: a ghost may be of a photon that was copied.
"""

from __future__ import annotations

from collections import deque

from wdpm.cluster.batch import GHOSTS, Batch
from wdpm.cluster.messages.protocol import BuildMaps
from wdpm.cluster.slave import jobs
from wdpm.scenes.errors import ProtocolError


class MapMaterial:
    """Batches of copies and ghosts that wait, and how many more are due before the next step.

    Batches may come before the order to build maps, since others may have had theirs earlier.
    """

    def __init__(self) -> None:
        self._waiting: deque[Batch] = deque()
        self._copies = self._ghosts = 0
        self._copies_due: int | None = None
        self._ghosts_due: int | None = None

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
        self._copies_due = order.awaited
        first: list[jobs.Job] = [jobs.SendCopies(order.copies)] if order.copies else []
        return first + self._next()

    def handled(self, batch: Batch) -> list[jobs.Job]:
        """A batch was taken in: what is to be done next."""
        if batch.kind in GHOSTS:
            self._ghosts += 1
        else:
            self._copies += 1
        return self._next()

    def exchanged(self, ghosts_due: int) -> list[jobs.Job]:
        """The slave's own ghosts are on their way, and it knows how many come: what is to be done next."""
        self._ghosts_due = ghosts_due
        return self._next()

    def _next(self) -> list[jobs.Job]:
        if self._copies_due is not None and self._copies >= self._copies_due:
            _require_equal(self._copies, self._copies_due, "copies of photons")
            self._copies, self._copies_due = 0, None
            return [jobs.ExchangeGhosts()]
        if self._ghosts_due is not None and self._ghosts >= self._ghosts_due:
            _require_equal(self._ghosts, self._ghosts_due, "ghosts and points")
            self._ghosts, self._ghosts_due = 0, None
            return [jobs.BuildMaps()]
        return []


def _require_equal(came: int, due: int, what: str) -> None:
    if came != due:
        raise ProtocolError(f"{came} batches of {what} came; expected {due}")
