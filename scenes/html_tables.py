"""Tables in HTML, as notebooks show them. All text is escaped: names come from files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table: the first column to the left, as names are, all others to the right, as numbers are.

    Args:
        header: of the columns; none for a table of a name and a value a row, which is to the left then.
    """
    aligned = ["left", *["right" if header else "left"] * max(len(header) - 1, 1)]
    head = "".join(_cell("th", text, align) for text, align in zip(header, aligned, strict=False))
    body = "".join(
        "<tr>" + "".join(_cell("td", cell, align) for cell, align in zip(row, aligned, strict=False)) + "</tr>"
        for row in rows
    )
    caption = f'<caption style="text-align: left"><b>{escape(title)}</b></caption>' if title else ""
    return f"<table>{caption}{f'<thead><tr>{head}</tr></thead>' if header else ''}<tbody>{body}</tbody></table>"


def html_lines(lines: Iterable[object]) -> str:
    """A list of lines; nothing if there is none."""
    items = "".join(f"<li>{escape(str(line))}</li>" for line in lines)
    return f"<ul>{items}</ul>" if items else ""


def _cell(tag: str, text: object, align: str) -> str:
    return f'<{tag} style="text-align: {align}">{escape(str(text))}</{tag}>'
