"""What the doctor finds."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any


class State(Enum):
    """How a fact is to be taken."""

    FINE = "ok"
    NOTE = "note"  # wdpm works; something is not there, or slower
    WRONG = "wrong"  # wdpm, or a part of it that anybody uses, does not work


@dataclass(frozen=True)
class Fact:
    """One thing that was looked at.

    Attributes:
        about: what, in a word or two.
        found: what was found, in a line.
        advice: what to do about it; None where there is nothing to do.
        figures: numbers behind it, for programs.
    """

    about: str
    found: str
    state: State = State.FINE
    advice: str | None = None
    figures: dict[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {**asdict(self), "state": self.state.value}
