"""What a slave's statistics must look like: the report of a render reads them as they are."""

from __future__ import annotations

import math
from typing import Any

from wdpm.cluster.messages.protocol import SPENT
from wdpm.cluster.world import World
from wdpm.scenes.errors import ProtocolError

MAPS = 3
"""Global, caustic and volume."""

COUNTS = frozenset(
    {
        "triangles",
        "gathers",
        "gathers_truncated",
        "gathers_left_band",
        "final_gather_rays",
        "final_gather_short",
        "final_gather_unread",
        "final_gather_interpolated",
        "final_gather_uncovered",
        "irradiance_points",
        "records",
        "vertices",
        "beams",
        "made_alone",
        "peak_memory_bytes",
        "rays_in",
        "rays_out",
        "bytes_in",
        "bytes_out",
    }
)
SECONDS = frozenset({"gathers_s", "final_gather_read_s", "final_gather_interpolated_s", "irradiance_s", "busy_s"})
COUNTS_BY_NAME = frozenset({"guards", "dropped"})
MOST_NAMES = 1024
COUNTS_BY_POWER = frozenset({"batches_by_rays", "batches_by_bytes"})
ACCOUNT = frozenset({"spent_s", "messages", *COUNTS_BY_POWER})
"""What slaves of processes of their own tell of themselves, beside what their workers do."""
POWERS = frozenset({"0", *(str(1 << power) for power in range(63))})


def check_statistics(values: dict[str, Any], world: World) -> None:
    """Raise ProtocolError unless these are the statistics of a slave of this world, by name and type."""
    lights = len(world.lights.names)
    tables: dict[str, tuple[type, tuple[int, ...]]] = {
        "photons": (int, (MAPS,)),
        "copies": (int, (MAPS,)),
        "ghosts": (int, (MAPS,)),
        "paths_by_light": (int, (2, lights)),
        "flux_by_light": (float, (MAPS, lights)),
        "stored_by_light": (int, (MAPS, lights)),
        "energy": (float, (MAPS,)),
    }
    known = {"cells", *COUNTS, *SECONDS, *COUNTS_BY_NAME, *tables}
    names = values.keys() - ACCOUNT
    _require(names == known, f"wrong names: {sorted(known ^ names)!r:.200}")
    _check_account(values)
    for name in COUNTS:
        _require(_is_count(values[name]), f"{name} is {values[name]!r:.80}; expected a count")
    for name in SECONDS:
        _require(_is_number(values[name]), f"{name} is {values[name]!r:.80}; expected seconds")
    for name in COUNTS_BY_NAME:
        _require(_are_counts(values[name]), f"{name} is {values[name]!r:.80}; expected counts by name")
    for name, (item, shape) in tables.items():
        _require(_is_table(values[name], item, shape), f"{name} is {values[name]!r:.80}; expected numbers of {shape}")
    cells = values["cells"]
    inside = isinstance(cells, list) and all(_is_count(cell) and cell < world.top_tree.cells for cell in cells)
    _require(inside, f"cells is {cells!r:.80}; expected numbers of cells")


def _check_account(values: dict[str, Any]) -> None:
    """All of it, or nothing."""
    there = values.keys() & ACCOUNT
    if not there:
        return
    _require(there == ACCOUNT, f"wrong names: without {sorted(ACCOUNT - there)}")
    spent, messages = values["spent_s"], values["messages"]
    timed = isinstance(spent, dict) and spent.keys() == set(SPENT)
    right = timed and all(_is_number(seconds) and seconds >= 0 for seconds in spent.values())
    _require(right, f"spent_s is {spent!r:.80}; expected seconds of {', '.join(SPENT)}")
    named = _are_counts(messages) and all(isinstance(name, str) for name in messages)
    _require(named, f"messages is {messages!r:.80}; expected counts by name")
    for name in COUNTS_BY_POWER:
        powers = _are_counts(values[name]) and values[name].keys() <= POWERS
        _require(powers, f"{name} is {values[name]!r:.80}; expected counts by powers of two")


def of_nobody(world: World) -> dict[str, Any]:
    """The statistics of a render whose slaves were all lost when it was done."""
    lights = len(world.lights.names)
    none: dict[str, Any] = dict.fromkeys(COUNTS, 0) | dict.fromkeys(SECONDS, 0.0)
    none |= {name: {} for name in COUNTS_BY_NAME} | {name: [0] * MAPS for name in ("photons", "copies", "ghosts")}
    by_light = {"paths_by_light": [[0] * lights] * 2, "stored_by_light": [[0] * lights] * MAPS}
    return none | by_light | {"flux_by_light": [[0.0] * lights] * MAPS, "energy": [0.0] * MAPS, "cells": [], "slave": 0}


def _require(condition: bool, what: str) -> None:
    if not condition:
        raise ProtocolError(f"Statistics: {what}")


def _is_count(value: Any) -> bool:
    return type(value) is int and value >= 0


def _are_counts(value: Any) -> bool:
    return isinstance(value, dict) and len(value) <= MOST_NAMES and all(map(_is_count, value.values()))


def _is_number(value: Any) -> bool:
    """Sums of nothing are whole."""
    return type(value) in (int, float) and math.isfinite(value)


def _is_table(value: Any, item: type, shape: tuple[int, ...]) -> bool:
    """Whether lists within lists have the lengths of a shape, and numbers of one kind in them."""
    if not shape:
        return _is_count(value) if item is int else _is_number(value)
    return isinstance(value, list) and len(value) == shape[0] and all(_is_table(v, item, shape[1:]) for v in value)
