"""What a slave has sent and got: how many messages of each kind, and how large batches were as they travelled."""

from __future__ import annotations

from collections import Counter
from typing import Any

from wdpm.cluster.messages.protocol import Heartbeat, Message, PeerBatches, Vitals

COUNTS = ("messages", "batches_by_rays", "batches_by_bytes")


class Traffic:
    """Counts messages by name, batches by the power of two below their length and size, and bytes of batches."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._counts: dict[str, Counter[str]] = {name: Counter() for name in COUNTS}
        self._bytes = {"bytes_in": 0, "bytes_out": 0}

    def add(self, message: Message, size: int = 0) -> None:
        """A message was handed to the network, which may have lost who it is for.

        Signs of life are not counted: they follow the clock, and go on between renders.

        Args:
            size: its bytes, of a batch.
        """
        if isinstance(message, Heartbeat | Vitals):
            return
        self._counts["messages"][type(message).__name__] += 1
        if isinstance(message, PeerBatches):
            for batch in message.batches:
                self._counts["batches_by_rays"][power_below(len(batch))] += 1
                self._counts["batches_by_bytes"][power_below(size // len(message.batches))] += 1
            self._bytes["bytes_out"] += size

    def came(self, size: int) -> None:
        """A batch of so many bytes came."""
        self._bytes["bytes_in"] += size

    def take(self) -> dict[str, Any]:
        """The counts, which begin anew."""
        counts = {**{name: dict(counter) for name, counter in self._counts.items()}, **self._bytes}
        self._begin()
        return counts


def power_below(count: int) -> str:
    """The largest power of two that is no larger, in digits, as names of counts are; "0" for 0."""
    return str(1 << count.bit_length() - 1) if count else "0"
