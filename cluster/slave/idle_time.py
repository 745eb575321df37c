"""Where a slave's time goes: to computing, or to waiting, by what it waited for."""

from __future__ import annotations

from wdpm.cluster.batch import OF_MAPS
from wdpm.cluster.messages.protocol import COMPUTING, NO_RAYS, NO_TASK, PHASE_END, SENDING, SPENT
from wdpm.cluster.slave import jobs
from wdpm.cluster.slave.jobs import Job


class IdleTime:
    """Adds up seconds, until they are taken.

    What a slave waits for is known when it is over: the job that ends a wait gives it its cause.
    """

    def __init__(self) -> None:
        self._spent = dict.fromkeys(SPENT, 0.0)
        self._jobs = 0
        self._doing: str | None = None  # one of SPENT, "" for a wait of unknown cause, None while nothing is counted
        self._since = 0.0

    def started(self, job: Job, now: float) -> None:
        """A job is handed to the worker, which may be at others.

        Args:
            now: any clock that grows [s].
        """
        self._jobs += 1
        if self._jobs == 1:
            self._turn(COMPUTING, now, cause_of(job))

    def ended(self, now: float) -> None:
        """The worker has done a job. What came of it is sent next, before there is another."""
        self._jobs -= 1
        if self._jobs == 0 and self._doing is not None:
            self._turn(SENDING, now)

    def sent(self, now: float) -> None:
        """What came of the job that ended last is on its way."""
        if self._doing == SENDING:
            self._turn("", now)

    def begin(self, now: float) -> None:
        """Count from here on, while the worker is at a job."""
        self._spent = dict.fromkeys(SPENT, 0.0)
        self._doing, self._since = COMPUTING, now

    def take(self) -> dict[str, float]:
        """Seconds by what they were spent on, as SPENT has it; nothing is counted from here to the next job."""
        spent, self._spent = self._spent, dict.fromkeys(SPENT, 0.0)
        self._doing = None
        return spent

    def _turn(self, to: str, now: float, cause: str = "") -> None:
        """Do another thing from now on; a wait of unknown cause was for `cause`."""
        if self._doing is not None:
            self._spent[self._doing or cause] += now - self._since
        self._doing, self._since = to, now


def cause_of(job: Job) -> str:
    """What a slave waited for that this job came to."""
    match job:
        case jobs.StartTask():
            return NO_TASK
        case jobs.HandleBatches(batches) if batches[0].kind not in OF_MAPS:
            return NO_RAYS
    return PHASE_END
