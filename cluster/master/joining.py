"""How long a master waits for slaves that have not joined, and what it says meanwhile."""

from __future__ import annotations

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.events import Noted
from wdpm.cluster.master.members import Members


class JoinWait:
    """The wait for slaves, from the moment when there is something to render."""

    def __init__(self, limits: ClusterLimits, members: Members) -> None:
        self._limits = limits
        self._members = members
        self._ticked_at: float | None = None
        self._waited_s = 0.0
        self._noted_s = 0.0
        self._refused = ""

    def refused(self, who: str, reason: str) -> Noted:
        """A slave came that may not join; what to tell a person."""
        self._refused = f"{who}: {reason}"
        return Noted(f"refused {self._refused}")

    def tick(self, now: float) -> str | None:
        """Time has passed; returns who has come, and how long the others are waited for, now and then."""
        passed = 0.0 if self._ticked_at is None else now - self._ticked_at
        self._ticked_at = now
        # A longer step than any loop takes means that this process itself stood still (a laptop's lid).
        self._waited_s += min(passed, self._limits.slept_s)
        if self._waited_s - self._noted_s < self._limits.join_news_s:
            return None
        self._noted_s = self._waited_s
        left = self._limits.join_timeout_s - self._waited_s
        return f"{self._who_has_come()}; the others are waited for {left:.0f} s more"

    @property
    def over(self) -> bool:
        """Whether nobody is waited for any longer."""
        return self._waited_s >= self._limits.join_timeout_s

    @property
    def in_vain(self) -> str:
        """Why there is no render, if none has come."""
        advice = "see that `wdpm slave` runs there and reaches this machine, or give it longer with --join-timeout"
        return (
            f"no slave has joined within {self._limits.join_timeout_s:g} s, of {self._members.expected} that are "
            f"waited for; {f'refused: {self._refused}' if self._refused else advice}"
        )

    @property
    def enough(self) -> str:
        """What to tell a person if some have."""
        return (
            f"{self._who_has_come()} within {self._limits.join_timeout_s:g} s (--join-timeout): these begin, and "
            "others may join later"
        )

    def _who_has_come(self) -> str:
        names = ", ".join(map(str, self._members))
        return f"{len(self._members)} of {self._members.expected} slaves have joined" + (f" ({names})" if names else "")
