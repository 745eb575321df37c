"""Checks of batches that came over the wire: whose their rows are said to be."""

from __future__ import annotations

from typing import Final

from wdpm.cluster.batch import TO_HOME, Batch
from wdpm.cluster.messages.demands import require
from wdpm.cluster.runs import COLUMNS, Runs
from wdpm.scenes.errors import ProtocolError

LARGEST_NUMBER: Final = 1 << 48
"""In a table of runs. Sums of as many as a message can hold do not overflow."""


def check_runs(runs: Runs, where: str) -> None:
    """Raise ProtocolError unless a table of runs says something that can be, in the order that is due."""
    table = runs.table
    require(table.ndim == 2 and table.shape[1:] == (COLUMNS,), where, f"a table of runs of shape {table.shape}")
    require(len(table) > 0, where, "a batch without a run")
    before = (-2, -2)
    for home, task, rows, credit in table.tolist():  # few: NumPy would take ten times as long
        least, most = min(home, task, rows, credit), max(home, task, rows, credit)
        if least < -1 or most >= LARGEST_NUMBER:
            raise ProtocolError(f"{where}: numbers from {least} to {most} in a table of runs")
        if min(rows, credit) < 0:
            raise ProtocolError(f"{where}: a run with rows or credit below 0")
        if (home, task) <= before:
            raise ProtocolError(f"{where}: runs that are not in the order of their homes and tasks")
        before = home, task


def check_whole(batch: Batch, where: str) -> None:
    """Raise ProtocolError unless runs go with the batch's kind, and are as long as its arrays, which do."""
    rows = int(batch.runs.rows.sum())
    if rows != len(batch):
        raise ProtocolError(f"{where}: runs of {rows} rows; there are {len(batch)}")
    homes = batch.runs.home
    require(batch.kind not in TO_HOME or homes[0] == homes[-1], where, "results for several homes")
