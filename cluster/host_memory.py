"""Main memory: of this machine, and what this process has used."""

from __future__ import annotations

import os
import resource
import sys


def machine_memory() -> int:
    """Main memory of this machine [bytes]."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def peak_memory() -> int:
    """Most memory that this process has had in use [bytes]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def private_memory() -> int:
    """Memory that this process shares with no other [bytes]: of a forked one, what it has written. Linux alone."""
    with open("/proc/self/smaps_rollup") as rollup:
        lines = [line.split() for line in rollup]
    return sum(int(words[1]) * 1024 for words in lines if words[0] in ("Private_Clean:", "Private_Dirty:"))
