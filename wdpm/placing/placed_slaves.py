"""What a master needs of whoever starts its slaves elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

from wdpm.cluster.master.events import NotComing, ProcessEnded, StillAwaited


class PlacedSlaves(Protocol):
    """Slaves that something starts, watches, and starts again.

    Attributes:
        listen_at: where the master has to listen so that they reach it.
    """

    listen_at: str

    def start(self, endpoint: str, keys: Callable[[], bytes]) -> None:
        """Begin.

        Args:
            endpoint: at which the master listens.
            keys: gives those of one more slave, as it takes them from its standard input.
        """

    def ended(self) -> Iterable[ProcessEnded | NotComing | StillAwaited]:
        """Asked by the master all the time, on its thread: processes of this machine that have ended, if any have, and
        slaves that need not be waited for, or of which a person should hear.

        Raises:
            ClusterError: there are no slaves, and none will come.
        """

    def all_joined(self) -> None:
        """A render begins: whoever is lost from now on, or was not waited for, is started again if that is any use."""

    def no_more(self) -> None:
        """Start none any more: the master is about to tell those that are there to stop."""

    def stop(self) -> None:
        """Wait for all to end, kill those that do not; may be called again."""
