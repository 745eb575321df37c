"""What a person sees while passes are rendered: one bar over all of them."""

from __future__ import annotations

from wdpm.progress import Progress

OF_EACH_PASS = frozenset({"photons", "map", "records", "render"})
"""Phases that every pass goes through; only the last has a part in the bar."""


class PassProgress:
    """Tells of several passes as one phase, in buckets of all passes together.

    Args:
        progress: is told.
        buckets: of each pass.
        passes: still to render.
    """

    def __init__(self, progress: Progress, buckets: int, passes: int) -> None:
        self._progress = progress
        self._total = buckets * passes
        self._begun = False
        self._phase = ""

    def start(self, phase: str, total: int | None = None) -> None:
        """A phase of a pass begins."""
        self._phase = phase
        if phase not in OF_EACH_PASS:
            self._progress.start(phase, total)
        elif not self._begun:
            self._begun = True
            self._progress.start("passes", self._total)

    def advance(self, amount: int = 1) -> None:
        """Units of the phase are done; those of photons move no bar, but show that it lives."""
        if self._phase == "render" or self._phase not in OF_EACH_PASS:
            self._progress.advance(amount)
        else:
            self._progress.advance(0)

    def note(self, text: str) -> None:
        """One line for the person."""
        self._progress.note(text)

    def finish(self) -> None:
        """All is done, or has failed."""
        self._progress.finish()
