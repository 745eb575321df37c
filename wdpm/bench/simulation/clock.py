"""Simulated time: what is to happen, in the order in which it does."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable

Action = Callable[[], None]


class Clock:
    """A discrete-event simulation.

    Attributes:
        now: simulated time [s].
    """

    def __init__(self) -> None:
        self.now = 0.0
        self._coming: list[tuple[float, int, Action]] = []
        self._numbers = itertools.count()

    def after(self, seconds: float, action: Action) -> None:
        """Have something happen later; what is due at the same time happens in the order of these calls."""
        heapq.heappush(self._coming, (self.now + max(seconds, 0.0), next(self._numbers), action))

    def step(self) -> bool:
        """Go on to what happens next; False if nothing does any more."""
        if not self._coming:
            return False
        self.now, _, action = heapq.heappop(self._coming)
        action()
        return True
