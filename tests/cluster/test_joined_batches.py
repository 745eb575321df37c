"""Batches of several tasks as one: each row stays with its task, in the order in which the batches came."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.cluster.batch import Batch, Kind, joined
from wdpm.cluster.runs import Runs

HOMES, TASKS = 2, 3


def batch_of(runs: list[tuple[int, int, int, int]], first: int) -> Batch:
    """Lit parts whose slots count on from `first`, and whose radiance tells slot and task.

    Args:
        runs: home, task, rows and credit of each.
    """
    table = np.array(runs, np.int64)
    slot = np.arange(first, first + table[:, 2].sum(), dtype=np.int32)
    task = np.repeat(table[:, 1], table[:, 2])
    radiance = np.stack([slot, task, slot * 0], axis=1).astype(np.float32)
    return Batch(Kind.LIT, 0, Runs(table), {"slot": slot, "place": slot + 1, "radiance": radiance})


def rows_by_task(batches: list[Batch]) -> dict[tuple[int, int], list[int]]:
    """Slots of each home and task, in the order of the batches."""
    found: dict[tuple[int, int], list[int]] = {}
    for batch in batches:
        for (home, task, *_), begin, end in zip(
            batch.runs.table.tolist(), batch.runs.bounds[:-1], batch.runs.bounds[1:], strict=True
        ):
            found.setdefault((home, task), []).extend(batch.arrays["slot"][begin:end].tolist())
    return found


@pytest.mark.parametrize(("most", "rows"), [(5, 4), (5, 300), (20, 4), (20, 300)])
def test_each_row_stays_with_its_task(most: int, rows: int) -> None:
    """Few runs and many, of few rows and many: each is joined in the way that is quickest."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        batches = []
        for number in range(rng.integers(1, most + 1)):
            chosen = np.sort(rng.permutation(HOMES * TASKS)[: rng.integers(1, 5)])
            runs = [
                (int(c) // TASKS, int(c) % TASKS, int(rng.integers(0, rows)), int(rng.integers(0, 9))) for c in chosen
            ]
            batches.append(batch_of(runs, 10000 * number))
        whole = joined(batches)
        whole.check()
        assert rows_by_task([whole]) == rows_by_task(batches)
        assert whole.credit == sum(batch.credit for batch in batches)
        assert (whole.arrays["radiance"][:, 0] == whole.arrays["slot"]).all()
        assert (whole.arrays["radiance"][:, 1] == np.repeat(whole.runs.task, whole.runs.rows)).all()
        if len(batches) > 1:
            keys = whole.runs.home * TASKS + whole.runs.task
            assert (np.diff(keys) > 0).all()


def test_batches_in_order_are_put_one_behind_another() -> None:
    first, second = batch_of([(0, 0, 2, 1), (0, 1, 1, 0)], 0), batch_of([(0, 1, 2, 4), (1, 0, 0, 3)], 10)
    whole = joined([first, second])
    assert whole.arrays["slot"].tolist() == [0, 1, 2, 10, 11]
    assert whole.runs.table.tolist() == [[0, 0, 2, 1], [0, 1, 3, 4], [1, 0, 0, 3]]
