"""Slave processes that are struck, and replaced by new ones; what they cost, and over which links they are reached."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import wdpm

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(wdpm.__file__).parents[1])}
LINKED = Path(__file__).with_name("linked_slave.py")
TICKS_PER_S = os.sysconf("SC_CLK_TCK")

STAT_TICKS = slice(11, 13)
"""utime and stime among the fields of /proc/N/stat that come after the name of the program."""


class SlaveProcess:
    """One slave.

    Args:
        endpoint: of the master.
        link: what its connections suffer, as options of linked_slave.py; None for plain connections.

    Attributes:
        cpu_s: user and system time that it was last seen to have taken [s]; what a killed one took stays known.
        start_up_s: what it had taken when it was first ready to work [s]; None before.
    """

    def __init__(self, endpoint: str, link: Sequence[str] | None = None) -> None:
        words = ["-m", "wdpm", "slave", endpoint, "--threads", "1"] if link is None else [str(LINKED), endpoint, *link]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen([sys.executable, *words], env=ENVIRONMENT, **quiet)
        self.number = self._process.pid
        self.cpu_s = 0.0
        self.start_up_s: float | None = None

    def __repr__(self) -> str:
        return f"process {self.number}"

    @property
    def alive(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def look(self) -> None:
        """See what it has taken so far."""
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            fields = Path(f"/proc/{self.number}/stat").read_text().rpartition(")")[2].split()
            self.cpu_s = max(self.cpu_s, sum(map(int, fields[STAT_TICKS])) / TICKS_PER_S)

    def ready(self) -> None:
        """It is ready to work; what it took until it first was counts as its start."""
        if self.start_up_s is None:
            self.look()
            self.start_up_s = self.cpu_s

    def strike(self, number: signal.Signals) -> None:
        """Send it a signal, if it is there."""
        self.look()
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(number)

    def end(self) -> None:
        """Kill it, wherever it is."""
        self.look()
        self._process.kill()
        self._process.wait()


class Slaves:
    """The slaves of a master, those that have ended included."""

    def __init__(self, endpoint: str, link: Sequence[str] | None = None) -> None:
        self._endpoint, self._link = endpoint, link
        self.all: list[SlaveProcess] = []

    @property
    def alive(self) -> list[SlaveProcess]:
        """Those that have not ended."""
        return [slave for slave in self.all if slave.alive]

    def start(self) -> SlaveProcess:
        """One more."""
        self.all.append(SlaveProcess(self._endpoint, self._link))
        return self.all[-1]

    def ready(self, process: int) -> None:
        """A slave is ready to work."""
        for slave in self.all:
            if slave.number == process:
                slave.ready()

    def cost(self) -> tuple[float, float]:
        """CPU time of all that ever were, and what of it was theirs before they were first ready to work [s]."""
        for slave in self.all:
            slave.look()
        starts = [slave.cpu_s if slave.start_up_s is None else slave.start_up_s for slave in self.all]
        return sum(slave.cpu_s for slave in self.all), sum(starts)

    def end(self) -> None:
        """Kill all."""
        for slave in self.all:
            slave.end()


def cpu_here() -> float:
    """User and system time of this process [s]."""
    return time.process_time()
