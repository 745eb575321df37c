"""Time since the process began, which a time budget counts from: Python takes a while before it runs our code.

And processor time, which hardly depends on what else a machine does.
"""

from __future__ import annotations

import math
import os
import time
from pathlib import Path

from wdpm.devices import available_cores

_IMPORTED = time.monotonic()


def process_age() -> float:
    """Seconds since this process began; where the system does not tell, since this file was imported."""
    try:
        # Field 22 of proc_pid_stat(5), in clock ticks since the machine booted; the name before it may hold blanks.
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, AttributeError, ValueError, IndexError):
        return time.monotonic() - _IMPORTED


def cpu_seconds() -> float:
    """Processor time of this process, and of those that it has started [s]: a render's tasks may be theirs.

    The system counts a child for its parent when that has waited for it. One that is at work, or has ended unnoticed,
    is counted as long as /proc tells of it (on Linux), and so are those that such a one has started: slaves that are
    forked from a process of this one.
    """
    ended = os.times()
    return time.process_time() + ended.children_user + ended.children_system + sum(map(_cpu_of, _started_by("self")))


def _started_by(process: int | str) -> list[int]:
    """Processes that this one has started, and not waited for, and those that they have."""
    try:
        threads = Path(f"/proc/{process}/task").iterdir()
        children = [int(child) for thread in threads for child in (thread / "children").read_text().split()]
    except OSError:
        return []
    return [each for child in children for each in (child, *_started_by(child))]


def _cpu_of(process: int) -> float:
    """Processor time of a process, and of those that it has waited for [s]."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:  # it was waited for just now
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")  # fields 14 to 17 of proc_pid_stat(5)


def idle_share() -> float:
    """Of this machine's cores, what a process that could use all is likely to get beside those that run already.

    By those that ran in the last minute, or by those that run now where these are fewer: others may have ended.
    """
    cores = available_cores()
    try:
        return cores / (cores + min(os.getloadavg()[0], _others_running()))
    except (OSError, AttributeError):  # nobody tells
        return 1.0


def _others_running() -> float:
    """Threads that run or wait for a core now, but this one (proc(5)); infinite where the system does not tell."""
    try:
        return max(int(Path("/proc/loadavg").read_text().split()[3].partition("/")[0]) - 1, 0)
    except (OSError, ValueError, IndexError):
        return math.inf


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
