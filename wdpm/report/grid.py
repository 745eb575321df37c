"""Tables of figures for the terminal and for Markdown, and the machine that they were measured on."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from wdpm.devices import available_cores
from wdpm.report.report import PACKAGES

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True)
class Grid:
    """A table, for the terminal and for Markdown.

    Attributes:
        columns: headings; the first column holds names, the others numbers.
        rows: as many cells each as there are columns.
        notes: lines below the table.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"a row of {len(row)} cells in a table of {len(self.columns)} columns: {row}")

    def print(self, console: Console) -> None:
        """For people; nothing is cut off where a terminal, or a file, is narrow."""
        from rich.markup import escape
        from rich.table import Table

        from wdpm.report.tables import print_whole

        # Not the table's own title, which would be folded to the table's width.
        console.print(f"\n[bold]{escape(self.title)}[/]", highlight=False)
        table = Table(box=None, padding=(0, 2, 0, 0))
        table.add_column(self.columns[0])
        for column in self.columns[1:]:
            table.add_column(escape(column), justify="right")
        for row in self.rows:
            table.add_row(*map(escape, row))
        print_whole(table, console)
        for note in self.notes:
            console.print(note, markup=False, highlight=False)

    def markdown(self) -> str:
        """A heading, a table as GitHub has it, and the notes."""
        lines = [
            f"## {self.title}",
            "",
            _markdown_row(self.columns),
            "|" + " --- |" + " ---: |" * (len(self.columns) - 1),
            *map(_markdown_row, self.rows),
        ]
        for note in self.notes:
            lines += ["", note]
        return "\n".join(lines) + "\n"


def machine() -> dict[str, Any]:
    """What was measured on: cores that this process may use, instruction set, versions."""
    from importlib import metadata

    versions = {name: metadata.version(name) for name in PACKAGES} | {"python": platform.python_version()}
    return {"cores": available_cores(), "processor": platform.machine(), "system": platform.system(), **versions}


def machine_in_words() -> str:
    """One line."""
    it = machine()
    cores = f"{it['cores']} core" + ("s" if it["cores"] > 1 else "")
    versions = ", ".join(f"{name} {it[name]}" for name in (*PACKAGES, "python"))
    return f"{cores}, {it['processor']}, {it['system']}; {versions}"


def _markdown_row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
