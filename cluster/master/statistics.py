"""What slaves' statistics, and what they counted of photons, must look like: reports read them as they are.

Photons are counted when maps are built. So each photon in the maps counts once, also where the slave that stored it is
lost later, and where another traces all of them once more for itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wdpm.cluster.messages.protocol import SPENT
from wdpm.cluster.world import World
from wdpm.kernels.limits import MAPS
from wdpm.scenes.errors import ProtocolError

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
OF_MAPS = frozenset({"photons", "copies", "ghosts"})
COUNTS_BY_NAME = frozenset({"guards", "dropped"})
MOST_NAMES = 1024
COUNTS_BY_POWER = frozenset({"batches_by_rays", "batches_by_bytes"})
ACCOUNT = frozenset({"spent_s", "messages", *COUNTS_BY_POWER})
"""What slaves of processes of their own tell of themselves, beside what their workers do."""
POWERS = frozenset({"0", *(str(1 << power) for power in range(63))})


def check_statistics(values: dict[str, Any], world: World) -> None:
    """Raise ProtocolError unless these are the statistics of a slave of this world, by name and type."""
    known = {"cells", *COUNTS, *SECONDS, *COUNTS_BY_NAME, *OF_MAPS}
    names = values.keys() - ACCOUNT
    _require(names == known, f"wrong names: {sorted(known ^ names)!r:.200}")
    _check_account(values)
    for name in COUNTS:
        _require(_is_count(values[name]), f"{name} is {values[name]!r:.80}; expected a count")
    for name in SECONDS:
        _require(_is_number(values[name]), f"{name} is {values[name]!r:.80}; expected seconds")
    for name in COUNTS_BY_NAME:
        _require(_are_counts(values[name]), f"{name} is {values[name]!r:.80}; expected counts by name")
    for name in OF_MAPS:
        _require(_is_table(values[name], int, (MAPS,)), f"{name} is {values[name]!r:.80}; expected {MAPS} counts")
    cells = values["cells"]
    inside = isinstance(cells, list) and all(_is_count(cell) and cell < world.top_tree.cells for cell in cells)
    _require(inside, f"cells is {cells!r:.80}; expected numbers of cells")


def photon_tables(lights: int) -> dict[str, tuple[type, tuple[int, ...]]]:
    """What is counted of photons besides guards: by name, the type of its numbers and its shape.

    `paths_by_light` are the paths that set out, by pass (global, caustic); `stored_by_light` and `flux_by_light` [W x
    paths] are of photons in each map; `energy` is the power that was absorbed, escaped, or was cut off [W x paths].
    """
    return {
        "paths_by_light": (int, (2, lights)),
        "stored_by_light": (int, (MAPS, lights)),
        "flux_by_light": (float, (MAPS, lights)),
        "energy": (float, (3,)),
    }


def no_photons_counted(lights: int) -> dict[str, Any]:
    """All of it, of no photons."""
    return {name: np.zeros(shape, kind).tolist() for name, (kind, shape) in photon_tables(lights).items()} | {
        "guards": {}
    }


def all_photons_counted(counted: Sequence[Mapping[str, Any]], lights: int) -> dict[str, Any]:
    """What several slaves have counted, together."""
    whole = no_photons_counted(lights)
    for name, (kind, shape) in photon_tables(lights).items():
        whole[name] = sum((np.array(each[name], kind) for each in counted), np.zeros(shape, kind)).tolist()
    for each in counted:
        for cause, count in each["guards"].items():
            whole["guards"][cause] = whole["guards"].get(cause, 0) + count
    return whole


def check_photon_counts(values: dict[str, Any], world: World) -> None:
    """Raise ProtocolError unless this is what a slave of this world counted of photons, by name and type."""
    known = photon_tables(len(world.lights.names))
    names, of = values.keys() ^ {*known, "guards"}, "MapsBuilt"
    _require(not names, f"wrong names: {sorted(names)!r:.200}", of)
    for name, (item, shape) in known.items():
        right = _is_table(values[name], item, shape)
        _require(right, f"{name} is {values[name]!r:.80}; expected numbers of {shape}", of)
    _require(_are_counts(values["guards"]), f"guards is {values['guards']!r:.80}; expected counts by name", of)


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


def of_nobody() -> dict[str, Any]:
    """The statistics of a render whose slaves were all lost when it was done."""
    none: dict[str, Any] = dict.fromkeys(COUNTS, 0) | dict.fromkeys(SECONDS, 0.0)
    none |= {name: {} for name in COUNTS_BY_NAME} | {name: [0] * MAPS for name in OF_MAPS}
    return none | {"cells": [], "slave": 0}


def _require(condition: bool, what: str, of: str = "Statistics") -> None:
    if not condition:
        raise ProtocolError(f"{of}: {what}")


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
