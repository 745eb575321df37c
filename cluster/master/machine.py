"""The master as a state machine: events in, instructions out. It touches no socket and no clock.

It welcomes slaves, notices those that are lost, and lets what remains through to the phases of a session
(phases.py). A slave that is lost, whatever the reason, is replaced by those that are left, or that come: the cluster
ends when none is there for a while. A slave that breaks the protocol or whose program fails ends it at once: others
would do the same.
"""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from wdpm.cluster.display import SlaveSeen
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.events import (
    Abort,
    AllJoined,
    Begin,
    Broken,
    Close,
    Event,
    GoOn,
    Instruction,
    NotComing,
    Noted,
    PartitionMade,
    ProcessEnded,
    Send,
    SlaveLost,
    SlaveSaid,
    StillAwaited,
    Tick,
    Unreadable,
    WaitForSlaves,
)
from wdpm.cluster.master.joining import JoinWait
from wdpm.cluster.master.members import MOST_SETBACKS, Member, Members, Setbacks
from wdpm.cluster.master.phases import Phases
from wdpm.cluster.master.render_status import Phase, RenderStatus, seen
from wdpm.cluster.messages import endpoints, protocol
from wdpm.kernels.launch import ONE_THREAD, Launcher
from wdpm.scenes.errors import ProtocolError

__all__ = ["Master", "Phase"]


class _Separation(NamedTuple):
    """A slave that misses another one, in an epoch of its team."""

    slave: int
    peer: int
    epoch: int


class Master:
    """The state of a cluster.

    Args:
        slaves: how many it waits for.
        versions: what the image's bits depend on, by name; slaves must have the same.
        most: slaves that may be there at a time; None for no more than it waits for.
        cores: of machines of which that is known, by name.
        launcher: what the master computes itself with, on the CPU: what lies between rounds of irradiance records.
    """

    def __init__(
        self,
        slaves: int,
        versions: Mapping[str, str],
        limits: ClusterLimits | None = None,
        most: int | None = None,
        cores: Mapping[str, int] | None = None,
        launcher: Launcher = ONE_THREAD,
    ) -> None:
        self._limits = limits or ClusterLimits()
        self._cluster = uuid.uuid4().hex
        self._members = Members(slaves, max(slaves, most or 0), versions, cores)
        self._dropped: Counter[str] = Counter()
        self._phases = Phases(self._members, self._limits, self._dropped, launcher)
        self._joining = JoinWait(self._limits, self._members)
        self._ticked_at: float | None = None
        self._beat_at = 0.0
        self._status = RenderStatus()
        self._awaited = False
        self._separations: dict[_Separation, tuple[float, str]] = {}  # until when, and why if one cannot be reached
        self._deserted: tuple[float, str] | None = None  # since when no slave is there, and why
        self._setbacks = Setbacks()

    @property
    def phase(self) -> Phase:
        """What the master waits for."""
        return self._phases.phase

    def epoch(self, identity: bytes) -> int:
        """The epoch that messages with a slave must be of; -1 if it is in no team."""
        member = self._members.get(identity)
        return -1 if member is None else self._phases.epoch_of(member)

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

    @property
    def rendering(self) -> bool:
        """Whether a session is rendered just now."""
        return self.phase not in (Phase.JOINING, Phase.IDLE, Phase.ENDED)

    def seen(self) -> tuple[SlaveSeen, ...]:
        """All slaves that ever joined, for those who look at the image."""
        return seen(self._members, self._phases.roster)

    def handle(self, event: Event, now: float) -> list[Instruction]:
        """What to do about an event.

        Args:
            now: any clock that grows [s].
        """
        out = self._handle(event, now)
        self._status.follow(out, now)
        return out

    def _handle(self, event: Event, now: float) -> list[Instruction]:
        self._note_leaving(event)
        if self.phase is Phase.ENDED:
            return self._after_end(event)
        match event:
            case SlaveSaid(identity, message):
                return self._slave_said(identity, message, now)
            case Tick():
                return self._tick(now)
            case PartitionMade(cell, triangles):
                return self._phases.roster.partition_made(cell, triangles)
            case WaitForSlaves():
                self._awaited = True
                return [] if self.phase is Phase.JOINING else self._tell_who_is_there()
            case Begin(session):
                return self._phases.begin(session, now)
            case GoOn():
                return self._phases.go_on(now)
            case SlaveLost(identity, reason):
                member = self._members.get(identity)
                return [] if member is None else self._lose(member, reason, now)
            case ProcessEnded(process, reason, left):
                return self._process_ended(process, reason, left, now)
            case NotComing(reason, left):
                return self._not_coming(reason, left, now)
            case StillAwaited(text):
                return [Noted(text)]
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
            case ProcessEnded(process):
                leaving = [member for member in self._members if member.hello.process == process]
            case _:
                return
        for member in leaving:
            if member is not None:
                member.left = True

    def _after_end(self, event: Event) -> list[Instruction]:
        if isinstance(event, Begin | WaitForSlaves):
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
        stood_still = slept if slept > self._limits.slept_s else 0.0
        out: list[Instruction] = []
        for member in list(self._members):
            if stood_still:
                member.heard_at = now  # this process itself stood still (a laptop's lid): silence says nothing
            silence = member.silence(now)
            if silence > self._limits.dead_s:
                out += self._lose(member, f"it has been silent for {silence:.0f} s, and may have died", now)
            elif (news := member.news_of_silence(now, self._limits)) is not None:
                out.append(Noted(news))
        if self.phase is Phase.JOINING and (self._awaited or self._phases.session is not None):
            out += self._wait(now)
        if self._deserted is not None and now >= self._deserted[0] + self._limits.rejoin_s:
            none_came = f"no slave is left, and none came within {self._limits.rejoin_s:g} s"
            return self._break(f"{self._deserted[1]}; {none_came}")
        for separation in [each for each, (until, _) in self._separations.items() if now >= until]:
            out += self._separated(separation, self._separations.pop(separation)[1], now)
        out += self._phases.tick(now, stood_still)
        if now < self._beat_at or self.phase is Phase.ENDED:
            return out
        self._beat_at = now + self._limits.heartbeat_s
        return out + self._to_all(protocol.Heartbeat())

    def _wait(self, now: float) -> list[Instruction]:
        """Time has passed while slaves are waited for that have not joined."""
        news = self._joining.tick(now)
        if not self._joining.over:
            return [] if news is None else [Noted(news)]
        if not len(self._members):
            return self._break(self._joining.in_vain)
        return [Noted(self._joining.enough), *self._begin_with_these(now)]

    def _begin_if_all_came(self, now: float) -> list[Instruction]:
        """Wait no longer, if all have joined that are waited for."""
        if self.phase is not Phase.JOINING or len(self._members) < self._members.expected:
            return []
        return self._begin_with_these(now)

    def _begin_with_these(self, now: float) -> list[Instruction]:
        return self._tell_who_is_there() + self._phases.all_joined(now)

    def _tell_who_is_there(self) -> list[Instruction]:
        """Answer who waits for slaves, if anyone does and a slave is there."""
        if not self._awaited or not len(self._members):
            return []
        self._awaited = False
        return [AllJoined(tuple(self.members))]

    def _process_ended(self, process: int, reason: str, left: int, now: float) -> list[Instruction]:
        """A slave will not come, or not come again: those that are left go on, or begin, without it."""
        joined = [member for member in self._members.ever_joined if member.hello.process == process]
        there = [member for member in self._members if member in joined]  # or its connection was lost before
        name = f"{joined[-1]} is lost" if joined else f"a slave (process {process}) ended before it joined"
        out: list[Instruction] = [] if joined else [Noted(f"{name}: {reason}")]
        for member in there:
            out += self._lose(member, reason, now)
        if self.phase is Phase.ENDED:
            return out
        if not left:
            return out + self._break(f"{name}: {reason}; no slave is left")
        return out + self._expect(left, now)

    def _not_coming(self, reason: str, left: int, now: float) -> list[Instruction]:
        """A slave is not waited for any longer."""
        return [Noted(f"{reason}; {_others(left)} there or on the way"), *self._expect(left, now)]

    def _expect(self, left: int, now: float) -> list[Instruction]:
        """No more slaves than these come for now: begin if all of them are here."""
        if self.phase is Phase.JOINING:
            self._members.expect_no_more_than(left)
        return self._begin_if_all_came(now)

    def _lose(self, member: Member, reason: str, now: float) -> list[Instruction]:
        """A slave is gone; others go on with what it did."""
        self._members.lose(member)
        left = f"{self._there} left"
        out: list[Instruction] = [Noted(f"{member} is lost: {reason}; {left}")]
        in_team = self._phases.roster.team_of(member) is not None  # or nobody begins anew for it
        too_many = self._count_setback(f"{member} is lost: {reason}", member) if in_team else []
        if too_many:
            return out + too_many
        out += self._phases.lost(member, now)
        if len(self._members) or self.phase is Phase.JOINING:
            return out
        self._deserted = (now, f"{member} is lost: {reason}")
        return out

    @property
    def _there(self) -> str:
        """How many slaves are there, of those that it waits for at first, later of those that it lets in."""
        waits = self.phase is Phase.JOINING
        return f"{len(self._members)} of {self._members.expected if waits else self._members.most}"

    def _join(self, identity: bytes, hello: protocol.Hello, now: float) -> list[Instruction]:
        out: list[Instruction] = []
        joined: list[Instruction] = []
        member = self._members.get(identity)
        if member is not None and self.phase is not Phase.JOINING:
            out += self._lose(member, "it lost its connection, and came back", now)
            member = None
        if member is None:
            reason = self._members.reason_to_refuse(hello)
            if reason is not None:
                self._dropped["refused slaves"] += 1
                return [
                    *out,
                    Send(identity, protocol.Refuse(reason)),
                    self._joining.refused(f"{hello.host}, process {hello.process}", reason),
                ]
            member = self._members.add(identity, hello, now)
            self._deserted = None
            if self.phase is not Phase.JOINING:
                joined = self._phases.joined(member, now)
        welcome = protocol.Welcome(member.number, self._cluster, self._limits.heartbeat_s, self._limits.dead_s)
        threads = _counted(hello.threads, "thread")
        out += [
            Send(identity, welcome),
            Noted(f"{member} joined, {threads} ({self._there})"),
        ]
        if self.phase is Phase.JOINING:
            return out + self._begin_if_all_came(now)
        return out + self._tell_who_is_there() + joined

    # Messages.

    def _slave_said(
        self, identity: bytes, message: protocol.FromSlave | protocol.FromReader, now: float
    ) -> list[Instruction]:
        if isinstance(message, protocol.Hello):
            return self._join(identity, message, now)
        if isinstance(message, protocol.AskStatus):
            refused, retried = self._dropped["refused slaves"], self._phases.tasks.retried
            known = (self.phase.value, self._members, self._phases.roster)
            return [Send(identity, self._status.report(*known, refused=refused, retried=retried, now=now))]
        member = self._members.get(identity)
        if member is None:
            self._dropped["message before Hello"] += 1
            return [Send(identity, protocol.Dismissed(f"{type(message).__name__} before Hello"))]
        member.heard_at = now
        match message:
            case protocol.Heartbeat():
                return []
            case protocol.Vitals():
                member.vitals = message
                return []
            case protocol.PeerGone(number):
                return self._miss(member, number, "", now)
            case protocol.PeerUnreachable(number, reason):
                return self._miss(member, number, reason, now)
            case protocol.Note(text):
                return [Noted(f"slave {member.number} {text}")]
            case protocol.Failed(text):
                return self._break(f"{member} failed: {text}")
            case protocol.Goodbye(reason):
                return self._lose(member, f"it left ({reason})", now)
            case protocol.Rejected(reason):
                return self._break(f"{member} could not read a message of the master: {reason}")
        if message.epoch != self._phases.epoch_of(member):
            self._dropped[f"{type(message).__name__} of another epoch"] += 1
            return []
        try:
            return self._phases.progressed(member, message, now)
        except ProtocolError as error:
            return self._break(f"{member} broke the protocol: {error}")

    def _miss(self, member: Member, number: int, unreachable: str, now: float) -> list[Instruction]:
        """A slave misses another one. That one may have died, which is known better in a moment."""
        if not 0 <= number < len(self._members.ever_joined):
            return self._break(f"{member} broke the protocol: it knows no slave {number}")
        separation = _Separation(member.number, number, self._phases.epoch_of(member))
        self._separations.setdefault(separation, (now + self._limits.peer_gone_s, unreachable))
        return []

    def _separated(self, separation: _Separation, unreachable: str, now: float) -> list[Instruction]:
        """Two slaves have missed each other for a moment, and both may be there still."""
        member, peer = self._members.ever_joined[separation.slave], self._members.ever_joined[separation.peer]
        if member.left or peer.left:
            return []
        if unreachable and (silence := peer.silence(now)) > self._limits.late_s:
            # It stands still, as the master has done perhaps, which is why it does not miss it yet.
            return self._lose(peer, f"{member} cannot reach it, and it has been silent for {silence:.0f} s", now)
        if unreachable:
            endpoint = peer.hello.peers.partition("#")[0]  # the rest is a key
            advice = endpoints.check_reach(
                endpoint,
                "check that a firewall lets slaves connect to each other at any port, and that both machines are in "
                "one network",
            )
            reason = unreachable if advice in unreachable else f"{unreachable}; {advice}"
            return self._break(f"{member} cannot reach {peer} at {endpoint}: {reason}")
        if self._phases.epoch_of(member) != separation.epoch:
            return []  # many connections break together: for the first of them all have begun anew, and connected again
        text = f"the connection from {member} to {peer} broke"
        return self._count_setback(text) or [
            Noted(f"{text}; they connect again"),
            *self._phases.separated(member, peer, now),
        ]

    def _count_setback(self, setback: str, lost: Member | None = None) -> list[Instruction]:
        """End a cluster that begins anew all the time and gets nothing done."""
        if not self._setbacks.add(self._phases.tasks.ever_done, len(self._members.ever_joined), lost):
            return []
        times = f"slaves were lost or separated {MOST_SETBACKS} times"
        return self._break(f"{times}, and no task was done since then: {setback}")

    def _unreadable(self, identity: bytes, reason: str) -> list[Instruction]:
        member = self._members.get(identity)
        if member is not None:
            return self._break(f"{member} broke the protocol: {reason}")
        self._dropped["unreadable message"] += 1
        return [Send(identity, protocol.Rejected(reason))]


def _counted(count: int, what: str) -> str:
    """2 threads, 1 thread."""
    return f"{count} {what}{'s' * (count != 1)}"


def _others(count: int) -> str:
    return f"{_counted(count, 'other')} {'is' if count == 1 else 'are'}"
