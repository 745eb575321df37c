"""Machines that are not there: cores that threads share, and network interfaces that carry one message at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from wdpm.bench.simulation.clock import Action, Clock

Work = Callable[[], tuple[float, Action]]
"""Done when its turn comes; says what it takes [s of one core] and what follows when that time is over."""

_ROUNDING_S = 1e-12


@dataclass(eq=False)
class _Running:
    left: float
    then: Action


class Processor:
    """Some cores, shared evenly by the threads that run.

    Args:
        cores: a thread has at most one.
    """

    def __init__(self, clock: Clock, cores: float) -> None:
        self._clock = clock
        self._cores = cores
        self._running: list[_Running] = []
        self._since = 0.0
        self._turn = 0

    def run(self, seconds: float, then: Action) -> None:
        """Compute for some seconds of one core, longer where others do as well."""
        self._catch_up()
        self._running.append(_Running(seconds, then))
        self._expect()

    def _rate(self) -> float:
        return min(1.0, self._cores / len(self._running))

    def _catch_up(self) -> None:
        if self._running:
            done = (self._clock.now - self._since) * self._rate()
            for each in self._running:
                each.left -= done
        self._since = self._clock.now

    def _expect(self) -> None:
        """Have the clock come back when the first of those that run is done."""
        self._turn += 1
        turn = self._turn
        if self._running:
            self._clock.after(min(each.left for each in self._running) / self._rate(), lambda: self._end(turn))

    def _end(self, turn: int) -> None:
        if turn != self._turn:
            return  # others began or ended meanwhile
        self._catch_up()
        least = min(each.left for each in self._running)
        ended = [each for each in self._running if each.left <= least + _ROUNDING_S]
        self._running = [each for each in self._running if each.left > least + _ROUNDING_S]
        for each in ended:
            each.then()
        self._catch_up()
        self._expect()


class Thread:
    """Does one thing after another on a processor.

    Attributes:
        busy_s: seconds of a core that it has taken.
    """

    def __init__(self, processor: Processor) -> None:
        self._processor = processor
        self._waiting: deque[Work] = deque()
        self._at_work = False
        self.busy_s = 0.0

    def submit(self, work: Work) -> None:
        """Do this after all that waits."""
        self._waiting.append(work)
        self._next()

    def _next(self) -> None:
        if self._at_work or not self._waiting:
            return
        self._at_work = True
        seconds, then = self._waiting.popleft()()
        self.busy_s += seconds

        def done() -> None:
            then()
            self._at_work = False
            self._next()

        self._processor.run(seconds, done)


@dataclass(frozen=True)
class Link:
    """What joins machines.

    Attributes:
        bytes_per_s: that a machine's interface carries each way.
        latency_s: from the first byte's leaving to its coming.
    """

    bytes_per_s: float
    latency_s: float


class _Lane:
    """One direction of an interface: a message after the other, in the order in which they come to it."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._free_at = 0.0
        self.busy_s = 0.0

    def enter(self, seconds: float) -> tuple[float, float]:
        """When a message that takes so long begins and ends here, from now."""
        begins = max(self._clock.now, self._free_at)
        self._free_at = begins + seconds
        self.busy_s += seconds
        return begins - self._clock.now, self._free_at - self._clock.now


class Machine:
    """Cores and an interface.

    Args:
        link: that the interface is of; None for a machine whose messages all stay within it.

    Attributes:
        sent, received: bytes that went over the interface.
    """

    def __init__(self, clock: Clock, cores: float, link: Link | None) -> None:
        self.processor = Processor(clock, cores)
        self._clock = clock
        self._link = link
        self._out, self._in = _Lane(clock), _Lane(clock)
        self.sent = self.received = 0

    @property
    def wire_s(self) -> float:
        """Seconds that the busier direction of the interface was carrying."""
        return max(self._out.busy_s, self._in.busy_s)

    def send(self, target: Machine, size: int, arrived: Action) -> None:
        """Carry a message; within a machine that takes no time but the processor's.

        A message passes on while it comes in, so one that meets no other takes latency and size / bandwidth.

        Args:
            size: of the message [bytes].
            arrived: when its last byte is there.
        """
        link = self._link
        if target is self or link is None:
            self._clock.after(0.0, arrived)
            return
        self.sent += size
        target.received += size
        seconds = size / link.bytes_per_s
        begins, _ = self._out.enter(seconds)

        def first_byte() -> None:
            _, ends = target._in.enter(seconds)
            self._clock.after(ends, arrived)

        self._clock.after(begins + link.latency_s, first_byte)
