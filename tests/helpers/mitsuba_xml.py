"""Small files in Mitsuba's format, and what they are read as."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from wdpm.scenes.mitsuba.read import read_mitsuba
from wdpm.scenes.model.scene import Scene


def read_body(folder: Path, body: str, version: str = "3.0.0", *, after: str = "", **arguments: Any) -> Scene:
    """The scene of a file scene.xml that has this from its second line on.

    Args:
        after: what stands behind it, such as a lamp.
        arguments: of read_mitsuba.
    """
    file = folder / "scene.xml"
    file.write_text(f'<scene version="{version}">\n{body}\n{after}</scene>')
    return read_mitsuba(file, {}, **arguments)


def number(name: str, value: float) -> str:
    return f'<float name="{name}" value="{value}"/>'


def rgb(name: str, value: str) -> str:
    return f'<rgb name="{name}" value="{value}"/>'


def emitter(kind: str, inside: str = "") -> str:
    return f'<emitter type="{kind}">{inside}</emitter>'
