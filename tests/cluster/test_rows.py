"""Rows of arrays against NumPy's plain ways."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wdpm.cluster.batch import by_destination, take_in_order
from wdpm.cluster.rows import any_of, in_order, largest_of, put_rows, summed, take_rows
from wdpm.cluster.runs import Runs
from wdpm.scenes.errors import ProtocolError

RNG = np.random.default_rng(3)
VECTORS = RNG.normal(size=(50, 3)).astype(np.float32) * RNG.integers(0, 2, (50, 3)).astype(np.float32)


@pytest.mark.parametrize("array", [VECTORS, VECTORS[:, 0].copy(), np.arange(50)])
@pytest.mark.parametrize("rows", [[], [3], [49, 0, 7]])
def test_taken_and_put(array: np.ndarray, rows: list[int]) -> None:
    where = np.array(rows, np.intp)
    taken = take_rows(array, where)
    assert np.array_equal(taken, array[where])
    taken += 1  # a copy
    expected, found = array.copy(), array.copy()
    expected[where] = taken
    put_rows(found, where, taken)
    assert np.array_equal(found, expected)


def test_a_row_that_is_not_there() -> None:
    with pytest.raises(IndexError):
        take_rows(VECTORS, np.array([50]))
    with pytest.raises(IndexError):
        put_rows(VECTORS.copy(), np.array([50]), VECTORS[:1])


def test_vectors() -> None:
    odd = np.concatenate([VECTORS, np.array([[0, np.nan, 0], [-0.0, 0, 0], [np.inf, 0, 0]], np.float32)])
    assert np.array_equal(any_of(odd), odd.any(axis=1))
    assert np.array_equal(largest_of(odd), odd.max(axis=1), equal_nan=True)


@pytest.mark.parametrize("most", [3, np.iinfo(np.int32).max])
def test_order_is_by_slot_then_place_then_as_they_come(most: int) -> None:
    slot, place = (RNG.integers(0, 4, 400).astype(np.int32) for _ in range(2))
    place[::7], slot[::5] = np.iinfo(np.int32).max, most
    assert np.array_equal(in_order(slot, place), np.lexsort((place, slot)))
    assert not len(in_order(slot[:0], place[:0]))


def test_sums_are_those_of_one_addition_after_another() -> None:
    slot = np.sort(RNG.integers(0, 9, 200)).astype(np.int32)
    vectors = (RNG.normal(size=(200, 3)) * 10.0 ** RNG.integers(-20, 20, (200, 1))).astype(np.float32)
    expected = np.zeros((12, 3))
    np.add.at(expected, slot, vectors.astype(np.float64))
    assert summed(slot, vectors, 12).tobytes() == expected.tobytes()


def test_rows_of_all_columns_in_the_order_of_one() -> None:
    arrays = {"prim": np.array([5, 2, 9, 2, 0], np.int32), "origin": VECTORS[:5], "slot": np.arange(5, dtype=np.int32)}
    taken = take_in_order(arrays, np.array([0, 1, 2, 3]), "prim", Runs.one(0, 0, 4, 4))
    assert taken["prim"].tolist() == [2, 2, 5, 9]
    assert sorted(taken["slot"].tolist()) == [0, 1, 2, 3]
    for name, column in arrays.items():
        assert np.array_equal(taken[name], column[taken["slot"]])


def test_rows_of_each_run_stay_together() -> None:
    arrays = {"prim": np.array([5, 2, 9, 2, 0], np.int32), "slot": np.arange(5, dtype=np.int32)}
    runs = Runs(np.array([[0, 1, 2, 2], [0, 2, 2, 2]], np.int64))
    assert take_in_order(arrays, np.array([0, 1, 2, 4]), "prim", runs)["prim"].tolist() == [2, 5, 0, 9]


CELLS = st.integers(0, 3) | st.sampled_from([255, 256, 65_535, 65_536])


@given(st.lists(st.tuples(CELLS, st.booleans()) | st.tuples(st.just(-1), st.just(False)), max_size=30))
def test_chosen_rows_go_to_their_destinations_in_order(rows: list[tuple[int, bool]]) -> None:
    destination = np.array([where for where, _ in rows], np.int32)
    chosen = np.array([is_chosen for _, is_chosen in rows], np.bool_)
    found = {cell: list(which) for cell, which in by_destination(destination, chosen)}
    expected: dict[int, list[int]] = {}
    for row, (where, is_chosen) in enumerate(rows):
        if is_chosen:
            expected.setdefault(where, []).append(row)
    assert found == expected
    assert list(found) == sorted(found)


def test_where_rows_go_takes_no_memory_whatever_somebody_sends() -> None:
    far = np.array([0, 2**31 - 1, 0], np.int32)
    tracemalloc.start()
    found = [(cell, list(rows)) for cell, rows in by_destination(far, np.ones(3, np.bool_))]
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found == [(0, [0, 2]), (2**31 - 1, [1])]
    assert most < 1 << 20


def test_no_chosen_row_goes_nowhere() -> None:
    for chosen in ([True, True], [False, True]):
        with pytest.raises(ProtocolError, match="on its way to cell -1"):
            list(by_destination(np.array([3, -1], np.int32), np.array(chosen)))


def test_nothing_adds_up_to_zeros_in_double() -> None:
    light = summed(np.zeros(0, np.int32), np.zeros((0, 3), np.float32), 4)
    assert (light.dtype, light.tolist()) == (np.float64, [[0.0] * 3] * 4)
