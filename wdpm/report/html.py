"""Tables and lines of the terminal as HTML, for notebooks."""

from __future__ import annotations

from collections.abc import Iterable

from rich.table import Table
from rich.text import Text

from wdpm.scenes.html_tables import html_lines, html_table


def html_of(parts: Iterable[Table | str]) -> str:
    """Parts in order, without their colours; lines that follow one another become a list."""
    pieces: list[str] = []
    lines: list[str] = []
    for part in parts:
        if isinstance(part, str):
            lines.append(_plain(part))
            continue
        pieces += [html_lines(lines), _html_table(part)]
        lines = []
    return "".join([*pieces, html_lines(lines)])


def _html_table(table: Table) -> str:
    header = [_plain(column.header) for column in table.columns] if table.show_header else []
    rows = zip(*([_plain(cell) for cell in column.cells] for column in table.columns), strict=True)
    return html_table(_plain(table.title or ""), header, rows)


def _plain(text: object) -> str:
    """Without rich's markup, which is not HTML's: what it escaped is told apart from what it means."""
    shown = text if isinstance(text, Text) else Text.from_markup(str(text))
    return shown.plain.strip()
