"""Waiting batches: nothing gets lost, homes come first, and what goes the same way goes together."""

from __future__ import annotations

from collections import Counter

import numpy as np
from fake_worker import arrays
from hypothesis import given
from hypothesis import strategies as st

from wdpm.cluster.batch import TO_HOME, Batch, Kind, pieces
from wdpm.cluster.messages.batch_checks import check_runs, check_whole
from wdpm.cluster.queues import Queues

small = st.integers(0, 2)
batches = st.lists(
    st.builds(
        lambda kind, count, task, home, cell: Batch.of_task(kind, task, home, cell, count + 1, arrays(kind, count)),
        st.sampled_from([Kind.PHOTON, Kind.LANDED, Kind.ENDED, Kind.LIT]),
        small,
        small,
        small,
        small,
    ),
    max_size=30,
)


def key(batch: Batch) -> tuple[Kind, int]:
    return batch.kind, batch.home if batch.kind in TO_HOME else batch.cell


def rows_of(batch: Batch) -> list[tuple[int, int, bytes]]:
    """Home, task and all that is in it, of each row."""
    whose = [(home, task) for home, task, rows, _ in batch.runs.table.tolist() for _ in range(rows)]
    columns = [np.ascontiguousarray(array) for array in batch.arrays.values()]
    return [(*task, b"".join(column[row].tobytes() for column in columns)) for row, task in enumerate(whose)]


def credit_of(taken: list[Batch]) -> Counter[tuple[int, int]]:
    credit: Counter[tuple[int, int]] = Counter()
    for batch in taken:
        for home, task, _, share in batch.runs.table.tolist():
            credit[home, task] += share
    return credit


@given(batches)
def test_what_goes_in_comes_out(put: list[Batch]) -> None:
    for number, batch in enumerate(put):  # so that no row is like those of another batch
        for array in batch.arrays.values():
            array[...] = number
    queues = Queues()
    queues.extend(put)
    taken: list[Batch] = []
    while queues:
        taken.append(queues.pop())
        check_whole(taken[-1], "a batch")
        check_runs(taken[-1].runs, "runs")
    homeward = [batch.kind in TO_HOME for batch in taken]
    assert homeward == sorted(homeward, reverse=True)
    assert len(taken) == len({key(batch) for batch in put})
    for batch in taken:
        sources = [source for source in put if key(source) == key(batch)]
        assert credit_of([batch]) == credit_of(sources)
        rows = [row for source in sources for row in rows_of(source)]
        assert rows_of(batch) == sorted(rows, key=lambda row: row[:2]), "those of a task stay in their order"


def test_the_longest_goes_first() -> None:
    queues = Queues()
    for cell, count in ((2, 2), (0, 4), (1, 1), (2, 3)):
        queues.add(Batch.of_task(Kind.PHOTON, 1, 0, cell, 1, arrays(Kind.PHOTON, count)))
    assert [(batch.cell, len(batch)) for batch in (queues.pop(), queues.pop(), queues.pop())] == [
        (2, 5),
        (0, 4),
        (1, 1),
    ]


@given(batches, st.integers(1, 4))
def test_a_long_queue_is_taken_in_pieces_of_whole_batches(put: list[Batch], most: int) -> None:
    queues = Queues()
    queues.extend(put)
    taken: list[Batch] = []
    while queues:
        before = queues.rows
        some = queues.take(most)
        assert some
        assert queues.rows == before - sum(map(len, some))
        assert sum(map(len, some[:-1])) < most
        taken += some
    assert credit_of(taken) == credit_of(put)
    assert sum(map(len, taken)) == sum(map(len, put))


def test_what_came_first_is_taken_first_and_a_batch_is_not_cut() -> None:
    queues = Queues()
    for task, count in enumerate((3, 2, 2, 9)):
        queues.add(Batch.of_task(Kind.PHOTON, task, 0, 1, 1, arrays(Kind.PHOTON, count)))
    taken = [queues.pop(5), queues.pop(5), queues.pop(5)]
    assert [batch.runs.task.tolist() for batch in taken] == [[0, 1], [2], [3]]
    assert not queues


@given(st.integers(0, 50), st.integers(1, 9), st.integers(1, 20))
def test_pieces_have_the_rows_and_the_credit_of_the_whole(count: int, unit: int, most: int) -> None:
    whole = Batch.of_task(Kind.PHOTON, 3, 2, 1, count * unit, arrays(Kind.PHOTON, count))
    whole.arrays["path"][:] = np.arange(count)
    found = list(pieces(whole, most))
    assert [(piece.kind, piece.cell, piece.home) for piece in found] == [(Kind.PHOTON, 1, 2)] * len(found)
    assert all(len(piece) <= most and piece.credit == len(piece) * unit for piece in found)
    assert np.concatenate([piece.arrays["path"] for piece in found]).tolist() == list(range(count))


@given(st.lists(st.integers(1, 7), min_size=1, max_size=20), st.booleans(), st.integers(1, 20))
def test_samples_that_set_out_together_stay_together(counts: list[int], alone: bool, most: int) -> None:
    """Pixels of so many samples, the last ones perhaps each on its own."""
    together = np.concatenate([[count, *[0] * (count - 1)] for count in counts] + [[0] * 5 if alone else []])
    whole = Batch.of_task(Kind.START, 3, 2, 1, len(together), arrays(Kind.START, len(together)))
    whole.arrays["together"][:] = together
    found = [piece.arrays["together"] for piece in pieces(whole, most)]
    assert np.array_equal(np.concatenate(found), together)
    for first in found:
        begins = np.flatnonzero(first)
        assert (begins + first[begins] <= len(first)).all()
    assert all(len(piece) <= max(most, *counts, 1) for piece in found)


def test_a_batch_whose_credit_is_not_that_of_its_rows_stays_whole() -> None:
    probe = Batch.of_task(Kind.PROBE, 3, 2, 1, 1, arrays(Kind.PROBE, 10))
    assert list(pieces(probe, 4)) == [probe]
