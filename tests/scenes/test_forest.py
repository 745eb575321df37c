"""The built-in forest: one tree that is held once, in many places."""

from __future__ import annotations

import pytest

from wdpm.scenes.builtin.forest import TREE_TRIANGLES
from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.reach import instance_boxes
from wdpm.scenes.load import load


def test_trees_are_held_once() -> None:
    triangles = flatten(load("forest:9", size=(8, 5))).triangles
    assert triangles.total == 9 * TREE_TRIANGLES + 2
    assert triangles.held == TREE_TRIANGLES + 2
    assert len(triangles.instances) == 18
    assert triangles.nbytes < 24e6


def test_boxes_of_trees_hold_their_triangles() -> None:
    instances = flatten(load("forest:5", size=(8, 5))).triangles.instances
    low, high = instance_boxes(instances)
    for number in range(len(instances)):
        positions = instances.positions(number)
        assert (positions.min(axis=(0, 1)) >= low[number]).all()
        assert (positions.max(axis=(0, 1)) <= high[number]).all()
        assert (high[number] - low[number] < 3 * (positions.max(axis=(0, 1)) - positions.min(axis=(0, 1)))).all()


@pytest.mark.parametrize("name", ["forest:0", "forest:21k", "forest:", "forest:many"])
def test_forests_that_cannot_be(name: str) -> None:
    with pytest.raises(SceneError) as raised:
        load(name)
    assert "trees" in str(raised.value)
