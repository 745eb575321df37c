"""Counts that are taken away and added elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wdpm.cluster.work import tally
from wdpm.cluster.work.tally import Number

COUNTS = st.integers(0, 10**12)


@dataclass
class Figures:
    items: int = 0
    seconds: float = 0.0
    by_kind: np.ndarray = field(default_factory=lambda: np.zeros((2, 2), np.int64))


class Counting:
    def __init__(self, items: int, causes: dict[str, int], kinds: list[int]) -> None:
        self.busy = 0.5 * items
        self.array = np.array(kinds, np.int64)
        self.causes = dict(causes)
        self.figures = Figures(items, 0.25 * items, np.full((2, 2), items))

    @property
    def counters(self) -> list[tally.Counter]:
        return [Number(self, "busy"), self.array, self.causes, self.figures]

    def values(self) -> list[object]:
        return tally.read(self.counters)


counting = st.builds(
    Counting, COUNTS, st.dictionaries(st.sampled_from("abc"), COUNTS), st.lists(COUNTS, min_size=3, max_size=3)
)


@given(counting, counting)
def test_what_is_taken_from_one_and_added_to_another_is_their_sum(one: Counting, other: Counting) -> None:
    expected = Counting(0, {}, [0, 0, 0])
    for part in (one, other):
        tally.add(expected.counters, part.values())
    taken = one.values()
    tally.clear(one.counters)
    tally.add(other.counters, taken)
    assert other.values() == expected.values()
    assert other.figures.items == expected.figures.items
    assert isinstance(other.figures.items, int)


@given(counting)
def test_nothing_is_left_of_what_was_cleared(one: Counting) -> None:
    tally.clear(one.counters)
    assert one.values() == Counting(0, {}, [0, 0, 0]).values()
