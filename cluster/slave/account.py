"""What a slave tells of itself beside what its worker does: where its time went, and what it sent."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from wdpm.cluster.messages import protocol
from wdpm.cluster.slave import jobs
from wdpm.cluster.slave.idle_time import IdleTime
from wdpm.cluster.slave.jobs import Job
from wdpm.cluster.slave.traffic import Traffic


@dataclass
class Account:
    """Kept by a slave's shell, and handed over with its worker's statistics."""

    idling: IdleTime = field(default_factory=IdleTime)
    sent: Traffic = field(default_factory=Traffic)

    def ended(self, job: Job, now: float) -> None:
        """The worker has done a job.

        Once it is built, and when it has forgotten its photons, a worker counts anew, and so does the account; which
        also begins anew with each session, where a worker goes on counting if it keeps its photons.
        """
        if isinstance(job, jobs.Build | jobs.ForgetPhotons):
            self.idling.begin(now)
            self.sent.take()
        self.idling.ended(now)

    def attach_to(self, message: protocol.FromSlave) -> protocol.FromSlave:
        """A message to the master as it is to be sent: the account is added to Statistics, and begins anew."""
        self.sent.add(message)
        if not isinstance(message, protocol.Statistics):
            return message
        return replace(message, values={**message.values, "spent_s": self.idling.take(), **self.sent.take()})
