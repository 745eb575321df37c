"""Checks of batches that came over the wire: whose their rows are said to be."""

from __future__ import annotations

from typing import Final

from wdpm.cluster.batch import TO_HOME, Batch
from wdpm.cluster.messages.demands import require
from wdpm.cluster.runs import COLUMNS, HOME, ROWS, Runs
from wdpm.scenes.errors import ProtocolError

LARGEST_NUMBER: Final = 1 << 48
"""In a table of runs. Sums of as many as a message can hold do not overflow."""


def check_runs(runs: Runs, where: str) -> None:
    """Raise ProtocolError unless a table of runs says something that can be, in the order that is due."""
    table = runs.table
    if table.ndim != 2 or table.shape[1] != COLUMNS:
        raise ProtocolError(f"{where}: a table of runs of shape {table.shape}")
    require(len(table) > 0, where, "a batch without a run")
    before = before_task = -2
    for home, task, rows, credit in table.tolist():  # few: NumPy would take ten times as long
        if not (-1 <= home < LARGEST_NUMBER and -1 <= task < LARGEST_NUMBER) or not (
            -1 <= rows < LARGEST_NUMBER and -1 <= credit < LARGEST_NUMBER
        ):
            least, most = min(home, task, rows, credit), max(home, task, rows, credit)
            raise ProtocolError(f"{where}: numbers from {least} to {most} in a table of runs")
        if rows < 0 or credit < 0:
            raise ProtocolError(f"{where}: a run with rows or credit below 0")
        if home < before or (home == before and task <= before_task):
            raise ProtocolError(f"{where}: runs that are not in the order of their homes and tasks")
        before, before_task = home, task


def check_whole(batch: Batch, where: str) -> None:
    """Raise ProtocolError unless runs go with the batch's kind, and are as long as its arrays, which do."""
    table = batch.runs.table
    one = len(table) == 1  # most times
    rows = table.item(0, ROWS) if one else int(batch.runs.rows.sum())
    if rows != len(batch):
        raise ProtocolError(f"{where}: runs of {rows} rows; there are {len(batch)}")
    if batch.kind in TO_HOME and not one and table.item(0, HOME) != table.item(-1, HOME):
        raise ProtocolError(f"{where}: results for several homes")
