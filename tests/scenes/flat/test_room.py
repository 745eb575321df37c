"""Arrays of a scene in files without names: the values of arrays in memory, wherever their pages are."""

from __future__ import annotations

import mmap
import os
from typing import Any

import numpy as np
import pytest

from wdpm.scenes import cornell_box
from wdpm.scenes.builtin.atrium import atrium
from wdpm.scenes.flat.arrays import ARRAYS
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.room import in_file, let_go, lies_in_file
from wdpm.scenes.model.scene import Scene

CAN_LET_GO = hasattr(mmap, "MADV_DONTNEED")


def test_what_has_left_memory_is_there_again() -> None:
    array = in_file((5000, 3), np.float32)
    array[:] = np.arange(15000).reshape(5000, 3)
    assert lies_in_file(array)
    for _ in range(2):
        assert let_go(array) == (array.nbytes if CAN_LET_GO else 0)
        np.testing.assert_array_equal(array.reshape(-1), np.arange(15000))
    array[1234] = -1.0
    let_go(array[1000:2000], array[:1])
    assert array[1234].tolist() == [-1.0] * 3
    assert array[1235].tolist() == [3705.0, 3706.0, 3707.0]


def test_a_part_of_an_array_in_a_file_is_let_go_by_itself() -> None:
    array = in_file((5000, 3), np.float32)
    part = array[4000:].reshape(-1)
    assert lies_in_file(part)
    assert let_go(part) == (part.nbytes if CAN_LET_GO else 0)


def test_of_arrays_in_memory_and_of_every_other_row_nothing_is_let_go() -> None:
    in_memory = np.ones((5000, 3))
    assert not lies_in_file(in_memory)
    assert let_go(in_memory, in_memory[10:]) == 0
    assert let_go(in_file((5000, 3), np.float32)[::2]) == 0


@pytest.mark.parametrize("shape", [(0,), (0, 3, 3), (5, 0)])
def test_an_empty_array_lies_nowhere(shape: tuple[int, ...]) -> None:
    array = in_file(shape, np.float32)
    assert array.shape == shape
    assert lies_in_file(array)
    assert let_go(array) == 0


def test_where_the_disk_is_full_arrays_are_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_room(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", no_room, raising=False)
    array = in_file((5000, 3), np.float32)
    array[:] = 1.0
    assert not lies_in_file(array)


def test_without_fallocate_a_file_is_filled_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "posix_fallocate", raising=False)
    array = in_file((1 << 20, 3), np.int32)
    assert lies_in_file(array)
    assert not array.any()
    array[-1] = 7
    let_go(array)
    assert array[-1].tolist() == [7, 7, 7]


@pytest.mark.parametrize("scene", [cornell_box((8, 8)), atrium(10_000)], ids=["cornell-box", "atrium"])
def test_a_scene_is_flattened_into_files_alike(scene: Scene) -> None:
    in_memory, in_files = flatten(scene).triangles, flatten(scene, room=in_file).triangles
    for name in ARRAYS:
        own = getattr(in_files, name)
        assert lies_in_file(own)
        np.testing.assert_array_equal(own, getattr(in_memory, name))
        assert own.dtype == getattr(in_memory, name).dtype
    if CAN_LET_GO:
        assert let_go(*(getattr(in_files, name) for name in ARRAYS)) == (in_files.nbytes - in_files.instances.nbytes)
    np.testing.assert_array_equal(in_files.materials, np.unique(in_memory.material))


def test_all_triangles_are_taken_where_they_lie_and_some_are_copied() -> None:
    triangles = flatten(cornell_box()).triangles
    whole = triangles.take(np.arange(len(triangles)))
    some = triangles.take(np.arange(1, len(triangles)))
    for name in ARRAYS:
        assert getattr(whole, name) is getattr(triangles, name)
        np.testing.assert_array_equal(getattr(some, name), getattr(triangles, name)[1:])
    assert not np.shares_memory(some.ids, triangles.ids)
