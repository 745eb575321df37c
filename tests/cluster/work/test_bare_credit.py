"""Credit that brings nothing along travels with batches to the same home."""

from __future__ import annotations

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from wdpm.cluster.batch import TO_HOME, Batch, Kind, zeros
from wdpm.cluster.queues import without_bare_credit

KINDS = st.sampled_from([Kind.ENDED, Kind.LIT, Kind.SAMPLES, Kind.PATH, Kind.PHOTON, Kind.LANDED])
BATCHES = st.lists(st.tuples(KINDS, st.integers(0, 2), st.integers(0, 1), st.integers(0, 2), st.integers(1, 9)))


def made(kind: Kind, task: int, home: int, cell: int, credit: int) -> Batch:
    return Batch.of_task(kind, task, home, cell, credit, zeros(kind, 1) if kind is not Kind.ENDED else {})


@given(BATCHES)
def test_no_credit_is_lost_and_none_travels_alone_that_need_not(
    parts: list[tuple[Kind, int, int, int, int]],
) -> None:
    before = [made(*part) for part in parts]
    after = without_bare_credit(before)
    assert _credit(after) == _credit(before)
    assert [b.arrays for b in after if b.arrays] == [b.arrays for b in before if b.arrays]
    assert [b.credit for b in after if b.kind is Kind.PATH] == [b.credit for b in before if b.kind is Kind.PATH]
    going = Counter(b.home for b in after if b.kind in TO_HOME and b.kind is not Kind.ENDED)
    bare = Counter(b.home for b in after if b.kind is Kind.ENDED)
    assert not going.keys() & bare.keys()
    assert set(bare.values()) <= {1}
    assert not _tasks(after, {Kind.ENDED}) & _tasks(before, {Kind.PHOTON, Kind.LANDED})


def test_credit_of_photons_that_ended_flies_with_others_of_their_task() -> None:
    ended = [made(Kind.ENDED, task, 0, 0, 5) for task in (1, 2)]
    photons = [made(Kind.PHOTON, task, 0, 0, 1) for task in (2, 3)]
    after = without_bare_credit([*ended, *photons])
    assert [(batch.kind, batch.runs.table.tolist()) for batch in after] == [
        (Kind.PHOTON, [[0, 2, 1, 6]]),
        (Kind.PHOTON, [[0, 3, 1, 1]]),
        (Kind.ENDED, [[0, 1, 0, 5]]),
    ]


def _credit(batches: list[Batch]) -> Counter[tuple[int, int]]:
    """Of results and photons, by home and task."""
    credit: Counter[tuple[int, int]] = Counter()
    for batch in batches:
        if batch.kind is not Kind.PATH:
            for home, task, _, share in batch.runs.table.tolist():
                credit[home, task] += share
    return credit


def _tasks(batches: list[Batch], kinds: set[Kind]) -> set[tuple[int, int]]:
    """Home and task of every run of some kinds."""
    runs = [run for batch in batches if batch.kind in kinds for run in batch.runs.table.tolist()]
    return {(home, task) for home, task, _, _ in runs}
