"""From a master's instructions to whoever is told how far a render is."""

from __future__ import annotations

from wdpm.cluster.master import events as m
from wdpm.cluster.progress import ProgressObserver


def tell_observer(instruction: m.Instruction, observer: ProgressObserver | None) -> None:
    """Pass on what an instruction says about progress; nothing if it says nothing, or nobody listens."""
    if observer is None:
        return
    match instruction:
        case m.Started(phase, total):
            observer.start(phase, total)
        case m.Advanced(amount):
            observer.advance(amount)
        case m.Noted(text):
            observer.note(text)
