"""What has been sent over connections, and is not known to have come.

A connection may swallow what goes one way: a firewall, or a proxy that has lost its other half, takes every byte and
passes none on. The system sees no fault, and heartbeats go over another connection. So both ends count the messages
that come, and tell each other how many have; whoever hears of no more for long, and has sent some, takes the
connection for broken.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Final, Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)

TELLINGS: Final = 10
"""How often an end is told what has come, in the time of a silence that counts as death."""

SLOWEST_LINK: Final = 65_536.0
"""Bytes a second [B/s]. A message that is long has its time at this rate, besides: only whole ones are counted."""


def patience_s(dead_s: float) -> float:
    """How long nothing may come of what was sent [s]: a little longer than a process may be silent.

    So one that stands still is found by its silence, which says what is wrong.
    """
    return dead_s * (1.0 + 1.0 / TELLINGS)


def swallowed(whose: str, dead_s: float) -> str:
    """What to tell a person of a connection over which nothing comes."""
    return (
        f"nothing that was sent to {whose} has come for {patience_s(dead_s):.0f} s, and nobody hung up; "
        "does a firewall or a proxy on the way swallow it?"
    )


@dataclass
class _Ways:
    """What went over one connection since it was counted anew.

    Attributes:
        came: messages from the other end.
        known: messages to the other end that are known to have come.
        sizes: of those that are not, in their order [bytes].
        stuck_s: since when none more is known to have come [s].
    """

    came: int = 0
    known: int = 0
    sizes: deque[int] = field(default_factory=deque)
    stuck_s: float = 0.0


class Receipts(Generic[Key]):
    """Of the connections of one process, by whatever it knows them by.

    Heartbeats are no part of it, nor is what greets the other end: both ends count what follows that. A connection
    that has not been begun is not counted.
    """

    def __init__(self) -> None:
        self._ways: dict[Key, _Ways] = {}
        self._looked_at: float | None = None

    def begin(self, key: Key) -> None:
        """Count what goes over a connection anew, both ways."""
        self._ways[key] = _Ways()

    def forget(self, key: Key) -> None:
        """A connection is gone."""
        self._ways.pop(key, None)

    def came(self, key: Key) -> None:
        """A message has come."""
        if (ways := self._ways.get(key)) is not None:
            ways.came += 1

    def have_come(self, key: Key) -> int:
        """How many messages have come."""
        ways = self._ways.get(key)
        return 0 if ways is None else ways.came

    def count_arrivals_anew(self, key: Key) -> None:
        """What has come so far was greeting."""
        if (ways := self._ways.get(key)) is not None:
            ways.came = 0

    def sent(self, key: Key, size: int) -> None:
        """A message was sent.

        Args:
            size: its bytes; 0 of one that stays in this process, where nothing swallows it.
        """
        if size and (ways := self._ways.get(key)) is not None:
            ways.sizes.append(size)

    def told(self, key: Key, count: int) -> None:
        """The other end says how many messages have come there."""
        ways = self._ways.get(key)
        more = 0 if ways is None else count - ways.known
        # Words may overtake each other, and an end that counts anew may still hear of what was before.
        if ways is None or not 0 < more <= len(ways.sizes):
            return
        ways.known, ways.stuck_s = count, 0.0
        for _ in range(more):
            ways.sizes.popleft()

    def stuck(self, now: float, dead_s: float) -> list[Key]:
        """Connections over which nothing comes; asked several times a second.

        Args:
            dead_s: silence that counts as death [s].
        """
        passed = 0.0 if self._looked_at is None else now - self._looked_at
        self._looked_at = now
        step = min(passed, dead_s / TELLINGS)  # if that took longer, this process itself stood still
        found = []
        for key, ways in self._ways.items():
            if not ways.sizes:
                ways.stuck_s = 0.0
                continue
            ways.stuck_s += step
            if ways.stuck_s > patience_s(dead_s) + ways.sizes[0] / SLOWEST_LINK:
                found.append(key)
        return found
