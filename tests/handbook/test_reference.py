"""The reference is made of the code, and leaves nothing out."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import filled_in
import pytest
import tables

import wdpm
from wdpm.cli.bench import BENCHMARKS
from wdpm.cli.main import COMMANDS
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.channels import LAYER_CHANNELS
from wdpm.scenes.mitsuba.supported import KNOWN, supported

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = sorted(DOCS.rglob("*.md"))


def shown(page: str) -> str:
    return filled_in.filled_in((DOCS / "reference" / f"{page}.md").read_text())


def test_every_command_is_shown_under_its_heading() -> None:
    text = shown("commands")
    names = list(COMMANDS)
    assert sorted(tables.commands()) == sorted(names)
    for name in names:
        assert re.search(rf"^## wdpm {name}$", text, re.MULTILINE), f"docs/reference/commands.md has no {name}"
    for benchmark in BENCHMARKS:
        assert f"### wdpm bench {benchmark.name}\n" in text


@pytest.mark.parametrize("command", tables.commands())
def test_every_option_of_a_command_is_shown(command: str) -> None:
    """By itself, or as one of a group that `wdpm render` has in the same words."""
    text, of_render = tables.options(command), tables.options("render")
    for group in tables._commands()[command]._action_groups:
        for option in [name for action in group._group_actions for name in action.option_strings if name != "-h"]:
            if option not in ("--help", "-h"):
                assert f"`{option}" in (of_render if f"*{group.title}*" in text else text), option


def test_every_setting_is_shown() -> None:
    text = shown("settings")
    for field in fields(RenderSettings):
        row = re.search(rf"^\| `{field.name}` \|(.+)\|(.+)\|(.+)\|$", text, re.MULTILINE)
        assert row is not None, field.name
        assert all(cell.strip() for cell in row.groups()), field.name


def test_every_layer_is_shown() -> None:
    assert set(tables.LAYERS_IN_WORDS) == set(LAYER_CHANNELS)
    assert all(f"| `{name}` | `{channels}` |" in shown("layers") for name, channels in LAYER_CHANNELS.items())


def test_every_plugin_is_shown() -> None:
    pieces = dict(piece.split("\n", 1) for piece in shown("plugins").split("\n## ")[1:])
    assert list(pieces) == list(KNOWN)
    for category, text in pieces.items():
        assert all(f"| `{name}` | read |" in text for name in supported(category))
        assert all(f"| `{name}` |" in text for name in KNOWN[category])


def test_every_public_name_is_shown() -> None:
    text = shown("python")
    assert all(f"}} wdpm.{name}\n" in text for name in wdpm.__all__ if name != "scenes")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_place_is_filled_in(page: Path) -> None:
    assert "<!-- filled in:" not in filled_in.filled_in(page.read_text())


def test_a_place_that_nobody_fills_is_found() -> None:
    with pytest.raises(KeyError):
        filled_in.filled_in("<!-- filled in: nothing -->")


def test_help_becomes_markdown() -> None:
    assert tables._text("a <b> of 5 %%,\n  as `x_*`: y_z") == r"a \<b\> of 5 %, as `x_*`: y\_z"
    assert tables._table(("a", "b"), [("1|2", "3")]) == "| a | b |\n| --- | --- |\n| 1\\|2 | 3 |"
