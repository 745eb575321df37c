"""Who is told how far a render is; `wdpm.progress` has those that show it to a person."""

from __future__ import annotations

from typing import Protocol


class ProgressObserver(Protocol):
    """Told by a render what it does. All calls come from one thread, phases one after another."""

    def start(self, phase: str, total: int | None = None) -> None:
        """A phase begins, and ends the one before; `total` units of work, or None if not known."""

    def advance(self, amount: int = 1) -> None:
        """`amount` more units of the phase are done; 0, also before the first phase, says that the render lives."""

    def note(self, text: str) -> None:
        """One line for the person."""
