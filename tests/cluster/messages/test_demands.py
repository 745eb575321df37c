"""Ranges of numbers that came over the wire: the first outside is found, wherever it stands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wdpm.cluster.messages.demands import indices
from wdpm.scenes.errors import ProtocolError


@given(st.lists(st.integers(-(2**31), 2**31 - 1), max_size=9), st.integers(-5, 5), st.integers(-5, 2**31))
def test_whole_numbers_are_in_their_range_or_said_to_be_outside(numbers: list[int], least: int, end: int) -> None:
    if all(least <= number < end for number in numbers):
        indices(np.array(numbers, np.int32), least, end, "there")
        return
    with pytest.raises(ProtocolError, match=rf"there is {min(numbers)} to {max(numbers)}; expected {least} to less"):
        indices(np.array(numbers, np.int32), least, end, "there")


@pytest.mark.parametrize("weight", [np.nan, np.inf, -np.inf, 2.0, -1.5])
@pytest.mark.parametrize("place", range(3))
def test_weights_that_are_outside_or_no_number_are_refused(weight: float, place: int) -> None:
    weights = np.array([-1.0, 0.5, np.nextafter(np.float32(2), np.float32(0))], np.float32)
    indices(weights, -1, 2, "there")
    weights[place] = weight
    with pytest.raises(ProtocolError, match="expected -1 to less than 2"):
        indices(weights, -1, 2, "there")


def test_a_table_is_looked_at_whole() -> None:
    table = np.zeros((3, 4), np.int64)
    indices(table, 0, 1, "there")
    table[2, 1] = 2**40
    with pytest.raises(ProtocolError, match="there is 0 to 1099511627776"):
        indices(table, 0, 1, "there")
