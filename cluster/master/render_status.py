"""How far a render is, for those who ask (`wdpm status`): counted from what goes in and out of the state machine."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from wdpm.cluster.display import SlaveSeen
from wdpm.cluster.master import events as m
from wdpm.cluster.master.members import Member, Members
from wdpm.cluster.master.roster import Roster
from wdpm.cluster.messages import protocol


class Phase(Enum):
    """What the master waits for."""

    JOINING = "joining"
    IDLE = "idle"
    SETUP = "setup"
    PHOTONS = "photons"
    MAPS = "maps"
    RECORDS = "records"
    BUCKETS = "buckets"
    STATISTICS = "statistics"
    ENDED = "ended"


class RenderStatus:
    """Keeps count."""

    def __init__(self) -> None:
        self._units = self._done = self._images = 0
        self._phase_at: float | None = None

    def follow(self, instructions: Iterable[m.Instruction], now: float) -> None:
        """What the state machine wants done says how far it is."""
        for instruction in instructions:
            match instruction:
                case m.Started(_, total):
                    self._units, self._done, self._phase_at = total, 0, now
                case m.Advanced(amount):
                    self._done += amount
                case m.Finished():
                    self._images += 1
                    self._units, self._done, self._phase_at = 0, 0, now

    def report(
        self, phase: str, members: Members, roster: Roster, *, refused: int, retried: int, now: float
    ) -> protocol.StatusReport:
        """The answer to AskStatus."""
        lost = sum(member.left for member in members.ever_joined)
        return protocol.StatusReport(
            phase=phase,
            units=self._units,
            done=self._done,
            phase_s=0.0 if self._phase_at is None else now - self._phase_at,
            images=self._images,
            expected=members.expected,
            most=members.most,
            joined=len(members.ever_joined),
            lost=lost,
            refused=refused,
            retried=retried,
            slaves=tuple(_status_of(member, roster, now) for member in members),
        )


def _status_of(member: Member, roster: Roster, now: float) -> protocol.SlaveStatus:
    hello = member.hello
    team = next((number for number, team in enumerate(roster.teams) if member in team.members), -1)
    return protocol.SlaveStatus(
        number=member.number,
        host=hello.host,
        process=hello.process,
        threads=hello.threads,
        memory=hello.own_memory or hello.memory,
        peak_memory=member.peak_memory,
        team=team,
        cells=len(member.cells),
        tasks=len(member.in_flight),
        done=member.done,
        busy_s=member.busy_s,
        silent_s=member.silence(now),
        now=member.vitals,
    )


def seen(members: Members, roster: Roster) -> tuple[SlaveSeen, ...]:
    """All that ever joined, for those who look at the image."""
    return tuple(_seen(member, roster) for member in members.ever_joined)


def _seen(member: Member, roster: Roster) -> SlaveSeen:
    team = roster.team_of(member)
    all_cells = 0 if team is None else len(team.holders)
    vitals = member.vitals or protocol.Vitals()
    return SlaveSeen(
        member.name,
        cells=len(member.cells),
        whole=0 < all_cells == len(member.cells),
        lost=member.left,
        memory=vitals.memory,
        cores=vitals.cores,
        sent=vitals.sent,
        received=vitals.received,
    )
