"""Puts what the code knows into the pages of the reference, where they say `<!-- filled in: NAME ARGUMENTS -->`.

On a code host the place stays empty, and nothing that is generated lies in git.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import tables

PLACE = re.compile(r"^<!-- filled in: (\w+)((?: [\w.-]+)*) -->$", re.MULTILINE)
CHANGES = Path(__file__).resolve().parents[2] / "CHANGELOG.md"

FILLERS = {
    "options": tables.options,
    "benchmarks": tables.benchmarks,
    "settings": tables.settings,
    "layers": tables.layers,
    "plugins": tables.plugins,
    "python": tables.python,
}


def setup(app: Any) -> None:
    """Make it known to Sphinx."""
    app.connect("source-read", _fill_in)


def filled_in(text: str) -> str:
    """A page with all its places filled in. Raises KeyError for a place that nobody fills."""
    return PLACE.sub(lambda place: FILLERS[place[1]](*place[2].split()), text)


def _fill_in(_app: Any, name: str, source: list[str]) -> None:
    source[0] = filled_in(source[0])
    if name == "changes":  # its links are as seen from the repository's root
        source[0] = re.sub(r"\]\((?!\w+:)", "](../", CHANGES.read_text()).replace("](../docs/", "](")
