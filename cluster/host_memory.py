"""Main memory: of this machine, and what this process has used."""

from __future__ import annotations

import os
import resource
import sys
import time


def machine_memory() -> int:
    """Main memory of this machine [bytes]."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def peak_memory() -> int:
    """Most memory that this process has had in use [bytes]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


class PrivateMemory:
    """Memory that this process shares with no other: of a forked one, what it has written. Linux alone.

    The system counts pages one by one, milliseconds for some hundred megabytes, so it is asked for a hundredth of the
    time at most.
    """

    def __init__(self) -> None:
        self._bytes = 0
        self._again = 0.0

    def bytes(self) -> int:
        """As much as when it was last asked for [bytes]."""
        began = time.monotonic()
        if began >= self._again:
            with open("/proc/self/smaps_rollup") as rollup:
                lines = [line.split() for line in rollup]
            self._bytes = sum(
                int(words[1]) * 1024 for words in lines if words[0] in ("Private_Clean:", "Private_Dirty:")
            )
            ended = time.monotonic()
            self._again = ended + 100.0 * (ended - began)
        return self._bytes
