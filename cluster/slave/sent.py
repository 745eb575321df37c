"""What a slave has sent: how many messages of each kind, and how large its batches were."""

from __future__ import annotations

from collections import Counter

from wdpm.cluster.messages.protocol import Heartbeat, Message, PeerBatches, Vitals

COUNTS = ("messages", "batches_by_rays", "batches_by_bytes")


class Sent:
    """Counts messages by name, and batches by the power of two below their length and size."""

    def __init__(self) -> None:
        self._counts: dict[str, Counter[str]] = {name: Counter() for name in COUNTS}

    def add(self, message: Message) -> None:
        """A message is handed to the network, which may have lost who it is for.

        Signs of life are not counted: they follow the clock, and go on between renders.
        """
        if isinstance(message, Heartbeat | Vitals):
            return
        self._counts["messages"][type(message).__name__] += 1
        for batch in message.batches if isinstance(message, PeerBatches) else ():
            self._counts["batches_by_rays"][power_below(len(batch))] += 1
            self._counts["batches_by_bytes"][power_below(batch.nbytes)] += 1

    def take(self) -> dict[str, dict[str, int]]:
        """The counts, which begin anew."""
        counts, self._counts = self._counts, {name: Counter() for name in COUNTS}
        return {name: dict(counter) for name, counter in counts.items()}


def power_below(count: int) -> str:
    """The largest power of two that is no larger, in digits, as names of counts are; "0" for 0."""
    return str(1 << count.bit_length() - 1) if count else "0"
