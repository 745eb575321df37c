"""What a person sees while a render runs."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, TextIO

from wdpm.cluster.progress import ProgressObserver

if TYPE_CHECKING:
    from rich.console import Console

EVEN = 1.5
"""How many times faster or slower than the whole the later half of a phase may be for its end to be foretold."""

MARK_INTERVAL_S = 0.25
PLAIN_INTERVAL_S = 2.0  # a log file of a long render stays short enough to read


class Progress(ProgressObserver, Protocol):
    """Shows a person how far a render is, phase by phase (report.PHASES)."""

    def finish(self) -> None:
        """All is done, or has failed; may be called again."""


class SilentProgress:
    """Shows nothing."""

    def start(self, phase: str, total: int | None = None) -> None:
        pass

    def advance(self, amount: int = 1) -> None:
        pass

    def note(self, text: str) -> None:
        pass

    def finish(self) -> None:
        pass


class TimeLeft:
    """Foretells how long a phase will still take, where it goes on evenly enough for that.

    Args:
        began: when the phase did [s].
        total: units of work; None where nobody knows.
    """

    def __init__(self, began: float, total: int | None) -> None:
        self._began, self._total = began, total
        self._marks = deque([(began, 0)])  # when so much was done, from before the middle of the time on
        self._done = 0

    def advance(self, now: float, amount: int) -> None:
        """Units are done."""
        self._done += amount
        if now - self._marks[-1][0] >= MARK_INTERVAL_S:
            self._marks.append((now, self._done))

    def seconds(self, now: float) -> float | None:
        """The time left [s]; None where it cannot be told.

        It is told by the later half of the time so far, and only if that went about as fast as the whole: work of which
        the first units take long (kernels that are compiled, records that nobody has made yet) says nothing of its end.
        """
        elapsed = now - self._began
        if not self._total or not self._done or elapsed <= 0:
            return None
        while len(self._marks) > 1 and self._marks[1][0] <= self._began + elapsed / 2:
            self._marks.popleft()
        since, before = self._marks[0]
        recent, whole = (self._done - before) / (elapsed / 2), self._done / elapsed
        if since > self._began:
            recent = (self._done - before) / (now - since)
        if not whole / EVEN < recent < whole * EVEN:
            return None
        return max(self._total - self._done, 0) / recent


class PlainProgress:
    """Lines for a log file: one when a phase begins and ends, and at most one every two seconds between.

    Args:
        stream: where the lines go; each is flushed, so that a reader of the log sees it at once.
        clock: seconds, growing.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._phase: str | None = None
        self._total: int | None = None
        self._done = 0
        self._told: int | None = 0  # what the last line said was done; None before there is any
        self._started = self._last_line = 0.0
        self._left = TimeLeft(0.0, None)

    def start(self, phase: str, total: int | None = None) -> None:
        self._end("went on")  # without slaves that have their cells later
        self._phase, self._total, self._done = phase, total, 0
        self._told = 0 if total is None else None
        self._started = self._last_line = self._clock()
        self._left = TimeLeft(self._started, total)
        self._print(f"{phase} ...")

    def advance(self, amount: int = 1) -> None:
        self._done += amount
        now = self._clock()
        self._left.advance(now, amount)
        if self._done == self._told:
            return  # a sign of life tells a reader of the log nothing
        if now - self._last_line >= PLAIN_INTERVAL_S:
            self._last_line, self._told = now, self._done
            self._print(f"{self._phase}: {self._state(now)}")

    def note(self, text: str) -> None:
        self._print(text)

    def finish(self) -> None:
        self._end("stopped")

    def _end(self, early: str) -> None:
        """The phase has ended; `early` says what it did if not all of it is done."""
        if self._phase is not None:
            elapsed = self._clock() - self._started
            done = self._total is None or self._done >= self._total
            ending = "done" if done else f"{early} at {self._done:,} of {self._total:,}"
            self._print(f"{self._phase}: {ending} in {elapsed:.1f} s")
            self._phase = None

    def _state(self, now: float) -> str:
        if self._total is None:
            return f"{self._done:,}"
        seconds = self._left.seconds(now)
        left = "" if seconds is None else f", about {seconds:.0f} s left"
        return f"{self._done:,} of {self._total:,} ({self._done / max(self._total, 1):.0%}){left}"

    def _print(self, text: str) -> None:
        print(text, file=self._stream, flush=True)


class BarProgress:
    """Bars with the time left, for a terminal: one for each phase.

    Args:
        console: of the terminal; None for standard error, so that results on standard output can be piped.
    """

    def __init__(self, console: Console | None = None) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            SpinnerColumn,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )
        from rich.progress import Progress as RichProgress

        self._bars = RichProgress(
            SpinnerColumn(finished_text="[green]✓[/]"),
            TextColumn("{task.description:<10}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(elapsed_when_finished=False),
            console=console or Console(stderr=True),
        )
        self._bars.start()
        self._total: int | None = None

    def start(self, phase: str, total: int | None = None) -> None:
        self._complete_last()
        self._total = total
        self._bars.add_task(phase, total=total)

    def advance(self, amount: int = 1) -> None:
        if self._bars.task_ids:
            self._bars.advance(self._bars.task_ids[-1], amount)

    def note(self, text: str) -> None:
        self._bars.console.print(text, markup=False, highlight=False)

    def finish(self) -> None:
        self._complete_last()
        self._bars.stop()

    def _complete_last(self) -> None:
        # A phase of unknown length is complete when the next begins; one of known length shows how far it came.
        if self._bars.task_ids and self._total is None:
            last = self._bars.tasks[-1]
            self._bars.update(last.id, total=max(last.completed, 1), completed=max(last.completed, 1))


def make_progress(quiet: bool = False, stream: TextIO | None = None) -> Progress:
    """Bars on a terminal, lines elsewhere, nothing if `quiet`; on standard error unless `stream` says otherwise."""
    stream = stream or sys.stderr
    if quiet:
        return SilentProgress()
    if not stream.isatty():
        return PlainProgress(stream)
    from rich.console import Console

    return BarProgress(Console(file=stream))
