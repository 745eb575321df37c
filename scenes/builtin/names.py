"""The scenes that come with wdpm, by the names that the command line knows."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from wdpm.scenes.errors import SceneError

if TYPE_CHECKING:
    from wdpm.scenes.model.scene import Scene

BUILT_IN_NAMES = ("cornell-box", "atrium", "forest")
_SUFFIXES = {"": 1, "k": 1_000, "m": 1_000_000}


def load_built_in(name: str, size: tuple[int, int] | None = None) -> Scene:
    """A built-in scene by its name.

    Args:
        name: "cornell-box", "atrium" or "atrium:N" with a number of triangles such as 50000, 50k or 2M, "forest" or
            "forest:N" with a number of trees.

    Raises:
        SceneError: no such scene, or N is not a number in range.
    """
    from wdpm.scenes.builtin.atrium import DEFAULT_TRIANGLES, atrium  # who knows the names need not have the scenes
    from wdpm.scenes.builtin.cornell_box import cornell_box
    from wdpm.scenes.builtin.forest import DEFAULT_TREES, forest

    scene, colon, parameter = name.partition(":")
    if scene == "cornell-box" and not colon:
        return cornell_box(size)
    if scene == "atrium":
        return atrium(parse_count(parameter) if colon else DEFAULT_TRIANGLES, size)
    if scene == "forest":
        return forest(parse_count(parameter, "trees") if colon else DEFAULT_TREES, size)
    known = "cornell-box, atrium, atrium:N (such as atrium:2M), forest and forest:N (such as forest:10k)"
    raise SceneError(f'no built-in scene "{name}"; there are {known}')


def parse_count(text: str, of: str = "triangles") -> int:
    """A whole number, with k for thousands or M for millions: "50k", "2M", "1.5M"."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([km]?)", text.strip().lower())
    if match is None:
        raise SceneError(f'"{text}" is not a number of {of}; expected something like 50000, 50k or 2M')
    return round(float(match[1]) * _SUFFIXES[match[2]])
