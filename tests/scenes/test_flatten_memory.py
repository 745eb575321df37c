"""A scene is flattened without being held twice."""

from __future__ import annotations

import tracemalloc

import numpy as np

from wdpm.scenes import load
from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.dropped import repeated
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.room import in_file


def test_flattening_takes_little_more_than_its_arrays() -> None:
    scene = load("atrium:200k")
    flatten(scene)  # what is made once, such as tables, is there
    tracemalloc.start()
    try:
        flat = flatten(scene)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak <= 1.8 * flat.triangles.nbytes


def test_in_files_a_scene_takes_less_memory_than_its_arrays() -> None:
    scene = load("atrium:200k")
    flatten(scene)
    tracemalloc.start()
    try:
        flat = flatten(scene, room=in_file)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak <= 0.7 * flat.triangles.nbytes


def test_areas_take_no_copy_of_the_corners_in_double() -> None:
    corners = np.random.default_rng(1).random((300_000, 3, 3), np.float32)
    tracemalloc.start()
    try:
        areas = triangle_areas(corners)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak <= areas.nbytes + 300 * (1 << 16)
    a, b, c = corners[-1].astype(np.float64)
    assert areas[-1] == np.linalg.norm(np.cross(b - a, c - a)) / 2


def test_repeated_triangles_are_found_among_very_many() -> None:
    corners = np.random.default_rng(2).random((100_000, 3, 3), np.float32)
    corners[70_000] = corners[5][[2, 0, 1]]
    corners[90_000] = corners[5]
    corners[90_001] = corners[90_000][[0, 0, 1]]  # two of the same places only
    assert np.flatnonzero(repeated(corners)).tolist() == [70_000, 90_000]
