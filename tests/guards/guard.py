"""A guard: a line without which some scene or some cluster gives a wrong image, and the tests that notice.

Each module guards_<subject>.py has a tuple GUARDS. A guard is described by what happens to the source where it is taken
away, so that a program can do it (remove_guards.py) and anyone can see that the tests named do fail then.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
"""Of the repository."""

SUBJECTS = {
    "guards_rays": "Rays and triangles",
    "guards_gather": "Photon maps and gathers",
    "guards_light": "Photons, surfaces and media",
    "guards_cluster": "Cells and clusters",
    "guards_scenes": "Scenes",
}
"""Module -> title, in the order of the table."""


@dataclass(frozen=True, kw_only=True)
class Guard:
    """A guard.

    Attributes:
        name: unique.
        file: from the repository's root.
        prevents: what goes wrong without it.
        changes: what to replace in the file, each once, to be without it: (text that is there once, other text).
        tests: from the repository's root, as pytest names them; all of them fail without the guard.
    """

    name: str
    file: str
    prevents: str
    changes: tuple[tuple[str, str], ...]
    tests: tuple[str, ...]

    def removed_from(self, source: str) -> str:
        """The source without the guard.

        Raises:
            ValueError: a text is not there, or not once.
        """
        for text, other in self.changes:
            if source.count(text) != 1:
                raise ValueError(f'{self.file} has {source.count(text)} times "{text}"; expected once')
            source = source.replace(text, other)
        return source


def guards_by_subject() -> dict[str, tuple[Guard, ...]]:
    """Title -> guards."""
    return {title: importlib.import_module(name).GUARDS for name, title in SUBJECTS.items()}


def every_guard() -> list[Guard]:
    """All guards, in the order of the table."""
    return [guard for guards in guards_by_subject().values() for guard in guards]


def hard(name: str) -> str:
    """The test that runs a hard case, as pytest names it."""
    return f"tests/hard_cases/test_hard_cases.py::test_hard_case[{name}]"
