"""Steering of photons that travels: what holds together arrives as it was sent, the rest is refused."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from fake_worker import make_world

from wdpm.cluster.messages import packing
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.world import Steering
from wdpm.scenes.errors import ProtocolError

ALL = packing.by_name(p.Message)


def setup(axis: int = 4, lower: int = 1, split: float = 0.25, chance: float = 0.9) -> p.Setup:
    """Photons of a tree of one node and its halves."""
    tree = Steering(
        np.array([axis, 0, 0], np.int32),
        np.array([lower, 0, 0], np.int32),
        np.array([split, 0.5, 0.5]),
        np.array([chance, 0.5, 0.5]),
    )
    world = make_world(1)
    return p.Setup(1, dataclasses.replace(world, emission=dataclasses.replace(world.emission, steering=tree)), (), ())


@pytest.mark.parametrize("changes", [{}, {"lower": 0}])
def test_a_tree_travels(changes: dict[str, Any]) -> None:
    message = setup(**changes)
    arrived: Any = packing.decode(packing.encode(message), ALL)
    for name, column in vars(message.world.emission.steering).items():
        np.testing.assert_array_equal(getattr(arrived.world.emission.steering, name), column)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"axis": 5}, "axis is 0 to 5"),
        ({"lower": 2}, "does not come before its halves"),
        ({"lower": -1}, "does not come before its halves"),
        ({"split": 1.0}, "split is not between"),
        ({"chance": 0.0}, "chance is not between"),
        ({"chance": np.nan}, "chance is not between"),
    ],
)
def test_a_tree_that_cannot_be_walked_is_refused(changes: dict[str, Any], reason: str) -> None:
    with pytest.raises(ProtocolError, match=reason):
        packing.decode(packing.encode(setup(**changes)), ALL)
