"""When a slave tries to join, and when it gives up: the first time, and after it has lost its master."""

from __future__ import annotations

from wdpm.cluster.limits import ClusterLimits


class Attempts:
    """Tries to join a master. Each waits twice as long as the one before, up to a limit.

    Args:
        patience: how long a master's first answer is waited for [s].
        rejoin: how long a master that was lost is waited for [s]; None for as long.

    Attributes:
        patience: of the tries that go on now.
        again: whether the slave had joined before.
    """

    def __init__(self, patience: float, rejoin: float | None, limits: ClusterLimits) -> None:
        self.patience = patience
        self.again = False
        self._rejoin = patience if rejoin is None else rejoin
        self._limits = limits
        self._wait = limits.join_first_s
        self._give_up_at = self._retry_at = self._answer_until = 0.0

    def begin(self, now: float, *, again: bool = False) -> None:
        """The first of them is made now."""
        if again:
            self.again, self.patience = True, self._rejoin
        self._wait = self._limits.join_first_s
        self._give_up_at, self._retry_at = now + self.patience, now + self._wait
        self.wait_for_nobody()

    def wait_for_answer(self, now: float) -> None:
        """The master has taken the connection: its answer is under way, however slow the link or laden the machine.

        Another Hello over another connection would be taken for a slave that was lost and came back.
        """
        self._answer_until = now + self._limits.join_longest_s

    def wait_for_nobody(self) -> None:
        """The connection is gone, or the answer has come and was no."""
        self._answer_until = 0.0

    def over(self, now: float) -> bool:
        """Whether it is time to give up."""
        return now >= self._give_up_at

    def due(self, now: float) -> float | None:
        """Whether it is time for another one: how long its answer is waited for, or None."""
        if now < max(self._retry_at, self._answer_until):
            return None
        self.wait_for_nobody()
        longest = self._limits.rejoin_longest_s if self.again else self._limits.join_longest_s
        self._wait = min(2 * self._wait, longest)
        self._retry_at = now + self._wait
        return self._wait
