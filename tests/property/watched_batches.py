"""Every batch that a cell makes of another, looked at."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from wdpm.cluster.batch import Batch
from wdpm.cluster.messages.checks import check_batch
from wdpm.cluster.work.cell import Cell


def watch_batches(patch: pytest.MonkeyPatch, look: Callable[[Batch], object] = lambda _: None) -> None:
    """Check all that cells yield from now on, and show it to `look`.

    Each batch must be valid, and carry credit: what has none may come home after its task has ended, when nobody waits
    for it any more. Together they carry as much as the batch that they follow from.
    """
    advance = Cell.advance

    def watched(cell: Cell, batch: Batch) -> list[Batch]:
        follows = list(advance(cell, batch))
        assert all(following.credit > 0 for following in follows), batch.kind
        assert sum(following.credit for following in follows) == batch.credit, batch.kind
        for following in follows:
            following.check()
            check_batch(following, cell.replica.world)
            look(following)
        return follows

    patch.setattr(Cell, "advance", watched)
