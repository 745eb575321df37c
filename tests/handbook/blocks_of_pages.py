"""The commands and programs that the pages show."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

BLOCK = re.compile(r"^( *)```(\w*)\n(.*?)^\1```", re.DOTALL | re.MULTILINE)
INDENTED = re.compile(r"(?<=\n\n)(?: {4}\S.*\n)+")
COMMAND = re.compile(r"^ *(?:\$ )?(wdpm .+)$", re.MULTILINE)


@dataclass(frozen=True)
class Program:
    """A block of Python on a page."""

    page: str
    text: str


def name_of(page: Path) -> str:
    """As the lists of the tests have it: from the repository's root."""
    return page.relative_to(ROOT).as_posix()


def commands_of(page: Path) -> list[str]:
    """Every command `wdpm ...` in the blocks of a page, without comments, in their order."""
    text = page.read_text()
    blocks = {found.start(): found[3] for found in BLOCK.finditer(text) if found[2] in ("", "sh")}
    outside = BLOCK.sub(lambda found: re.sub(r"[^\n]", "x", found[0]), text)
    blocks |= {found.start(): found[0] for found in INDENTED.finditer(outside)}
    return [line.strip() for _, block in sorted(blocks.items()) for line in COMMAND.findall(block)]


def words_of(command: str) -> list[str]:
    """The words of a command, without `wdpm`, its comment, and what a shell does with its end or its output."""
    words = shlex.split(command, comments=True)
    ends = [words.index(sign) for sign in ("&&", ">", "|") if sign in words]
    return words[1 : min(ends, default=None)]


def programs_of(page: Path) -> list[Program]:
    """Every block of Python on a page."""
    return [Program(name_of(page), found[3]) for found in BLOCK.finditer(page.read_text()) if found[2] == "python"]
