"""Kernels that are called without Warp compute the same, and what is not as expected is left to Warp."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
import warp as wp

from wdpm.kernels import columns, quick_launch
from wdpm.kernels.host_arrays import ALIGNMENT, HostArray, room
from wdpm.kernels.launch import Launcher
from wdpm.kernels.warp_versions import is_tried

ITEMS = 5


@wp.struct
class Weights:
    """What a kernel takes as a struct."""

    scale: wp.float32
    shift: wp.array[wp.vec3]


@wp.kernel
def weigh(
    weights: Weights,
    x: wp.array[wp.float32],
    flag: wp.bool,
    seed: wp.uint32,
    offset: wp.int32,
    sum_out: wp.array[wp.vec3],
) -> None:
    """A kernel with an argument of each kind."""
    i = offset + wp.tid()
    value = weights.scale * x[i] + float(seed)
    if flag:
        value = -value
    sum_out[i] = weights.shift[i] + wp.vec3(value, 0.0, 1.0)


def launched(times: int, x: object) -> list[np.ndarray]:
    """What several launches of the same wrote."""
    weights = Weights()
    weights.scale = 2.0
    weights.shift = wp.array(np.arange(3 * ITEMS, dtype=np.float32).reshape(-1, 3), dtype=wp.vec3, device="cpu")
    found = []
    for time in range(times):
        made = columns.outputs({"sum": wp.vec3}, ITEMS, "cpu")["sum"]
        arguments = {"weights": weights, "x": x, "flag": time % 2 == 1, "seed": time, "sum_out": made}
        Launcher("cpu", 1)(weigh, ITEMS, **arguments)
        found.append(made.numpy())
    return found


def expected(time: int) -> np.ndarray:
    """What the kernel writes in a launch."""
    wanted = np.arange(3 * ITEMS, dtype=np.float32).reshape(-1, 3)
    wanted[:, 0] += (2 * np.arange(ITEMS) + time) * (-1 if time % 2 else 1)
    wanted[:, 2] += 1
    return wanted


@pytest.mark.parametrize("of_warp", [True, False])
def test_later_launches_write_what_the_first_would(of_warp: bool) -> None:
    x = np.arange(ITEMS, dtype=np.float32)
    items = wp.array(x, dtype=wp.float32, device="cpu") if of_warp else HostArray(x, wp.float32)
    for time, found in enumerate(launched(4, items)):
        np.testing.assert_array_equal(found, expected(time))
    assert (weigh in quick_launch._entries) == is_tried()


def test_what_a_kernel_was_first_launched_with_is_let_go() -> None:
    """Arrays of the first scene that a process rendered stayed in its memory, and open files with them, to its end."""
    quick_launch._entries.pop(weigh, None)
    x = wp.array(np.arange(ITEMS, dtype=np.float32), dtype=wp.float32, device="cpu")
    gone = weakref.ref(x)
    launched(2, x)
    assert (weigh in quick_launch._entries) == is_tried()
    del x
    gc.collect()
    assert gone() is None


def test_an_array_of_other_items_is_refused_by_every_launch() -> None:
    launched(1, HostArray(np.zeros(ITEMS, np.float32), wp.float32))
    with pytest.raises(RuntimeError, match="expects an array with dtype"):
        launched(1, wp.zeros(ITEMS, dtype=wp.int32, device="cpu"))


def test_nothing_is_launched_for_no_items() -> None:
    made = HostArray(np.ones((1, 3), np.float32), wp.vec3)
    weights = Weights()
    Launcher("cpu", 1).run(weigh, [(0, [weights, made, False, 0, 0, made])])
    assert made.numpy().tolist() == [[1.0, 1.0, 1.0]]


def test_arrays_of_one_block_are_apart_and_aligned() -> None:
    kinds = [wp.bool, wp.vec3, wp.int64]
    made = room(kinds, ITEMS)
    for number, array in enumerate(made):
        assert array.shape == (ITEMS,)
        assert len(array.numpy()) == ITEMS
        assert array.numpy().ctypes.data % ALIGNMENT == 0
        array.numpy()[...] = number
    assert [set(array.numpy().ravel().tolist()) for array in made] == [{False}, {1.0}, {2}]
    assert [len(array) for array in room(kinds, 0)] == [0, 0, 0]


def test_an_array_that_may_not_be_written_to_can_be_read() -> None:
    x = np.arange(ITEMS, dtype=np.float32)
    x.flags.writeable = False
    np.testing.assert_array_equal(launched(1, HostArray(x, wp.float32))[0], expected(0))
