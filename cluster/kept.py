"""What is finished of a session, so that it need not be done again: whoever goes on is handed it.

Buckets and irradiance records are functions of scene and settings, so it does not matter who made them, or when.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from wdpm.cluster.task import BucketRendered, BucketTask, RecordsMade, RecordTask


@dataclass(frozen=True, eq=False)
class BucketKept:
    """A bucket, and what it looks like."""

    task: BucketTask
    result: BucketRendered


@dataclass(frozen=True, eq=False)
class RecordsKept:
    """Candidates of a round, and the irradiance records that were made of them."""

    task: RecordTask
    result: RecordsMade


TaskKept = BucketKept | RecordsKept


@dataclass(frozen=True)
class Kept:
    """What is finished of a session."""

    buckets: tuple[BucketKept, ...] = ()
    records: tuple[RecordsKept, ...] = ()


NOTHING_KEPT = Kept()


class Keeper(Protocol):
    """Takes what is finished of a session as it comes, in the thread that renders, which waits for it."""

    def keep(self, done: TaskKept) -> None:
        """A task is done. Its arrays may be kept, and must not be written to."""
