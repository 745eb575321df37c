"""What the benchmarks have in common: tables for people, JSON for programs, and the machine in words.

Each benchmark is a file of its own, bench_<name>.py. All measure ratios in one run, because a time alone says more
about the machine and what else runs on it.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wdpm.cli_options import available_cores
from wdpm.image_files import check_apart, check_output_path, write_bytes
from wdpm.kernels.settings import RenderSettings
from wdpm.results import PACKAGES

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
        """For people; where the terminal is too narrow cells are folded, and nothing is cut off."""
        from rich.markup import escape
        from rich.table import Table

        # Not the table's own title, which would be folded to the table's width.
        console.print(f"\n[bold]{escape(self.title)}[/]", highlight=False)
        table = Table(box=None, padding=(0, 2, 0, 0))
        table.add_column(self.columns[0], overflow="fold")
        for column in self.columns[1:]:
            table.add_column(escape(column), justify="right", overflow="fold")
        for row in self.rows:
            table.add_row(*map(escape, row))
        console.print(table)
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


def check_outputs(json_file: Path | None, markdown_file: Path | None) -> None:
    """Find out before measuring whether the results can be written. Raises ImageError."""
    for path, extension in ((json_file, ".json"), (markdown_file, ".md")):
        if path is not None:
            check_output_path(path, (extension,))
    check_apart([("JSON", json_file), ("Markdown", markdown_file)])


def check_plot(file: Path) -> None:
    """Find out before measuring whether a plot can be written. Raises ImageError."""
    check_output_path(file, (".svg",))


def write_outputs(
    grids: Sequence[Grid], figures: dict[str, Any], json_file: Path | None, markdown_file: Path | None
) -> None:
    """Write what was asked for.

    Args:
        figures: what the tables show, in full, as JSON has it.
    """
    if json_file is not None:
        text = json.dumps({"machine": machine(), **figures}, allow_nan=False, indent=2)
        write_bytes(text.encode(), json_file)
    if markdown_file is not None:
        parts = [grid.markdown() for grid in grids]
        write_bytes("\n".join([*parts, f"Measured on {machine_in_words()}.\n"]).encode(), markdown_file)


def settings_to_dict(settings: RenderSettings) -> dict[str, Any]:
    """As JSON has it: choices by their names."""
    return {name: value.value if isinstance(value, Enum) else value for name, value in asdict(settings).items()}


def _markdown_row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
