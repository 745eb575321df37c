"""What a slave has sent its master and its peers that is not known to have come, and what of theirs has come here.

The master and a slave tell each other in heartbeats, which go over a connection of their own as well. A slave tells a
peer by an answer over the connection that the peer's batches come by: only while some come, and now and then.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from wdpm.cluster.messages import protocol
from wdpm.cluster.transport.receipts import TELLINGS, Receipts, swallowed

MASTER: Final = -1
"""In place of a slave's number."""


class Deliveries:
    """The books of a slave's shell."""

    def __init__(self) -> None:
        self._sent: Receipts[int] = Receipts()  # to the master and to peers, by number
        self._came: Receipts[bytes] = Receipts()  # from peers, by the connection that they made
        self._untold: set[bytes] = set()
        self._told_at = 0.0
        self._dead_s: float | None = None  # what the master says; None while there is none

    def to_master(self, message: protocol.FromSlave) -> protocol.FromSlave:
        """A message to the master as it is to be sent: a heartbeat says what has come of the master's."""
        if isinstance(message, protocol.Heartbeat):
            return replace(message, received=self._sent.have_come(MASTER))
        return message

    def sent_to_master(self, message: protocol.FromSlave, size: int) -> None:
        """A message of so many bytes was sent to the master."""
        if isinstance(message, protocol.Hello):
            self._sent.begin(MASTER)
            self._dead_s = None
        elif not isinstance(message, protocol.Heartbeat):
            self._sent.sent(MASTER, size)

    def master_said(self, message: protocol.FromMaster) -> None:
        """A message of the master has come."""
        match message:
            case protocol.Heartbeat(received):
                self._sent.told(MASTER, received)
            case protocol.Welcome():
                self._sent.count_arrivals_anew(MASTER)
                self._dead_s = message.liveness_s
            case _:
                self._sent.came(MASTER)

    def sent_to_peer(self, peer: int, message: protocol.FromPeer, size: int) -> None:
        """A message of so many bytes was sent to a peer."""
        if isinstance(message, protocol.PeerHello):
            self._sent.begin(peer)
        else:
            self._sent.sent(peer, size)

    def peer_told(self, peer: int, answer: protocol.PeerReceived) -> None:
        """A peer says what has come."""
        self._sent.told(peer, answer.messages)

    def forget_peer(self, peer: int) -> None:
        """The connection to a peer is closed."""
        self._sent.forget(peer)

    def greeted(self, identity: bytes) -> None:
        """A peer that has made a connection was welcomed."""
        self._came.begin(identity)

    def peer_said(self, identity: bytes) -> None:
        """A message of a peer has come, over a connection that it made."""
        self._came.came(identity)
        self._untold.add(identity)

    def answers(self, now: float) -> list[tuple[bytes, protocol.PeerReceived]]:
        """What is to be told now to peers of whom something has come."""
        if self._dead_s is None or now < self._told_at + self._dead_s / TELLINGS:
            return []
        self._told_at = now
        untold, self._untold = self._untold, set()
        return [(identity, protocol.PeerReceived(self._came.have_come(identity))) for identity in sorted(untold)]

    def stuck(self, now: float) -> list[tuple[int, str]]:
        """Whom nothing reaches any more, and what to tell a person; the master is MASTER."""
        if self._dead_s is None:
            return []
        names = {MASTER: "the master"}
        return [
            (key, swallowed(names.get(key, f"slave {key}"), self._dead_s))
            for key in self._sent.stuck(now, self._dead_s)
        ]
