"""What processes that share a worker's tasks (cluster.work.processes) tell their parent; never on any network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wdpm.cluster.task import TaskResult


@dataclass(frozen=True, eq=False)
class TaskShared:
    """A task is done.

    Attributes:
        counted: by the worker meanwhile: {"values": what cluster.work.tally reads}.
        private_bytes: memory that the process shares with no other.
        cpu_s: CPU time of the process since it told of the task before, or since it was forked [s].
    """

    result: TaskResult
    counted: dict[str, Any]
    private_bytes: int
    cpu_s: float


@dataclass(frozen=True)
class TaskFailed:
    """A task raised an error.

    Attributes:
        kind: name of the error's class; text: its message; trace: where it was raised, for people.
    """

    kind: str
    text: str
    trace: str


FromShare = TaskShared | TaskFailed
