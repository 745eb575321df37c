"""Teams: slaves that have all cells of the scene among them, so that a ray of theirs never leaves the team.

Where a slave has room for the whole scene it is a team by itself. Where nobody has, all slaves are one team. In between
there are several teams of several slaves: each holds a copy of what the others hold.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.master.cell_holders import balanced_holders
from wdpm.cluster.master.members import Member
from wdpm.cluster.master.tasks import LATE_S
from wdpm.cluster.messages import protocol
from wdpm.cluster.messages.endpoints import LOCAL
from wdpm.cluster.task import PhotonTask

UNAWAITED = (protocol.ViewSet, protocol.RecordsSet)
"""Answers that a slave alone is not waited for: that it has the view, or the records, that it was sent."""


@dataclass(eq=False)
class Team:
    """Some slaves, and how far they are.

    Attributes:
        size: slaves that it is meant to have.
        epoch: of its messages; a new one for every set-up. -1 while it has none.
        holders: cell -> number of the slave that holds it.
        awaits: the answer that it owes, from the slaves in `waiting` ...
        towards: ... and the number of the trace, view or records that it will have then.
        ready: its cells are built.
        trace: number of the trace whose photons its slaves hold, or will.
        mapped: its maps are built.
        traced: tasks of a trace of all teams that this one has done.
        own_trace: tasks of a trace of its own that are not handed out; None if it makes none.
        view, records: numbers of the view and of the irradiance records that its slaves have.
        early: whether it has begun with tasks before it has the records that they need.
        owed: answers to orders that nobody waits for.
        behind: the others trace photons and build maps without it, since they had waited for it too long.
    """

    members: list[Member]
    size: int
    epoch: int = -1
    holders: tuple[int, ...] = ()
    awaits: type[protocol.FromSlave] | None = None
    waiting: set[int] = field(default_factory=set)
    towards: int = 0
    ready: bool = False
    trace: int = 0
    mapped: bool = False
    traced: list[PhotonTask] = field(default_factory=list)
    own_trace: list[PhotonTask] | None = None
    view: int = 0
    records: int = 0
    early: bool = False
    owed: Counter[type[protocol.FromSlave]] = field(default_factory=Counter)
    behind: bool = False

    def __str__(self) -> str:
        return ", ".join(map(str, self.members))

    @property
    def at_work(self) -> bool:
        """Whether one of its slaves has a task."""
        return any(member.in_flight for member in self.members)

    def traces(self, trace: int) -> bool:
        """Whether it is ready to trace photons with others, or does."""
        return self.ready and self.trace == trace and self.awaits is None and not self.behind

    def has_maps(self, trace: int) -> bool:
        """Whether it has built the maps of a trace."""
        return self.mapped and self.trace == trace

    def maps(self, trace: int) -> bool:
        """Whether it builds these maps with others, or has built them."""
        return self.awaits is protocol.MapsBuilt or self.has_maps(trace)

    @property
    def needs_no_other(self) -> bool:
        """Whether it is one slave that has the whole scene, and does its tasks itself, one after another."""
        return len(self.holders) == 1 and all(member.hello.processes == 1 for member in self.members)

    def works(self, trace: int, view: int, records: int) -> bool:
        """Whether it has all that tasks of a view need."""
        up_to_date = self.view == view and (self.early or self.records == records)
        return self.awaits is None and self.has_maps(trace) and up_to_date

    def answers_late(self, answer: type[protocol.FromSlave]) -> bool:
        """Whether an answer is one that nobody waits for; it is owed no more."""
        late = self.owed[answer] > 0
        self.owed[answer] -= late
        return late

    def take_step(self) -> None:
        """All slaves have answered what was asked of them."""
        answer, self.awaits = self.awaits, None
        if answer in (protocol.Ready, protocol.PhotonsForgotten):  # a world comes without photons
            self.ready, self.mapped, self.trace = True, False, self.towards
        elif answer is protocol.MapsBuilt:
            self.mapped, self.own_trace = True, None
        elif answer is protocol.ViewSet:
            self.view, self.records = self.towards, 0
        elif answer is protocol.RecordsSet:
            self.records = self.towards

    def dissolve(self) -> None:
        """What its slaves did is void, and what they say of it: they are of no epoch until the next begins."""
        self.epoch = -1
        self.awaits, self.waiting = None, set()
        self.ready = self.mapped = False
        self.traced, self.own_trace = [], None
        self.trace = self.view = self.records = 0
        self.early = False
        self.owed.clear()

    def begin(self, epoch: int, burdens: Sequence[float]) -> None:
        """Begin an epoch: cells are assigned to slaves anew."""
        self.dissolve()
        self.epoch = epoch
        self.holders = self._assigned(burdens)

    def _assigned(self, burdens: Sequence[float]) -> tuple[int, ...]:
        """Balanced holders of the cells, each slave with the share of which it has most already."""
        shares = balanced_holders(np.array(burdens), len(self.members))
        left = list(range(len(self.members)))
        holders = [0] * len(burdens)
        for member in sorted(self.members, key=lambda member: -len(member.cells)):
            best = max(left, key=lambda share: sum(shares[cell] == share for cell in member.cells))
            left.remove(best)
            for cell, share in enumerate(shares):
                if share == best:
                    holders[cell] = member.number
        return tuple(holders)

    def cells_of(self, member: Member) -> list[int]:
        """What a slave is to hold."""
        return [cell for cell, holder in enumerate(self.holders) if holder == member.number]

    def wait_for(self, answer: type[protocol.FromSlave], towards: int = 0) -> None:
        """All its slaves owe an answer.

        A slave alone is not waited for where it does nothing but take something in, since it does what it is told in
        the order in which it is told. Where there are several, one would get batches of another that has heard more.
        """
        self.awaits, self.waiting = answer, {member.number for member in self.members}
        self.towards = towards
        if len(self.members) == 1 and answer in UNAWAITED:
            self.owed[answer] += 1
            self.waiting.clear()
            self.take_step()


def formed(members: Sequence[Member], team_size: int, cells: int) -> tuple[list[Team], list[Member]]:
    """Teams of at least so many slaves, as many and as equal as can be, and the slaves that are left over.

    Args:
        team_size: slaves that a team needs to hold all cells; with fewer in all there is one team.
        cells: no team can have more slaves than there are cells.
    """
    if not members:
        return [], []
    count = max(1, len(members) // team_size)
    groups = [list(members[index::count]) for index in range(count)]
    teams = [Team(each[:cells], min(len(each), cells)) for each in groups]
    return teams, [member for each in groups for member in each[cells:]]


def ready_for_maps(teams: Sequence[Team], trace: int) -> bool:
    """Whether all teams that others wait for are ready with the photons of a trace, if no task is left of it."""
    return bool(teams) and all(team.behind or team.traces(trace) for team in teams)


def late_to_trace(teams: Sequence[Team], trace: int) -> list[Team]:
    """Teams that are not ready to trace photons, or are at some, while all others have nothing to do."""
    together = [team for team in teams if not team.behind]
    late = [team for team in together if team.at_work or not team.traces(trace)]
    return late if len(late) < len(together) else []


def silent_in_maps(teams: Sequence[Team], trace: int, now: float, began: float) -> list[Team]:
    """Teams that build maps, and of which nothing was heard for as long as all had taken till then; [] if all are.

    Nothing but silence tells who is late: each waits for photons of the others.

    Args:
        began: when the first photon was traced [s].
    """
    together = [team for team in teams if team.maps(trace)]
    silences = [max(member.silence(now) for member in team.members) for team in together]
    silent = [
        team
        for team, silence in zip(together, silences, strict=True)
        if silence > LATE_S and silence > now - silence - began
    ]
    return silent if len(silent) < len(together) else []


def begin_early(
    teams: Sequence[Team], trace: int, view: int, records: int, cores: Mapping[str, int]
) -> list[tuple[Member, protocol.AwaitRecords]]:
    """Have slaves that need no others begin with what needs no records, while these are worked out.

    One alone does not, nor do those that the master would have to share its core with: all wait for what it works out.

    Args:
        trace, view, records: numbers of those that a slave must have to begin.
        cores: of machines of which that is known, by name: of the master's.
    """
    early = [team for team in teams if team.needs_no_other and not team.at_work and team.works(trace, view, records)]
    members = [member for team in teams for member in team.members]
    if len(members) == 1:
        return []
    for host, count in cores.items():
        spare = count - sum(member.hello.threads for member in members if member.hello.host == host)
        for team in [team for team in early if team.members[0].hello.host == host]:
            if spare < 1:
                early.remove(team)
                spare += team.members[0].hello.threads
    for team in early:
        team.early = True
    return [(member, protocol.AwaitRecords(team.epoch)) for team in early for member in team.members]


def all_share_memory(teams: Sequence[Team]) -> bool:
    """Whether all slaves are on one machine and share memory: one makes what all then have (host_cache.py)."""
    return all(member.hello.peers.startswith(LOCAL) for team in teams for member in team.members)


def map_orders(teams: Sequence[Team], regions: NDArray[np.float32]) -> list[tuple[Member, protocol.BuildMaps]]:
    """What each slave is told that is to build maps.

    Args:
        regions: as protocol.BuildMaps has them, in the order of the teams.
    """
    copies, parts = copies_between(teams), len(teams)
    return [
        (
            member,
            protocol.BuildMaps(
                team.epoch, copies[member.number], len(team.cells_of(member)) * (parts - 1), part, parts, regions
            ),
        )
        for part, team in enumerate(teams)
        for member in team.members
    ]


def copies_between(teams: Sequence[Team]) -> dict[int, tuple[protocol.Copy, ...]]:
    """Who sends what landed in his cells to whom: slave -> copies. Every team gets what landed in all others."""
    endpoints = {member.number: member.hello.peers for team in teams for member in team.members}
    copies: dict[int, list[protocol.Copy]] = {number: [] for number in endpoints}
    for source in teams:
        for target in teams:
            if target is not source:
                for cell, holder in enumerate(source.holders):
                    receiver = target.holders[cell]
                    copies[holder].append(protocol.Copy(cell, receiver, target.epoch, endpoints[receiver]))
    return {number: tuple(of_slave) for number, of_slave in copies.items()}
