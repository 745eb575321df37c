"""Who is in which team, and the cells that they are sent."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from wdpm.cluster.host_memory import SlaveMemory, rooms_of
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.cells import CellQueue, Delivery, parts_of
from wdpm.cluster.master.events import Instruction, MakePartition, Noted, Send
from wdpm.cluster.master.members import Member, Members
from wdpm.cluster.master.tasks import Tasks
from wdpm.cluster.master.teams import Team, formed
from wdpm.cluster.messages import protocol
from wdpm.cluster.session import Session
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.arrays import Triangles


class Roster:
    """The teams of a cluster.

    Attributes:
        teams: the slaves that share the work.
        spare: those that are in no team: some of them for want of memory.
    """

    def __init__(self, members: Members, limits: ClusterLimits) -> None:
        self.teams: list[Team] = []
        self.spare: list[Member] = []
        self._members = members
        self._part_triangles = limits.part_triangles
        self._cells = CellQueue(limits.cells_in_flight)
        self._epoch = 0
        self._room = -math.inf
        self._noted_short: set[int] = set()

    def form(self, session: Session, tasks: Tasks) -> list[Instruction]:
        """Make teams for a scene that nobody knows."""
        for team in self.teams:
            self.dissolve(team, tasks)
        for member in self._members:
            member.cells = frozenset()
        self._room, self._noted_short = session.room, set()
        everyone = list(self._members)
        able = self._able(everyone) or everyone  # rather than wait for others
        self.teams, spare = formed(able, team_size_of(session), session.cells)
        self.spare = spare + [member for member in everyone if member not in able]
        return self.note_slaves_short_of_memory()

    def _able(self, slaves: Sequence[Member]) -> list[Member]:
        """Those that have room for their share of the scene."""
        there = list(self._members)
        rooms = rooms_of([SlaveMemory(each.hello.host, each.hello.memory, each.hello.own_memory) for each in there])
        room = {member.number: of_member for member, of_member in zip(there, rooms, strict=True)}
        return [slave for slave in slaves if room[slave.number] >= self._room]

    def teams_of_spare(self, team_size: int) -> Iterator[Team]:
        """New teams of slaves that were in none, while there are enough for one."""
        while self.able_spare >= team_size:
            self.teams.append(Team(self.take_spare(team_size), team_size))
            yield self.teams[-1]

    def fill_up(self, team: Team, size: int) -> None:
        """Bring a team that begins anew to a size, as far as there are spare slaves; without any it is no more."""
        team.size = size
        team.members += self.take_spare(size - len(team.members))
        if not team.members:
            self.teams.remove(team)
        if all(each.behind for each in self.teams):
            for each in self.teams:  # nobody is left that could go on without them
                each.behind = False
        if not self.teams and (last := self.take_spare(size, anyone=True)):
            self.teams.append(Team(last, size))

    def take_spare(self, count: int, *, anyone: bool = False) -> list[Member]:
        """At most so many slaves that are in no team, and have room for a share of the scene.

        Args:
            anyone: if none has, take others: nobody else is there to go on.
        """
        taken = self._able(self.spare) or (self.spare if anyone else [])
        taken = taken[: max(count, 0)]
        self.spare = [member for member in self.spare if member not in taken]
        return taken

    @property
    def able_spare(self) -> int:
        """Slaves that are in no team, though they have room for a share of the scene."""
        return len(self._able(self.spare))

    def note_slaves_short_of_memory(self) -> list[Instruction]:
        """A line, once, for each spare slave that has not the memory for a share of the scene."""
        able = self._able(self.spare)
        small = [each for each in self.spare if each not in able and each.number not in self._noted_short]
        self._noted_short |= {member.number for member in small}
        text = "has not the memory for a share of the scene, and waits until nobody else is left; give it more --memory"
        return [Noted(f"{member} {text}") for member in small]

    def team_of(self, member: Member) -> Team | None:
        """The team that a slave is in, if it is in one."""
        return next((team for team in self.teams if member in team.members), None)

    def holders(self) -> tuple[int, ...]:
        """Who holds each cell in the first team."""
        return self.teams[0].holders if self.teams else ()

    def dissolve(self, team: Team, tasks: Tasks) -> None:
        """What a team does is void, and so is what it holds, but for cells."""
        for member in team.members:
            tasks.give_back(member)
        self._cells.forget(team.epoch)
        team.dissolve()

    def set_up(self, team: Team, session: Session, trace: int) -> list[Instruction]:
        """Begin an epoch: cells are assigned to the slaves of a team, who keep what they have of them."""
        self._epoch += 1
        team.begin(self._epoch, session.burdens)
        peers = [""] * len(self._members.ever_joined)
        for member in team.members:
            peers[member.number] = member.hello.peers
        out: list[Instruction] = []
        team.wait_for(protocol.Ready, trace)
        for member in team.members:
            cells = team.cells_of(member)
            kept = tuple(cell for cell in cells if cell in member.cells)
            member.cells = frozenset(kept)
            setup = protocol.Setup(team.epoch, session.world, team.holders, tuple(peers), kept, session.digest)
            out.append(Send(member.identity, setup))
        for cell, holder in enumerate(team.holders):
            if cell not in self._members.ever_joined[holder].cells:
                self._cells.add(Delivery(team.epoch, holder, cell))
        return out + self.next_cells()

    def next_cells(self) -> list[Instruction]:
        """Cells that may set out now."""
        return [MakePartition(cell) for cell in self._cells.next()]

    def partition_made(self, cell: int, triangles: Triangles) -> list[Instruction]:
        """Send a cell that was asked for to whom it was made for."""
        delivery = self._cells.made(cell)
        if delivery is None:
            return []
        slave = self._members.ever_joined[delivery.slave]
        parts = parts_of(delivery.epoch, cell, triangles, self._part_triangles)
        return [Send(slave.identity, part) for part in parts]

    def cell_received(self, member: Member, message: protocol.PartitionReceived) -> list[Instruction]:
        """A slave says that it has a cell."""
        if not self._cells.arrived(Delivery(message.epoch, member.number, message.cell)):
            raise ProtocolError(f"it says that it got cell {message.cell}, which was not sent to it")
        return self.next_cells()


def team_size_of(session: Session) -> int:
    """Slaves that a team needs: no more than there are cells."""
    return min(session.team_size, session.cells)
