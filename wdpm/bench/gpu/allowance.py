"""Time that a benchmark may take: what is done one after another, and what there was no time left for."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Thing = TypeVar("Thing")


class Allowance:
    """Time for several things, of which nobody knows beforehand how long they take.

    Args:
        seconds: after these nothing more is begun, nor what would end later if it took as long as the longest so far.
        clock: that tells them.

    Attributes:
        left_out: what was not begun, by name.
    """

    def __init__(self, seconds: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._end = clock() + seconds
        self.left_out: list[str] = []

    def of(self, things: Iterable[tuple[str, Thing]]) -> Iterator[Thing]:
        """Those of some things that there is time for, as long as there is; each is done before the next is asked for.

        Args:
            things: with their names. As long as any takes is known of them alone: others are of another size.
        """
        longest = 0.0
        for name, thing in things:
            began = self._clock()
            if began + longest > self._end:
                self.left_out.append(name)
                continue
            yield thing
            longest = max(longest, self._clock() - began)
