"""What leaves a worker after a step."""

from __future__ import annotations

from dataclasses import dataclass, field

from wdpm.cluster.batch import Batch
from wdpm.cluster.task import TaskResult


@dataclass
class Outbox:
    """What a step of a worker leaves behind: batches for other workers, and results of tasks for the master."""

    batches: list[Batch] = field(default_factory=list)
    results: list[TaskResult] = field(default_factory=list)
