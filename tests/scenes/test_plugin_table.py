"""The table of plugins in docs/scenes.md is made from the code: run this file to print it anew."""

from __future__ import annotations

from pathlib import Path

from wdpm.scenes.mitsuba import read  # readers say what they read as they are imported
from wdpm.scenes.mitsuba.rules import HARMLESS, NEAREST, STAND_IN
from wdpm.scenes.mitsuba.supported import KNOWN, supported

PAGE = Path(__file__).resolve().parents[2] / "docs" / "scenes.md"


def fate(category: str) -> str:
    """What becomes of plugins that are not read."""
    if category in HARMLESS:
        return f"warning; read as `{HARMLESS[category]}`"
    if category not in STAND_IN:
        return "error; `--lenient`: left out"
    others = "".join(f", `{name}` as `{stand_in}`" for name, stand_in in NEAREST[category].items())
    return f"error; `--lenient`: read as `{STAND_IN[category]}`{others}"


def table() -> str:
    """A row for each category of plugins."""
    rows = ["| category | read | Mitsuba has, but not read | what is not read |", "| --- | --- | --- | --- |"]
    for category in KNOWN:
        have = ", ".join(f"`{name}`" for name in supported(category))
        lack = ", ".join(f"`{name}`" for name in KNOWN[category] if name not in supported(category)) or "-"
        rows.append(f"| {category} | {have} | {lack} | {fate(category)} |")
    return "\n".join(rows) + "\n"


def test_the_page_has_the_table_of_the_code() -> None:
    assert read.read_mitsuba is not None
    assert table() in PAGE.read_text()


if __name__ == "__main__":
    print(table(), end="")
