"""What a cluster tells while a render runs; `wdpm.progress` shows it to a person."""

from __future__ import annotations

from typing import Protocol

from wdpm.cluster.master import events as m


class Progress(Protocol):
    """Told by a render what it does. All calls come from one thread, phases one after another."""

    def start(self, phase: str, total: int | None = None) -> None:
        """A phase begins, and ends the one before; `total` units of work, or None if not known."""

    def advance(self, amount: int = 1) -> None:
        """`amount` more units of the phase are done."""

    def note(self, text: str) -> None:
        """One line for the person."""


def report(instruction: m.Instruction, progress: Progress | None) -> None:
    """Tell a person what the master tells about its progress."""
    if progress is None:
        return
    match instruction:
        case m.Started(phase, total):
            progress.start(phase, total)
        case m.Advanced(amount):
            progress.advance(amount)
        case m.Noted(text):
            progress.note(text)
