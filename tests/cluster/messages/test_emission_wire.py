"""Steering of photons that travels: what holds together arrives as it was sent, the rest is refused."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from fake_worker import make_world

from wdpm.cluster.messages import packing
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.world import STEERING_LEVELS, Steering
from wdpm.scenes.errors import ProtocolError

ALL = packing.by_name(p.Message)


def setup(axis: int = 4, lower: int = 1, split: float = 0.25, chance: float = 0.9) -> p.Setup:
    """Photons of a tree of one node and its halves."""
    return setup_of([axis, 0, 0], [lower, 0, 0], [split, 0.5, 0.5], [chance, 0.5, 0.5])


def setup_of(axis: list[int], lower: list[int], split: list[float], chance: list[float]) -> p.Setup:
    tree = Steering(np.array(axis, np.int32), np.array(lower, np.int32), np.array(split), np.array(chance))
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
        ({"axis": 6}, "axis is 0 to 6"),
        ({"lower": 2}, "does not come before its halves"),
        ({"lower": -1}, "does not come before its halves"),
        ({"split": 1.0}, "split is not between"),
        ({"chance": 0.0}, "chance is not between"),
        ({"chance": 1e-300}, "hardly any sets out"),
        ({"chance": 1.0 - 2.0**-53}, "hardly any sets out"),
        ({"chance": np.nan}, "chance is not between"),
    ],
)
def test_a_tree_that_cannot_be_walked_is_refused(changes: dict[str, Any], reason: str) -> None:
    with pytest.raises(ProtocolError, match=reason):
        packing.decode(packing.encode(setup(**changes)), ALL)


def chain(levels: int, chance: float = 0.5) -> p.Setup:
    """Photons of a tree each node of which is the lower half of the one before."""
    nodes = 2 * levels + 1
    lower = [
        number + 1 + number % 2 if number < nodes - 2 and (number % 2 or not number) else 0 for number in range(nodes)
    ]
    return setup_of([0] * nodes, lower, [0.5] * nodes, [chance] * nodes)


def test_a_tree_is_no_deeper_than_they_are_learnt() -> None:
    packing.decode(packing.encode(chain(STEERING_LEVELS)), ALL)
    with pytest.raises(ProtocolError, match="more than 20 levels"):
        packing.decode(packing.encode(chain(STEERING_LEVELS + 1)), ALL)


def test_weights_are_told_by_all_levels() -> None:
    """Each a hundredth of its node's photons in half of its room: 50, 2,500 and so on times the flux."""
    packing.decode(packing.encode(chain(3, 0.01)), ALL)
    with pytest.raises(ProtocolError, match="hardly any sets out"):
        packing.decode(packing.encode(chain(4, 0.01)), ALL)


def test_a_half_is_of_one_node() -> None:
    with pytest.raises(ProtocolError, match="a half of two"):
        packing.decode(packing.encode(setup_of([0] * 5, [1, 3, 3, 0, 0], [0.5] * 5, [0.5] * 5)), ALL)
