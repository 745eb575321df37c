"""What a cluster's messages say of photons that set out, checked."""

from __future__ import annotations

import numpy as np

from wdpm.cluster.messages.demands import Shape
from wdpm.cluster.messages.demands import indices as _indices
from wdpm.cluster.messages.demands import require as _require
from wdpm.cluster.world import START_NUMBERS, Emission, Steering

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
    """A tree whose nodes come before their halves, and no part of which is empty or out of reach."""
    nodes = len(steering)
    _indices(steering.axis, 0, START_NUMBERS, f"{where}.axis")
    inner = steering.lower != 0
    after = (steering.lower > np.arange(nodes)) & (steering.lower < nodes - 1)
    _require(bool((after | ~inner).all()), where, "a node does not come before its halves")
    for name in ("split", "chance"):
        part = getattr(steering, name)
        _require(bool(((part > 0) & (part < 1)).all()), where, f"{name} is not between 0 and 1")
