"""Rounds of irradiance records whose records are a function of their numbers alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from fake_worker import make_view
from master_driver import LIMITS

from wdpm.cluster.records import NO_RECORDS, ROUND_BITS, CachePlan, Records, candidates, joined
from wdpm.cluster.task import RecordsMade, RecordTask
from wdpm.cluster.world import View

PLAN = CachePlan(rounds=3, spacing=16, rows=2, columns=6, error=0.3, least=1.0, most=9.0, wanted=0.3)
FEW_A_TASK = replace(LIMITS, record_task_least=5, record_task_most=5)


def cached(view: View | None = None) -> View:
    """A view with an irradiance cache."""
    return replace(make_view(64, 32, 16) if view is None else view, cache=PLAN)


def made(task: RecordTask) -> RecordsMade:
    """Every third candidate has a record, which is a function of its number alone."""
    number = task.candidates.astype(np.int64)
    number = (np.int64(task.round) << ROUND_BITS) + number[number % 3 == 0]
    rng = [np.random.default_rng(int(n)) for n in number]
    position = np.array([r.random(3) for r in rng], np.float32).reshape(-1, 3)
    radius = np.array([0.01 + r.random() for r in rng], np.float32)
    gradient = np.repeat(position[:, None, :], 3, axis=1)
    records = Records(number, position, position, position, gradient, -gradient, radius, radius, 0.1 * radius)
    return RecordsMade(task.number, task.round, records, math.prod(PLAN.strata(task.round)) * len(number))


def all_records(rounds: int) -> Records:
    """Those of the first rounds of the view."""
    counts = [len(candidates(64, 32, PLAN, number)) for number in range(rounds)]
    if not rounds:
        return NO_RECORDS
    return joined([made(RecordTask(0, number, 0, count)).records for number, count in enumerate(counts)])
