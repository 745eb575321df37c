"""Checks of batches that came over the wire: whose their rows are said to be."""

from __future__ import annotations

from typing import Final

import numpy as np

from wdpm.cluster.batch import TO_HOME, Batch
from wdpm.cluster.messages.demands import require
from wdpm.cluster.runs import COLUMNS, HOME, ROWS, TASK, Runs

LARGEST_NUMBER: Final = 1 << 48
"""In a table of runs. Sums of as many as a message can hold do not overflow."""


def check_runs(runs: Runs, where: str) -> None:
    """Raise ProtocolError unless a table of runs says something that can be, in the order that is due."""
    table = runs.table
    require(table.ndim == 2 and table.shape[1:] == (COLUMNS,), where, f"a table of runs of shape {table.shape}")
    require(len(table) > 0, where, "a batch without a run")
    least, most = int(table.min()), int(table.max())
    require(least >= -1 and most < LARGEST_NUMBER, where, f"numbers from {least} to {most} in a table of runs")
    require(int(table[:, ROWS:].min()) >= 0, where, "a run with rows or credit below 0")
    if len(table) > 1:
        home, task = np.diff(table[:, HOME]), np.diff(table[:, TASK])
        in_order = bool(((home > 0) | ((home == 0) & (task > 0))).all())
        require(in_order, where, "runs that are not in the order of their homes and tasks")


def check_whole(batch: Batch, where: str) -> None:
    """Raise ProtocolError unless arrays and runs are those of the batch's kind, and as long as each other."""
    batch.check()
    rows = int(batch.runs.rows.sum())
    require(rows == len(batch), where, f"runs of {rows} rows; there are {len(batch)}")
    homes = batch.runs.home
    require(batch.kind not in TO_HOME or homes[0] == homes[-1], where, "results for several homes")
