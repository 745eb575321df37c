"""Waiting batches: nothing gets lost, homes come first, and what goes the same way goes together."""

from __future__ import annotations

import numpy as np
from fake_worker import arrays
from hypothesis import given
from hypothesis import strategies as st

from wdpm.cluster.batch import TO_HOME, Batch, Kind
from wdpm.cluster.queues import Queues

small = st.integers(0, 2)
batches = st.lists(
    st.builds(
        lambda kind, count, task, home, cell: Batch(kind, task, home, cell, count + 1, arrays(kind, count)),
        st.sampled_from([Kind.PHOTON, Kind.LANDED, Kind.ENDED, Kind.LIT]),
        small,
        small,
        small,
        small,
    ),
    max_size=30,
)


def key(batch: Batch) -> tuple[Kind, int, int, int]:
    return batch.kind, batch.task, batch.home, batch.cell


@given(batches)
def test_what_goes_in_comes_out(put: list[Batch]) -> None:
    queues = Queues()
    queues.extend(put)
    taken: list[Batch] = []
    while queues:
        taken.append(queues.pop())
        taken[-1].check()
    homeward = [batch.kind in TO_HOME for batch in taken]
    assert homeward == sorted(homeward, reverse=True)
    assert len(taken) == len({key(batch) for batch in put})
    for batch in taken:
        sources = [source for source in put if key(source) == key(batch)]
        assert batch.credit == sum(source.credit for source in sources)
        for name, array in batch.arrays.items():
            np.testing.assert_array_equal(array, np.concatenate([source.arrays[name] for source in sources]))


def test_the_longest_goes_first() -> None:
    queues = Queues()
    for cell, count in ((2, 2), (0, 4), (1, 1), (2, 3)):
        queues.add(Batch(Kind.PHOTON, 1, 0, cell, 1, arrays(Kind.PHOTON, count)))
    assert [(batch.cell, len(batch)) for batch in (queues.pop(), queues.pop(), queues.pop())] == [
        (2, 5),
        (0, 4),
        (1, 1),
    ]
