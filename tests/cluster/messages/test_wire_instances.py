"""Instances come over the wire as they were, and broken ones are refused before anyone computes with them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wdpm.cluster.master.cells import parts_of
from wdpm.cluster.messages import packing
from wdpm.cluster.messages.protocol import Partition
from wdpm.cluster.slave.cells import join
from wdpm.scenes.builtin.forest import forest
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.instances import Instances

TRIANGLES = flatten(forest(4, (8, 5))).triangles


def sent(triangles: Triangles, size: int = 450_000) -> Triangles:
    """What a slave makes of the triangles of a cell."""
    parts = []
    for message in parts_of(0, 0, triangles, size):
        frames = [bytes(frame) for frame in packing.encode(message)]
        parts.append(packing.decode(frames, {"Partition": Partition}).triangles)
    return join(parts)


@pytest.mark.parametrize("size", [450_000, 1])
def test_they_come_as_they_were(size: int) -> None:
    came = sent(TRIANGLES, size)
    assert came.total == TRIANGLES.total
    np.testing.assert_array_equal(came.positions, TRIANGLES.positions)
    for name, values in vars(TRIANGLES.instances).items():
        if name != "shapes":
            np.testing.assert_array_equal(getattr(came.instances, name), values)
    for name, values in vars(TRIANGLES.instances.shapes).items():
        np.testing.assert_array_equal(getattr(came.instances.shapes, name), values)


def test_a_cell_has_the_shapes_of_its_instances_alone() -> None:
    leaves = TRIANGLES.instances.take(np.array([3, 5]))
    assert len(leaves.shapes) == 1
    np.testing.assert_array_equal(leaves.positions(1), TRIANGLES.instances.positions(5))
    np.testing.assert_array_equal(leaves.ids(0), TRIANGLES.instances.ids(3))


def changed(name: str, value: Any) -> Instances:
    return replace(TRIANGLES.instances, **{name: value})


OWN = TRIANGLES.instances


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        (changed("shape", OWN.shape + 1), "shape is"),
        (changed("base", OWN.base // 2), "overlap"),
        (changed("mirrored", OWN.mirrored + 2), "mirrored is"),
        (changed("matrix", OWN.matrix * 0.0), "without an inverse"),
        (changed("matrix", OWN.matrix * np.nan), "without an inverse"),
        (changed("matrix", OWN.matrix[1:]), "shape"),
        (changed("area", -OWN.area), "an area before a triangle"),
        (changed("area_before", OWN.area_before + np.nan), "an area before a triangle"),
        (changed("shapes", replace(OWN.shapes, share_before=OWN.shapes.share_before + 1.0)), "share_before"),
        (changed("shapes", replace(OWN.shapes, first=OWN.shapes.first + 1)), "first does not go"),
        (changed("shapes", replace(OWN.shapes, first=OWN.shapes.first[[0, 0, 2]])), "not ascending"),
        (changed("shapes", replace(OWN.shapes, corners=np.full_like(OWN.shapes.corners, np.inf))), "not finite"),
    ],
)
def test_broken_ones_are_refused(broken: Instances, words: str) -> None:
    with pytest.raises(ProtocolError, match=words):
        sent(TRIANGLES.with_instances(broken))
