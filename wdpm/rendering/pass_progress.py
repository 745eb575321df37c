"""What a person sees while passes are rendered: one bar over all of them."""

from __future__ import annotations

from dataclasses import dataclass

from wdpm.progress import Progress

OF_EACH_PASS = frozenset({"photons", "map", "records", "render"})
"""Phases that every pass goes through; only the last has a part in the bar."""


class PassProgress:
    """Tells of several passes as one phase, in buckets of all passes together.

    A master divides buckets, and says with each pass into how many: of the bar, every pass has an equal part.

    Args:
        progress: is told.
        buckets: of each pass, undivided.
        passes: still to render.
    """

    def __init__(self, progress: Progress, buckets: int, passes: int) -> None:
        self._progress = progress
        self._buckets = buckets
        self._total = buckets * passes
        self._begun = False
        self._phase = ""
        self._pass = _Part(0)

    def start(self, phase: str, total: int | None = None) -> None:
        """A phase of a pass begins; that of buckets may do so again, where a slave was lost."""
        self._phase = phase
        if phase not in OF_EACH_PASS:
            self._progress.start(phase, total)
            return
        if not self._begun:
            self._begun = True
            self._progress.start("passes", self._total)
        if phase == "render":
            told = 0 if self._pass.complete else self._pass.told
            self._pass = _Part(total or 0, told)

    def advance(self, amount: int = 1) -> None:
        """Units of the phase are done; those of photons move no bar, but show that it lives."""
        if self._phase not in OF_EACH_PASS:
            self._progress.advance(amount)
        elif self._phase == "render":
            self._progress.advance(self._pass.advance(amount, self._buckets))
        else:
            self._progress.advance(0)

    def note(self, text: str) -> None:
        """One line for the person."""
        self._progress.note(text)

    def finish(self) -> None:
        """All is done, or has failed."""
        self._progress.finish()


@dataclass
class _Part:
    """What of a pass is done, and told."""

    total: int
    told: int = 0
    done: int = 0

    @property
    def complete(self) -> bool:
        return self.done >= self.total

    def advance(self, amount: int, buckets: int) -> int:
        """What to tell of it, so that a whole pass is so many buckets."""
        self.done += amount
        told = max(buckets * self.done // max(self.total, 1), self.told)
        self.told, more = told, told - self.told
        return more
