"""Launches name the arguments of their kernel, and reach every item once however they are cut."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import warp as wp

from wdpm.kernels.launch import Launcher, share_out


@wp.kernel
def add(x: wp.array[wp.int32], y: wp.int32, offset: wp.int32, sum_out: wp.array[wp.int32]) -> None:
    """What a launch adds to each item of the output."""
    i = offset + wp.tid()
    sum_out[i] = sum_out[i] + x[i] + y


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("grain", [1, 64])
def test_every_item_is_reached_once(threads: int, grain: int) -> None:
    x = np.arange(1000, dtype=np.int32)
    total = wp.zeros(1000, dtype=wp.int32, device="cpu")
    Launcher("cpu", threads)(add, 1000, grain=grain, sum_out=total, y=7, x=wp.array(x, dtype=wp.int32, device="cpu"))
    np.testing.assert_array_equal(total.numpy(), x + 7)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("x", "sum_out"), r"missing: \['y'\], not known: \[\]"),
        (("x", "y", "sum_out", "z"), r"missing: \[\], not known: \['z'\]"),
        (("x", "z", "sum_out"), r"missing: \['y'\], not known: \['z'\]"),
        (("x", "y", "sum_out", "offset"), r"missing: \[\], not known: \['offset'\]"),
    ],
)
def test_arguments_that_are_not_the_kernels_are_refused(names: tuple[str, ...], said: str) -> None:
    with pytest.raises(TypeError, match=f"kernel add: arguments {said}"):
        Launcher("cpu", 1)(add, 1, **dict.fromkeys(names, 0))


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_functions_that_run_at_once_may_launch_and_give_what_they_give_in_their_order(threads: int) -> None:
    launcher = Launcher("cpu", threads)

    def sums(y: int) -> list[int]:
        total = wp.zeros(50, dtype=wp.int32, device="cpu")
        launcher(add, 50, grain=1, sum_out=total, y=y, x=wp.zeros(50, dtype=wp.int32, device="cpu"))
        return list(total.numpy())

    assert launcher.at_once(lambda: sums(3), lambda: launcher.at_once(lambda: sums(4), lambda: sums(5))) == [
        [3] * 50,
        [[4] * 50, [5] * 50],
    ]
    launcher.stop_threads()


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("which", [0, 1])
def test_what_one_of_several_functions_raises_is_raised_when_all_have_ended(threads: int, which: int) -> None:
    ended = []

    def end() -> None:
        ended.append(1)

    def fail() -> None:
        raise ZeroDivisionError("by nothing")

    with pytest.raises(ZeroDivisionError, match="by nothing"):
        Launcher("cpu", threads).at_once(*([fail, end] if which == 0 else [end, fail]))
    assert len(ended) == (1 if threads > 1 or which else 0)


def test_functions_that_run_at_once_do() -> None:
    """Each waits for the other."""
    meeting = threading.Barrier(2, timeout=60)
    Launcher("cpu", 2).at_once(meeting.wait, meeting.wait)


def test_launches_are_shared_out_to_this_thread_and_others() -> None:
    """As many are under way at once as there are threads, and each is done once."""
    meeting, threads = threading.Barrier(3, timeout=60), set()
    done: list[int] = []

    def do(size: int, inputs: Sequence[int]) -> None:
        if size == 0:
            meeting.wait()
            threads.add(threading.get_ident())
        done.extend(inputs)

    with ThreadPoolExecutor(3) as pool:
        share_out(pool, 3, do, [(0, [0]), (0, [1]), (0, [2]), *((1, [item]) for item in range(3, 20))])
    assert sorted(done) == list(range(20))
    assert len(threads) == 3
    assert threading.get_ident() in threads


def test_this_thread_does_all_where_others_are_busy() -> None:
    leave, done = threading.Event(), []
    with ThreadPoolExecutor(1) as pool:
        busy = pool.submit(leave.wait, 60)
        share_out(pool, 2, lambda size, _: done.append(size), [(1, []), (2, []), (3, [])])
        assert not busy.done()
        leave.set()
    assert done == [1, 2, 3]


@pytest.mark.parametrize("failing", range(3))
def test_what_a_launch_raises_is_raised_on_whichever_thread(failing: int) -> None:
    meeting = threading.Barrier(3, timeout=60)
    ended = []

    def do(size: int, _: object) -> None:
        meeting.wait()  # so that each is on a thread of its own
        if size == failing:
            raise ZeroDivisionError("by nothing")
        ended.append(size)

    with ThreadPoolExecutor(2) as pool, pytest.raises(ZeroDivisionError, match="by nothing"):
        share_out(pool, 3, do, [(size, []) for size in range(3)])
    assert sorted(ended) == [size for size in range(3) if size != failing]
