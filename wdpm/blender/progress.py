"""Tells Blender how far a render is, shows it the picture as it comes, and asks it whether the person has enough."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from wdpm.blender.layers import Layers
from wdpm.cluster.display import Bucket, Frame, PassMean, SlaveSeen

Show = Callable[[Layers, int, int], None]
"""Takes layers of some pixels, and where their upper left corner is."""

INTERVAL_S = 0.5
"""Between one word to Blender and the next, at least."""

_WORDS = {"compile": "Compiling kernels (minutes the first time)", "plan": "Preparing", "pilot": "Trying out settings"}


class Cancelled(KeyboardInterrupt):
    """The person pressed Esc. As after Ctrl-C, what was rendered so far may be used."""


class BlenderProgress:
    """An observer of progress for a RenderEngine.

    Args:
        engine: Blender's.
        seconds: time that the render may take, if it is one to a time.

    Raises:
        Cancelled: from any call but `finish`, once the person has cancelled.
    """

    def __init__(self, engine: Any, seconds: float | None = None) -> None:
        self._engine = engine
        self._seconds = seconds
        self._began = time.monotonic()
        self._phase = ""
        self._total: int | None = None
        self._done = 0
        self._shown = 0.0
        self._told = -INTERVAL_S

    def start(self, phase: str, total: int | None = None) -> None:
        """A phase begins."""
        if phase != self._phase:
            self._told = -INTERVAL_S
        self._phase, self._total, self._done = phase, total, 0
        self._tell()

    def advance(self, amount: int = 1) -> None:
        """Units of the phase are done."""
        self._done += amount
        self._tell()

    def note(self, text: str) -> None:
        """One line for the person."""
        self._engine.update_stats("", text)
        self._check()

    def finish(self) -> None:
        """All is done, or has failed."""

    def _tell(self) -> None:
        self._check()
        if time.monotonic() - self._told < INTERVAL_S:  # without a window, Blender prints a line each time
            return
        self._told = time.monotonic()
        words = _WORDS.get(self._phase, self._phase.capitalize())
        count = f": {self._done:,} of {self._total:,}" if self._total else ""
        self._engine.update_stats("", f"{words}{count}")
        share = self._share()
        if share > self._shown:  # phases come again in a search for settings, and a bar that falls back tells nothing
            self._shown = share
            self._engine.update_progress(share)

    def _share(self) -> float:
        if self._seconds:
            return min((time.monotonic() - self._began) / self._seconds, 1.0)
        if self._phase in ("render", "passes") and self._total:
            return min(self._done / self._total, 1.0)
        return 0.0

    def _check(self) -> None:
        if self._engine.test_break():
            raise Cancelled


class BlenderDisplay:
    """A display (wdpm.cluster.display) that shows the picture in Blender.

    Args:
        show: writes pixels into Blender's result.
    """

    enough = False
    """Whether the passes so far are good enough: whoever thinks so presses Esc, which keeps them."""

    def __init__(self, show: Show) -> None:
        self._show = show
        self._first = True
        self._last = 0.0

    def begin(self, frame: Frame) -> None:
        """A frame begins."""
        self._first = frame.first_sample == 0

    def bucket(self, bucket: Bucket) -> None:
        """Pixels are done: those of the first pass are shown, and later ones only in the mean."""
        if self._first:
            self._show(bucket.layers, bucket.x0, bucket.y0)

    def slaves(self, seen: Sequence[SlaveSeen]) -> None:
        """They are no part of the image."""

    def end(self, statistics: Sequence[Mapping[str, Any]]) -> None:
        """The frame is complete."""

    def pass_done(self, mean: PassMean) -> None:
        """Show the mean, now and then."""
        if time.monotonic() - self._last > INTERVAL_S:
            self._show(mean.layers(), 0, 0)
            self._last = time.monotonic()
