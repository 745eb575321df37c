"""What the export says to the person: what is not supported, what stands in its place."""

from __future__ import annotations


class Notes:
    """One line each, and each line once, in the order in which they came up."""

    def __init__(self) -> None:
        self._lines: dict[str, None] = {}

    def add(self, owner: str, text: str) -> None:
        """Note something about an object, a material, a light.

        Args:
            owner: what it is and its name in quotes, such as 'material "Glass"'.
            text: what is not supported, and what is done instead.
        """
        self._lines[f"{owner}: {text}"] = None

    @property
    def lines(self) -> tuple[str, ...]:
        """All notes."""
        return tuple(self._lines)
