"""What a cluster's messages say of photons that set out, checked."""

from __future__ import annotations

import numpy as np

from wdpm.cluster.messages.demands import Shape
from wdpm.cluster.messages.demands import indices as _indices
from wdpm.cluster.messages.demands import require as _require
from wdpm.cluster.world import START_NUMBERS, STEERING_LEVELS, Emission, Steering
from wdpm.scenes.errors import ProtocolError

MOST_WEIGHT = 1e6
"""Of a steered photon's flux: those of a plan carry no more than five times what they would unsteered."""

SHAPES_OF_EMISSION: dict[type, dict[str, Shape]] = {
    Emission: {
        "share": ("elements",),
        "caustic_share": ("elements",),
        "target_center": ("targets", 3),
        "target_radius": ("targets",),
    },
    Steering: {"axis": ("nodes",), "lower": ("nodes",), "split": ("nodes",), "chance": ("nodes",)},
}


def check_steering(steering: Steering, where: str) -> None:
    """A tree whose nodes come before their halves, and no part of which is empty, out of reach or too heavy."""
    nodes = len(steering)
    _indices(steering.axis, 0, START_NUMBERS, f"{where}.axis")
    inner = steering.lower != 0
    after = (steering.lower > np.arange(nodes)) & (steering.lower < nodes - 1)
    _require(bool((after | ~inner).all()), where, "a node does not come before its halves")
    for name in ("split", "chance"):
        part = getattr(steering, name)
        _require(bool(((part > 0) & (part < 1)).all()), where, f"{name} is not between 0 and 1")
    halves = np.sort(steering.lower[inner])
    _require(bool((halves % 2 == 1).all() and (np.diff(halves) > 0).all()), where, "a node is a half of two")
    if nodes:
        _require(_heaviest(steering, where) <= MOST_WEIGHT, where, "photons of a part that hardly any sets out to")


def _heaviest(steering: Steering, where: str) -> float:
    """The largest weight of a photon, level by level, as each of them is told it by its way down the tree."""
    level, weight = np.zeros(1, np.int64), np.ones(1)
    heaviest = 0.0
    for _ in range(STEERING_LEVELS + 1):
        inner = steering.lower[level] != 0
        heaviest = float(np.maximum(heaviest, weight[~inner].max(initial=0.0)))  # NaN stays, and is too heavy
        level, weight = level[inner], weight[inner]
        if not len(level):
            return heaviest
        split, chance, lower = steering.split[level], steering.chance[level], steering.lower[level].astype(np.int64)
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            weight = np.concatenate([weight * (split / chance), weight * ((1.0 - split) / (1.0 - chance))])
        level = np.concatenate([lower, lower + 1])
    raise ProtocolError(f"{where}: more than {STEERING_LEVELS} levels")
