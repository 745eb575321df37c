"""Faults that strike a standing cluster in the middle of a render."""

from __future__ import annotations

import random
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from slaves import SlaveProcess
from standing import StandingCluster

POLL_S = 0.005
"""Between two looks at how far a render is [s]."""


@dataclass(frozen=True)
class Kind:
    """A kind of fault.

    Attributes:
        signal: that strikes a slave; None where only the links are bad.
        most: slaves that are struck in one render.
        stopped_s: after which a process that was stopped goes on [s].
        link: what connections suffer all the time, as options of linked_slave.py; None for plain connections.
        loses: the slave is lost, and another one is started.
        longest_s: after which the render counts as hung [s].
    """

    signal: signal.Signals | None
    most: int = 1
    stopped_s: float = 0.0
    link: tuple[str, ...] | None = None
    loses: bool = False
    longest_s: float = 300.0


KINDS = {
    "none": Kind(None),
    "kill": Kind(signal.SIGKILL, loses=True),
    "kills": Kind(signal.SIGKILL, most=3, loses=True),
    "term": Kind(signal.SIGTERM, loses=True),
    "stop": Kind(signal.SIGSTOP, stopped_s=3.0),
    "minute": Kind(signal.SIGSTOP, stopped_s=60.0),
    "cut": Kind(signal.SIGUSR1, link=()),
    "half-open": Kind(signal.SIGUSR2, link=(), loses=True, longest_s=600.0),
    "swallow": Kind(signal.SIGHUP, link=(), longest_s=600.0),
    "delay": Kind(None, link=("--delay", "0.05")),
    "slow": Kind(None, link=("--rate", "1e6")),
    "flaky": Kind(None, link=("--cut-every", "40"), longest_s=600.0),
}
"""By name; docs/chaos.md tells what each is."""


class Strikes:
    """Strikes slaves at moments that are shares of the CPU time of an undisturbed render, however busy the machine is.

    Args:
        base_cpu_s: that time [s].

    Attributes:
        happened: what struck, and when.
    """

    def __init__(self, cluster: StandingCluster, kind: Kind, chance: random.Random, base_cpu_s: float) -> None:
        self.happened: list[str] = []
        self._cluster, self._kind, self._chance, self._base = cluster, kind, chance, base_cpu_s
        count = 1 if kind.most == 1 else chance.randint(2, kind.most)
        self._moments = sorted(chance.random() for _ in range(count)) if kind.signal is not None else []
        self._at_once = chance.random() < 0.5
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @contextmanager
    def meanwhile(self) -> Iterator[None]:
        """While the render is on."""
        self._begun, self._starts = self._cluster.cost(), self._cluster.slaves.cost()[1]
        self._thread.start()
        try:
            yield
        finally:
            self._over.set()
            self._thread.join()

    def _done(self) -> float:
        starts = self._cluster.slaves.cost()[1] - self._starts
        return (self._cluster.cost() - self._begun - starts) / self._base

    def _run(self) -> None:
        for moment in self._moments:
            while self._done() < moment:
                if self._over.wait(POLL_S):
                    return
            if self._over.is_set():
                return
            self._strike(moment, self._chance.choice(self._cluster.slaves.alive))

    def _strike(self, moment: float, victim: SlaveProcess) -> None:
        kind, number = self._kind, self._kind.signal
        assert number is not None
        victim.strike(number)
        self.happened.append(f"{number.name} at {moment:.0%}")
        if kind.stopped_s:
            self._over.wait(kind.stopped_s)
            victim.strike(signal.SIGCONT)
        if kind.loses and number is not signal.SIGUSR2 and self._at_once:
            self._cluster.slaves.start()
            self.happened[-1] += ", another at once"
