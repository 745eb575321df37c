"""The site's navigation is made of index.md: its headings are the parts, and the links below them the pages."""

from __future__ import annotations

import re
from typing import Any

INDEX = "index"
HEADING = re.compile(r"^## (.+)$", re.MULTILINE)
PAGE = re.compile(r"^\* \[[^\]]*\]\(([\w/-]+)\.md\)", re.MULTILINE)


def setup(app: Any) -> None:
    """Make it known to Sphinx."""
    app.connect("source-read", _add_contents)


def parts(text: str) -> dict[str, list[str]]:
    """Pages without their suffix, by the heading that they are listed under."""
    pieces = HEADING.split(text)[1:]
    pages = {title: PAGE.findall(body) for title, body in zip(pieces[::2], pieces[1::2], strict=True)}
    return {title: names for title, names in pages.items() if names}


def _add_contents(_app: Any, name: str, source: list[str]) -> None:
    if name != INDEX:
        return
    for title, pages in parts(source[0]).items():
        source[0] += "\n".join(["\n\n```{toctree}", ":hidden:", f":caption: {title}", "", *pages, "```\n"])
