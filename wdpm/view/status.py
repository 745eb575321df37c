"""What the page tells beside the image: phases, time left, slaves, lines for the person, the error as it falls."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from wdpm.cluster.display import OF_NOBODY, Bucket, Frame, SlaveSeen
from wdpm.progress import TimeLeft

NOTES = 200
"""Lines that are kept."""

SLAVE_FIGURES = ("busy_s", "peak_memory_bytes", "bytes_in", "bytes_out", "rays_in", "rays_out")
"""Of a slave's statistics, those that the page shows."""


NOW = ("memory", "cores", "sent", "received")
"""Of what the master last said of a slave, what it takes."""


@dataclass
class SlaveStatus:
    """What is known of a slave while it renders.

    Attributes:
        name: host and process.
        cells: numbers of the cells that it holds, of the team that colours the image by slaves.
        seen: what the master last said of it; None where there is no cluster.
        buckets: that it has put together, of all frames.
        bucket_at: when the last came [s, as the clock of Status].
        figures: SLAVE_FIGURES of the last frame that is complete.
        dropped: what its guards dropped or cut there.
    """

    name: str
    cells: list[int]
    buckets: int = 0
    seen: SlaveSeen | None = None
    bucket_at: float = 0.0
    figures: dict[str, float] | None = None
    dropped: int = 0


class Status:
    """Kept by the thread that renders, read by that of the server as JSON.

    Args:
        title: of the page.
        passes: whether there will be several, so that one can have enough of them.
    """

    def __init__(self, title: str, passes: bool) -> None:
        self._title = title
        self._passes = passes
        self._began = time.monotonic()
        self._phase, self._done = "", 0
        self._total: int | None = None
        self._left = TimeLeft(self._began, None)
        self._notes: deque[str] = deque(maxlen=NOTES)
        self._slaves: list[SlaveStatus] = []
        self._errors: list[list[float]] = []
        self._frames = 0
        self._ended: str | None = None

    @property
    def seconds(self) -> float:
        """Since it began."""
        return time.monotonic() - self._began

    def start(self, phase: str, total: int | None) -> None:
        """A phase begins."""
        self._phase, self._total, self._done = phase, total, 0
        self._left = TimeLeft(time.monotonic(), total)

    def advance(self, amount: int) -> None:
        """Units of it are done."""
        self._done += amount
        self._left.advance(time.monotonic(), amount)

    def note(self, text: str) -> None:
        """A line for the person."""
        self._notes.append(text)

    def begin(self, frame: Frame, anew: bool) -> None:
        """A frame begins; `anew` if it is not the next pass of the same image."""
        self._frames = 1 if anew else self._frames + 1
        if anew:
            self._errors = []
        self._know(frame.slaves)
        for number, slave in enumerate(self._slaves):
            slave.cells = [cell for cell, holder in enumerate(frame.holders) if holder == number]

    def bucket(self, bucket: Bucket) -> None:
        """A slave has done one, or an interrupted render had."""
        if bucket.slave == OF_NOBODY:
            return
        for number in range(len(self._slaves), bucket.slave + 1):  # it has joined just now
            self._slaves.append(SlaveStatus(f"slave {number}", []))
        slave = self._slaves[bucket.slave]
        slave.buckets += 1
        slave.bucket_at = time.monotonic()

    def see(self, seen: Sequence[SlaveSeen]) -> None:
        """What slaves hold and take now; all that ever were, by number."""
        self._know([each.name for each in seen])
        for slave, each in zip(self._slaves, seen, strict=False):
            slave.seen = each

    def _know(self, names: Sequence[str]) -> None:
        """Slaves by number. No number is given twice in a cluster: other names are those of another one."""
        if len(names) < len(self._slaves):
            self._slaves = []
        for number, name in enumerate(names):
            if number == len(self._slaves):
                self._slaves.append(SlaveStatus(name, []))
            self._slaves[number].name = name

    def end_frame(self, statistics: Sequence[Mapping[str, Any]]) -> None:
        """What slaves did is known."""
        for number, values in enumerate(statistics):
            slave = self._slaves[values.get("slave", number)]
            slave.figures = {name: float(values[name]) for name in SLAVE_FIGURES if name in values}
            slave.dropped = sum(values.get("guards", {}).values())

    def error(self, spp: int, figure: tuple[float, float, float]) -> None:
        """The error of the mean so far."""
        self._errors.append([self.seconds, float(spp), *figure])

    def end(self, how: str) -> None:
        """Nothing comes any more."""
        self._ended = how

    def to_dict(self) -> dict[str, Any]:
        """All of it, as JSON has it (docs/view.md)."""
        now = time.monotonic()
        return {
            "kind": "status",
            "title": self._title,
            "passes": self._passes,
            "frames": self._frames,
            "seconds": now - self._began,
            "phase": self._phase,
            "total": self._total,
            "done": self._done,
            "left": self._left.seconds(now),
            "notes": list(self._notes),
            "errors": list(self._errors),
            "slaves": [_of_slave(slave, now) for slave in list(self._slaves)],
            "ended": self._ended,
        }


def _of_slave(slave: SlaveStatus, now: float) -> dict[str, Any]:
    seen = slave.seen or SlaveSeen(slave.name, len(slave.cells), False, False)
    return {
        "name": slave.name,
        "cells": slave.cells,
        "holds": seen.cells,
        "whole": seen.whole,
        "lost": seen.lost,
        "now": {name: getattr(seen, name) for name in NOW} if seen.memory and not seen.lost else None,
        "buckets": slave.buckets,
        "silent": now - slave.bucket_at if slave.buckets else None,
        "figures": slave.figures,
        "dropped": slave.dropped,
    }
