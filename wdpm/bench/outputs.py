"""What the benchmarks have in common: tables for people, JSON for programs, and the machine in words.

Each benchmark measures in files of its own in this folder; its options are in commands/. All measure ratios in one run,
because a time alone says more about the machine and what else runs on it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from enum import Enum
from pathlib import Path
from typing import Any

from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.files import check_apart, check_output_path, write_bytes
from wdpm.report.grid import Grid, machine, machine_in_words


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
