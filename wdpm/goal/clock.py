"""Time since the process began, which a time budget counts from: Python takes a while before it runs our code."""

from __future__ import annotations

import os
import time
from pathlib import Path

_IMPORTED = time.monotonic()


def process_age() -> float:
    """Seconds since this process began; where the system does not tell, since this file was imported."""
    try:
        # Field 22 of proc_pid_stat(5), in clock ticks since the machine booted; the name before it may hold blanks.
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, AttributeError, ValueError, IndexError):
        return time.monotonic() - _IMPORTED


class Budget:
    """A time budget.

    Args:
        seconds: in all; infinite for none.
        used: of them before now.
        reserve: kept for what comes after the passes.
    """

    def __init__(self, seconds: float, used: float = 0.0, reserve: float = 0.0) -> None:
        self._end = time.monotonic() + seconds - used
        self.reserve = reserve

    def left(self) -> float:
        """Seconds for passes."""
        return self._end - time.monotonic() - self.reserve
