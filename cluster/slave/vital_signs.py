"""What a slave's process takes just now: for the person at the master, and for nobody else."""

from __future__ import annotations

import os

from wdpm.cluster.host_memory import memory_in_use
from wdpm.cluster.messages import protocol
from wdpm.cluster.transport.transport import Carried

TELL_S = 2.0
"""Between two messages to the master [s]: some hundred bytes each."""


class VitalSigns:
    """Looks at its process now and then.

    Args:
        carried: counts the bytes of its messages.
        now: any clock that grows [s].
    """

    def __init__(self, carried: Carried, now: float) -> None:
        self._carried = carried
        self._then = now
        self._before = (_cpu_s(), carried.sent, carried.received)

    def due(self, now: float) -> protocol.Vitals | None:
        """What to tell the master; None while that is too early."""
        passed = now - self._then
        if passed < TELL_S:
            return None
        seen = (_cpu_s(), self._carried.sent, self._carried.received)
        cores, sent, received = (max(0.0, (new - old) / passed) for new, old in zip(seen, self._before, strict=True))
        self._then, self._before = now, seen
        return protocol.Vitals(memory_in_use(), cores, sent, received)


def _cpu_s() -> float:
    """Of this process and of those that it has forked, and that have ended [s]."""
    return sum(os.times()[:4])
