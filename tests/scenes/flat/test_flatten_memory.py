"""A scene is flattened without being held twice."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import pytest

from wdpm.scenes import load
from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.dropped import repeated
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.room import Room, in_file

Made = TypeVar("Made")


def with_peak(make: Callable[[], Made]) -> tuple[Made, int]:
    """What is made, and the most memory that Python had meanwhile [bytes]."""
    tracemalloc.start()
    try:
        return make(), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("room", "share"), [(np.empty, 1.8), (in_file, 0.7)], ids=["memory", "file"])
def test_flattening_takes_little_more_than_its_arrays_and_less_in_files(room: Room, share: float) -> None:
    scene = load("atrium:200k")
    flatten(scene)  # what is made once, such as tables, is there
    flat, peak = with_peak(lambda: flatten(scene, room=room))
    assert peak <= share * flat.triangles.nbytes


def test_areas_take_no_copy_of_the_corners_in_double() -> None:
    corners = np.random.default_rng(1).random((300_000, 3, 3), np.float32)
    areas, peak = with_peak(lambda: triangle_areas(corners))
    assert peak <= areas.nbytes + 300 * (1 << 16)
    a, b, c = corners[-1].astype(np.float64)
    assert areas[-1] == np.linalg.norm(np.cross(b - a, c - a)) / 2


def test_repeated_triangles_are_found_among_very_many() -> None:
    corners = np.random.default_rng(2).random((100_000, 3, 3), np.float32)
    corners[70_000] = corners[5][[2, 0, 1]]
    corners[90_000] = corners[5]
    corners[90_001] = corners[90_000][[0, 0, 1]]  # two of the same places only
    assert np.flatnonzero(repeated(corners)).tolist() == [70_000, 90_000]
