"""The master as a state machine: events in, instructions out. It touches no socket and no clock.

It welcomes slaves, notices those that are lost, and lets what remains through to the phases of a session
(phases.py). In this version a slave that is lost ends the cluster.
"""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Mapping

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.events import (
    Abort,
    Begin,
    Broken,
    Close,
    Event,
    Instruction,
    Noted,
    PartitionMade,
    ProcessEnded,
    Send,
    SlaveLost,
    SlaveSaid,
    Tick,
    Unreadable,
)
from wdpm.cluster.master.members import Member, Members
from wdpm.cluster.master.phases import Phase, Phases
from wdpm.cluster.messages import protocol
from wdpm.scenes.errors import ProtocolError

__all__ = ["Master", "Phase"]


class Master:
    """The state of a cluster.

    Args:
        slaves: how many it waits for.
        versions: what the image's bits depend on, by name; slaves must have the same.
    """

    def __init__(self, slaves: int, versions: Mapping[str, str], limits: ClusterLimits | None = None) -> None:
        self._limits = limits or ClusterLimits()
        self._cluster = uuid.uuid4().hex
        self._members = Members(slaves, versions)
        self._dropped: Counter[str] = Counter()
        self._phases = Phases(self._members, self._limits, self._dropped)
        self._ticked_at: float | None = None
        self._beat_at = 0.0
        self._peer_gone: tuple[float, str] | None = None

    @property
    def phase(self) -> Phase:
        """What the master waits for."""
        return self._phases.phase

    @property
    def dropped(self) -> dict[str, int]:
        """Messages that were not used, by reason."""
        return dict(self._dropped)

    @property
    def members(self) -> list[protocol.Hello]:
        """The slaves that have joined, by number."""
        return [member.hello for member in self._members]

    @property
    def all_left(self) -> bool:
        """Whether every slave that joined has said its last word, or is known to be lost."""
        return self._members.all_left

    def handle(self, event: Event, now: float) -> list[Instruction]:
        """What to do about an event.

        Args:
            now: any clock that grows [s].
        """
        self._note_leaving(event)
        if self.phase is Phase.ENDED:
            return self._after_end(event)
        match event:
            case SlaveSaid(identity, message):
                return self._slave_said(identity, message, now)
            case Tick():
                return self._tick(now)
            case PartitionMade(cell, triangles):
                return self._phases.partition_made(cell, triangles)
            case Begin(session):
                return self._phases.begin(session, now)
            case SlaveLost(identity, reason):
                member = self._members.get(identity)
                return [] if member is None else self._break(f"{member} is lost: {reason}")
            case ProcessEnded(process, reason):
                return self._process_ended(process, reason)
            case Unreadable(identity, reason):
                return self._unreadable(identity, reason)
            case Close(reason, completed):
                return self._stop_all(reason, completed)
            case Abort(reason):
                return self._break(reason)
        raise AssertionError(f"unknown event {event}")

    # Joining, living and leaving.

    def _note_leaving(self, event: Event) -> None:
        match event:
            case SlaveSaid(identity, protocol.Goodbye() | protocol.Failed()) | SlaveLost(identity, _):
                leaving = [self._members.get(identity)]
            case ProcessEnded(process, _):
                leaving = [member for member in self._members if member.hello.process == process]
            case _:
                return
        for member in leaving:
            if member is not None:
                member.left = True

    def _after_end(self, event: Event) -> list[Instruction]:
        if isinstance(event, Begin):
            return [Broken("the cluster has ended; start another")]
        if isinstance(event, SlaveSaid) and isinstance(event.message, protocol.Hello):
            return [Send(event.identity, protocol.Refuse("the cluster has ended"))]
        return []

    def _stop_all(self, reason: str, completed: bool) -> list[Instruction]:
        self._phases.end()
        return self._to_all(protocol.Stop(reason, completed))

    def _to_all(self, message: protocol.FromMaster) -> list[Instruction]:
        return [Send(member.identity, message) for member in self._members]

    def _break(self, reason: str) -> list[Instruction]:
        return [*self._stop_all(reason, False), Broken(reason)]

    def _tick(self, now: float) -> list[Instruction]:
        slept, self._ticked_at = now - (now if self._ticked_at is None else self._ticked_at), now
        for member in self._members:
            if slept > self._limits.liveness_s / 2:
                member.heard_at = now  # this process itself stood still (a laptop's lid): silence says nothing
            silence = now - member.heard_at
            if silence > self._limits.liveness_s:
                return self._break(f"{member} has been silent for {silence:.0f} s; it may have died")
        if self._peer_gone is not None and now >= self._peer_gone[0]:
            return self._break(self._peer_gone[1])
        if now < self._beat_at:
            return []
        self._beat_at = now + self._limits.heartbeat_s
        return self._to_all(protocol.Heartbeat())

    def _process_ended(self, process: int, reason: str) -> list[Instruction]:
        for member in self._members:
            if member.hello.process == process:
                return self._break(f"{member} is lost: {reason}")
        return self._break(f"a slave (process {process}) ended before it joined: {reason}")

    def _join(self, identity: bytes, hello: protocol.Hello, now: float) -> list[Instruction]:
        member = self._members.get(identity)
        if member is None:
            reason = self._members.reason_to_refuse(hello)
            if reason is not None:
                self._dropped["refused slaves"] += 1
                return [
                    Send(identity, protocol.Refuse(reason)),
                    Noted(f"refused {hello.host}, process {hello.process}: {reason}"),
                ]
            member = self._members.add(identity, hello, now)
        elif self.phase is not Phase.JOINING:
            return self._break(f"{member} lost its connection and came back, which this version does not survive")
        welcome = protocol.Welcome(member.number, self._cluster, self._limits.heartbeat_s, self._limits.liveness_s)
        out: list[Instruction] = [
            Send(identity, welcome),
            Noted(f"{member} joined, {hello.threads} threads ({len(self._members)} of {self._members.expected})"),
        ]
        if self.phase is Phase.JOINING and len(self._members) == self._members.expected:
            out += self._phases.all_joined(now)
        return out

    # Messages.

    def _slave_said(self, identity: bytes, message: protocol.FromSlave, now: float) -> list[Instruction]:
        if isinstance(message, protocol.Hello):
            return self._join(identity, message, now)
        member = self._members.get(identity)
        if member is None:
            self._dropped["message before Hello"] += 1
            return [Send(identity, protocol.Rejected(f"{type(message).__name__} before Hello"))]
        member.heard_at = now
        match message:
            case protocol.Heartbeat():
                return []
            case protocol.PeerGone(number):
                text = f"the connection from slave {member.number} to slave {number} broke"
                self._peer_gone = self._peer_gone or (now + self._limits.peer_gone_s, text)
                return []
            case protocol.PeerUnreachable(number, reason):
                return self._unreachable(member, number, reason)
            case protocol.Note(text):
                return [Noted(f"slave {member.number} {text}")]
            case protocol.Failed(text):
                return self._break(f"{member} failed: {text}")
            case protocol.Goodbye(reason):
                return self._break(f"{member} left: {reason}")
            case protocol.Rejected(reason):
                return self._break(f"{member} could not read a message of the master: {reason}")
        if message.epoch != self._phases.epoch:
            self._dropped[f"{type(message).__name__} of another epoch"] += 1
            return []
        try:
            return self._phases.progressed(member, message, now)
        except ProtocolError as error:
            return self._break(f"{member} broke the protocol: {error}")

    def _unreachable(self, member: Member, number: int, reason: str) -> list[Instruction]:
        if not 0 <= number < len(self._members):
            return self._break(f"{member} broke the protocol: it knows no slave {number}")
        peer = self._members.number(number)
        return self._break(
            f"{member} cannot reach {peer} at {peer.hello.peers}: {reason}; check that a firewall lets slaves connect "
            "to each other at any port, and that both machines are in one network"
        )

    def _unreadable(self, identity: bytes, reason: str) -> list[Instruction]:
        member = self._members.get(identity)
        if member is not None:
            return self._break(f"{member} broke the protocol: {reason}")
        self._dropped["unreadable message"] += 1
        return [Send(identity, protocol.Rejected(reason))]
