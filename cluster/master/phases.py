"""The phases that a master leads its teams through, session after session.

    joining -> idle -> setup -> photons -> maps -> (records, once a round) -> buckets -> statistics -> idle

A session is in one phase. Each team takes the steps of its own that the phase asks for (`_lead`): its cells, photons,
maps, view, records, and then tasks. A slave says when it has taken a step, and a team goes on when all its slaves have:
so a batch of a bucket cannot reach a slave that has not seen its view. Phases in which teams need each other end when
all have come as far: photons (which all teams trace together) and maps.

A team that loses a slave begins anew: an epoch of its own tells what is left of the old one apart. Slaves keep the
cells that they have. What is finished stays, since it is a function of scene and settings: buckets, rounds of records.
Photons that were lost are traced again, by all while they trace, later by the team that needs them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.events import Advanced, Finished, GoOnLater, Instruction, Noted, Send, Started
from wdpm.cluster.master.map_regions import regions_of
from wdpm.cluster.master.members import Member, Members
from wdpm.cluster.master.observing import bucket_done, frame_begun, shown_again, worth_keeping
from wdpm.cluster.master.records import RecordRounds
from wdpm.cluster.master.render_status import Phase
from wdpm.cluster.master.roster import Roster, team_size_of
from wdpm.cluster.master.statistics import all_photons_counted, check_photon_counts, check_statistics, of_nobody
from wdpm.cluster.master.task_sizes import capacities, parallel_tasks, photon_task_size
from wdpm.cluster.master.tasks import Tasks, units
from wdpm.cluster.master.teams import (
    Team,
    all_share_memory,
    begin_early,
    late_to_trace,
    map_orders,
    ready_for_maps,
    silent_in_maps,
)
from wdpm.cluster.messages import protocol
from wdpm.cluster.session import Session
from wdpm.cluster.task import PhotonsTraced, PhotonTask, Task, TaskResult
from wdpm.cluster.world import NO_REGIONS, PhotonPlan
from wdpm.kernels.launch import ONE_THREAD, Launcher
from wdpm.scenes.errors import ProtocolError

WORTH_REGROUPING = 0.5
"""A team of several begins anew for a slave that joins while no larger share of the buckets was handed out."""


class Phases:
    """What a cluster does for one session after another.

    Attributes:
        phase: what is waited for.
        session: what is rendered, or waits for slaves to join.
        roster, tasks: the slaves that share the work, in teams, and what they share.
    """

    def __init__(
        self, members: Members, limits: ClusterLimits, dropped: Counter[str], launcher: Launcher = ONE_THREAD
    ) -> None:
        """
        Args:
            dropped: counts messages that are not used, by reason.
            launcher: see Master.
        """
        self.phase = Phase.JOINING
        self.session: Session | None = None
        self._members = members
        self._limits = limits
        self._dropped = dropped
        self._launcher = launcher
        self._phase_at = self._photons_at = self._moved_at = 0.0
        self._seconds: dict[str, float] = {}
        self._digest: str | None = None
        self._plan: PhotonPlan | None = None
        self._trace = self._view = self._records = 0
        self._setting_up = False
        self._lost: list[Member] = []
        self.roster = Roster(members, limits)
        self.tasks = Tasks()

    def begin(self, session: Session, now: float) -> list[Instruction]:
        """Render a session, as soon as all slaves have joined."""
        if self.phase not in (Phase.JOINING, Phase.IDLE) or self.session is not None:
            raise AssertionError(f"a session began in phase {self.phase.value}")
        if len(session.burdens) != session.cells:
            raise AssertionError(f"{len(session.burdens)} burdens for {session.cells} cells")
        self.session = session
        return self._start_session(session, now) if self.phase is Phase.IDLE else []

    def all_joined(self, now: float) -> list[Instruction]:
        """All slaves have joined."""
        self.phase = Phase.IDLE
        return [] if self.session is None else self._start_session(self.session, now)

    def end(self) -> None:
        """Wait for nothing any more."""
        self.phase = Phase.ENDED
        self.session = self.tasks.film = None

    def epoch_of(self, member: Member) -> int:
        """The epoch of a slave's team, -1 if it has none."""
        team = self.roster.team_of(member)
        return -1 if team is None else team.epoch

    # Coming and going.

    def joined(self, member: Member, now: float) -> list[Instruction]:
        """A slave has joined after the first session began."""
        self.roster.spare.append(member)
        if self.session is None or self.phase in (Phase.JOINING, Phase.IDLE):
            return []
        return self._use_spare(self.session, now)

    def lost(self, member: Member, now: float) -> list[Instruction]:
        """A slave is gone. Its team begins anew without it, and its tasks are done by others."""
        self._lost.append(member)
        self.tasks.give_back(member)
        if member in self.roster.spare:
            self.roster.spare.remove(member)
        team = self.roster.team_of(member)
        if team is None:
            return []
        team.members.remove(member)
        return self._restart_team(team, now)

    def separated(self, one: Member, other: Member, now: float) -> list[Instruction]:
        """The connection between two slaves broke, and what travelled on it is lost; both live."""
        team = self.roster.team_of(one)
        if team is not None and (other in team.members or self.phase is Phase.MAPS):
            return self._restart_team(team, now)
        return []

    def tick(self, now: float, stood_still: float = 0.0) -> list[Instruction]:
        """Time has passed: tasks may be late, and teams; but for so long nothing could move, or be heard of [s]."""
        self._photons_at, self._moved_at = self._photons_at + stood_still, self._moved_at + stood_still
        if self.session is not None and self.phase in (Phase.PHOTONS, Phase.MAPS):
            return self._leave_behind(self.session, now)
        if self.phase not in (Phase.RECORDS, Phase.BUCKETS) or self.tasks.waiting:
            return []
        idle = [member for team in self._working() if not team.at_work for member in team.members[:1]]
        return self._start_tasks(list(self.tasks.hand_out_late(idle, now)))

    def _leave_behind(self, session: Session, now: float) -> list[Instruction]:
        """Go on without teams that the others have waited for as long as it takes to do without them.

        What they have traced others trace, and they trace all for themselves when they can.
        """
        if self.phase is Phase.PHOTONS:
            limit = max(self.tasks.late_after, self._moved_at - self._photons_at)
            late = late_to_trace(self.roster.teams, self._trace) if now > self._moved_at + limit else []
        else:
            late = silent_in_maps(self.roster.teams, self._trace, now, self._photons_at)
        out: list[Instruction] = [Noted(f"others go on without {team}, which is late") for team in late]
        for team in late:
            team.behind = True
        for team in late:
            out += self._restart_team(team, now) if team.ready else []  # else what it is sent is on its way
        return out + (self._go_on(session, now) if late else [])

    # What slaves say.

    def progressed(self, member: Member, message: protocol.Progress, now: float) -> list[Instruction]:
        """A slave says how far it is, or what came of a task; ProtocolError where that cannot be."""
        team, session = self.roster.team_of(member), self.session
        if team is None:
            raise AssertionError("a message of no epoch")
        if isinstance(message, protocol.TaskDone):
            return self._task_done(team, member, message.result, now)
        if isinstance(message, protocol.PartitionReceived):
            return self.roster.cell_received(member, message)
        if team.answers_late(type(message)):
            return []
        if team.awaits is not type(message) or member.number not in team.waiting:
            raise ProtocolError(f"{type(message).__name__} is not expected from it in phase {self.phase.value}")
        if isinstance(message, protocol.Statistics) and session is not None:
            check_statistics(message.values, session.world)
            member.statistics = {**message.values, "slave": member.number}
            member.peak_memory = message.values["peak_memory_bytes"]
        if isinstance(message, protocol.MapsBuilt) and session is not None:
            check_photon_counts(message.counted, session.world)
            member.counted = message.counted
        if isinstance(message, protocol.Ready):
            member.cells = frozenset(team.cells_of(member))
        self._moved_at = now
        team.waiting.remove(member.number)
        counts = (self.phase, type(message)) in ((Phase.SETUP, protocol.Ready), (Phase.MAPS, protocol.MapsBuilt))
        out: list[Instruction] = [Advanced(1)] if counts else []
        if not team.waiting:
            team.take_step()
            out += [] if session is None else self._lead(team, session, now) + self._go_on(session, now)
        return out

    # A session.

    def _follow_up(self, session: Session, now: float) -> list[Instruction]:
        return self._lead_all(session, now) + self._go_on(session, now)

    def _start_session(self, session: Session, now: float) -> list[Instruction]:
        self._seconds, self._phase_at = {}, now
        self._lost, self._records = [], 0
        self._view += 1
        for team in self.roster.teams:
            team.behind = team.behind and (team.at_work or team.awaits is not None)
        same_scene = session.digest == self._digest
        out = self._use_spare(session, now) if same_scene else self.roster.form(session, self.tasks)
        plan = session.world.photon_plan
        self.phase = Phase.SETUP
        if session.retrace or plan != self._plan or not any(team.has_maps(self._trace) for team in self.roster.teams):
            self._digest, self._plan = session.digest, plan
            self._begin_trace(session)
        else:
            out += self._start_view(session, now)
        self._setting_up = not all(team.ready for team in self.roster.teams)
        if self._setting_up:
            out.append(Started("partition", sum(len(team.members) for team in self.roster.teams)))
        return out + self._follow_up(session, now)

    def _begin_trace(self, session: Session) -> None:
        """All photons are to be traced, by all teams together."""
        self._trace += 1
        size = photon_task_size(session, self._members, len(self.roster.teams), self._limits)
        self.tasks.trace(session.world.paths, size)
        for team in self.roster.teams:
            team.mapped, team.traced, team.own_trace = False, [], None

    def _go_on(self, session: Session, now: float) -> list[Instruction]:
        """Enter the next phase if all that this one waits for is done."""
        teams = self.roster.teams
        match self.phase:
            case Phase.SETUP if any(team.traces(self._trace) for team in teams):
                return self._start_photons(session, now)  # with whoever is ready, while others are sent their cells
            case Phase.PHOTONS if self.tasks.finished and ready_for_maps(teams, self._trace):
                return self._start_maps(session, now)
            case Phase.MAPS if not any(team.awaits is protocol.MapsBuilt for team in teams):
                self._end_maps(session, now)
                return self._start_view(session, now) + self._follow_up(session, now)
            case Phase.RECORDS if self.tasks.finished and self.tasks.rounds is not None:
                return self._end_round(self.tasks.rounds, session, now)
            case Phase.BUCKETS if self.tasks.finished:
                return self._start_statistics(session, now)
            case Phase.STATISTICS if not any(team.awaits for team in teams if team.has_maps(self._trace)):
                return self._finish()
        return []

    def _start_photons(self, session: Session, now: float) -> list[Instruction]:
        if self._setting_up:
            self._end_phase("partition", now)
        self.phase, self._photons_at, self._moved_at = Phase.PHOTONS, now, now
        out: list[Instruction] = [Started("photons", session.world.paths)]
        return out + self._hand_out(session, now) + self._go_on(session, now)

    def _start_maps(self, session: Session, now: float) -> list[Instruction]:
        self._end_phase("photons", now)
        self.phase = Phase.MAPS
        teams = [team for team in self.roster.teams if not team.behind]
        for team in teams:
            team.wait_for(protocol.MapsBuilt)
        regions = NO_REGIONS if all_share_memory(teams) else regions_of(session, len(teams))
        orders = map_orders(teams, regions)
        return [Started("map", len(orders)), *(Send(member.identity, order) for member, order in orders)]

    def _end_maps(self, session: Session, now: float) -> None:
        """Teams that were late traced no photons of these maps, though later they trace all for themselves."""
        self._end_phase("map", now)
        traced = [member for team in self.roster.teams if team.has_maps(self._trace) for member in team.members]
        self.tasks.counted = all_photons_counted([member.counted for member in traced], len(session.world.lights.names))

    def _start_view(self, session: Session, now: float) -> list[Instruction]:
        """The first round of irradiance records, or those that are there already."""
        self._phase_at = now
        rounds = self.tasks.rounds = RecordRounds(session.view, session.records, session.kept.records, self._launcher)
        if len(rounds.records):
            self._records += 1
        if rounds.finished:
            return self._start_buckets(session)
        self.phase = Phase.RECORDS
        self.tasks.make_records(rounds, session, self._members, len(self.roster.teams), self._limits)
        return [Started("records", rounds.total), *([Advanced(rounds.kept)] if rounds.kept else [])]

    def _end_round(self, rounds: RecordRounds, session: Session, now: float) -> list[Instruction]:
        """All get all records before the next round: a few megabytes at most, and each keeps what reaches its cells."""
        out: list[Instruction] = []
        while self.tasks.finished and self.phase is Phase.RECORDS:  # a round may be without candidates
            rounds.end_round()
            if rounds.finished:
                self._end_phase("records", now)
                out = self._start_buckets(session)
            else:
                self.tasks.make_records(rounds, session, self._members, len(self.roster.teams), self._limits)
        orders = begin_early(self.roster.teams, self._trace, self._view, self._records, self._members.cores)
        self._records += 1
        out += [Send(member.identity, order) for member, order in orders]
        return [*out, *self._hand_out(session, now), GoOnLater()]

    def go_on(self, now: float) -> list[Instruction]:
        """What was put off until slaves had something to do."""
        return [] if self.session is None else self._follow_up(self.session, now)

    def _start_buckets(self, session: Session) -> list[Instruction]:
        self.phase = Phase.BUCKETS
        kept = self.tasks.render(session, parallel_tasks(session, self._members, len(self.roster.teams)))
        begun = Started("render", self.tasks.total + len(kept))
        done = [Advanced(len(kept))] if kept else []
        return [begun, *done, frame_begun(session, self.roster.holders(), self._members), *shown_again(kept)]

    def _start_statistics(self, session: Session, now: float) -> list[Instruction]:
        self._end_phase("render", now)
        self.phase = Phase.STATISTICS
        return self._follow_up(session, now)

    def _ask_for_statistics(self, team: Team) -> list[Instruction]:
        """Of who traced photons: also of a team that was about to take part in the view when others had finished it."""
        if not team.has_maps(self._trace) or all(member.statistics for member in team.members):
            return []
        return self._order(team, protocol.Statistics, protocol.ReadStatistics(team.epoch))

    def _finish(self) -> list[Instruction]:
        statistics = [member.statistics for member in self._members if member.statistics] or [of_nobody()]
        at_work = [team for team in self.roster.teams if team.at_work and team.view == self._view]  # at others' tasks
        unheard = [member for team in at_work for member in team.members if not member.statistics]
        missing = tuple(map(str, self._lost)), tuple(map(str, unheard))
        result = self.tasks.end(statistics, self._seconds, self._dropped, *missing)
        self.phase, self.session = Phase.IDLE, None
        for team in self.roster.teams:
            if not team.ready:  # its cells would be those of a session that has ended
                self.roster.dissolve(team, self.tasks)
        for member in self._members:
            member.statistics = {}
        return [Finished(result)]

    # Teams.

    def _lead(self, team: Team, session: Session, now: float) -> list[Instruction]:
        """Have a team take its next step, if there is one that does not wait for others."""
        if team.awaits is not None or (team.at_work and not team.early) or self.phase in (Phase.IDLE, Phase.ENDED):
            return []
        if self.phase is Phase.STATISTICS:
            return self._ask_for_statistics(team)
        if not team.ready:
            return self.roster.set_up(team, session, self._trace)
        if team.trace != self._trace:
            plan = protocol.ForgetPhotons(team.epoch, session.world.photon_plan)
            return self._order(team, protocol.PhotonsForgotten, plan, self._trace)
        if not team.mapped:
            return self._trace_by_itself(team, session, now)
        if team.view != self._view:
            view = protocol.SetView(team.epoch, session.view)
            return self._order(team, protocol.ViewSet, view, self._view) + self._lead(team, session, now)
        rounds = self.tasks.rounds
        if rounds is not None and team.records != self._records:
            records = protocol.SetRecords(team.epoch, rounds.shared())
            team.early = False
            return self._order(team, protocol.RecordsSet, records, self._records) + self._lead(team, session, now)
        return self._hand_out(session, now)

    def _lead_all(self, session: Session, now: float) -> list[Instruction]:
        return [instruction for team in list(self.roster.teams) for instruction in self._lead(team, session, now)]

    def _trace_by_itself(self, team: Team, session: Session, now: float) -> list[Instruction]:
        """A team that has no maps while others go on traces all photons for itself. Early it traces with the others."""
        if self.phase is Phase.PHOTONS:
            return self._hand_out(session, now)
        if self.phase in (Phase.SETUP, Phase.MAPS):
            return []
        if team.own_trace is None:
            team.own_trace = self.tasks.photon_tasks()
        if not team.own_trace:
            return self._order(team, protocol.MapsBuilt, protocol.BuildMaps(team.epoch))
        return self._hand_out_own_trace(team)

    def _use_spare(self, session: Session, now: float) -> list[Instruction]:
        """Make teams of slaves that are in none, or have them help out where that is worth a new beginning."""
        out: list[Instruction] = self.roster.note_slaves_short_of_memory()
        for team in self.roster.teams_of_spare(team_size_of(session)):
            out += self._lead(team, session, now)
        early = self.phase in (Phase.IDLE, Phase.SETUP, Phase.PHOTONS, Phase.RECORDS)
        early = early or (self.phase is Phase.BUCKETS and self.tasks.begun <= WORTH_REGROUPING)
        smallest = min(self.roster.teams, key=lambda team: len(team.members), default=None)
        if smallest is None and (members := self.roster.take_spare(session.cells, anyone=True)):
            self.roster.teams.append(Team(members, len(members)))
            return out + self._lead(self.roster.teams[-1], session, now)
        if smallest is not None and early and self.roster.able_spare and len(smallest.members) < session.cells:
            return out + self._restart_team(smallest, now, wanted=len(smallest.members) + 1)
        return out

    def _restart_team(self, team: Team, now: float, wanted: int = 0) -> list[Instruction]:
        """A team begins anew, with the slaves that it has left and spare ones.

        Args:
            wanted: how many slaves it should have, if more than it was meant to.
        """
        session = self.session
        if self.phase is Phase.PHOTONS:
            self.tasks.lose_photons(team.traced)
        # While maps are built, what landed in this team may not have come to the others.
        retrace = self.phase is Phase.MAPS and team.maps(self._trace)
        for each in list(self.roster.teams) if retrace else [team]:
            self.roster.dissolve(each, self.tasks)
        self.roster.fill_up(team, max(team.size, wanted))
        if session is None:
            return []
        out: list[Instruction] = []
        if retrace:
            self.phase = Phase.SETUP
            self._begin_trace(session)
            out.append(Noted("photons are traced again: some were lost before all slaves had them"))
        return out + self._follow_up(session, now) + self.roster.next_cells()

    def _working(self) -> list[Team]:
        """Teams that have all that tasks of the phase need."""
        if self.phase is Phase.PHOTONS:
            return [team for team in self.roster.teams if team.traces(self._trace)]
        of_view = self.phase in (Phase.RECORDS, Phase.BUCKETS)
        return [team for team in self.roster.teams if of_view and team.works(self._trace, self._view, self._records)]

    def _order(
        self, team: Team, answer: type[protocol.FromSlave], order: protocol.FromMaster, towards: int = 0
    ) -> list[Instruction]:
        """Tell all slaves of a team something that they have to answer."""
        team.wait_for(answer, towards)
        return [Send(member.identity, order) for member in team.members]

    # Tasks.

    def _hand_out(self, session: Session, now: float) -> list[Instruction]:
        """Hand out tasks, as far as the slaves' limits allow."""
        working, photons = self._working(), self.phase is Phase.PHOTONS
        slaves = (member for team in working for member in team.members)
        able = capacities(session, slaves, self._members, len(self.roster.teams), self._limits, photons=photons)
        handed_out = list(self.tasks.hand_out(able, now))
        if handed_out:
            self._moved_at = now
        return self._start_tasks(handed_out)

    def _hand_out_own_trace(self, team: Team) -> list[Instruction]:
        limit = self._limits.photon_tasks_in_flight
        return self._start_tasks(list(self.tasks.hand_out_own_trace(team.members, team.own_trace or [], limit)))

    def _start_tasks(self, handed_out: Sequence[tuple[Member, Task]]) -> list[Instruction]:
        return [Send(member.identity, protocol.StartTask(self.epoch_of(member), task)) for member, task in handed_out]

    def _task_done(self, team: Team, member: Member, result: TaskResult, now: float) -> list[Instruction]:
        session = self.session
        if session is None:  # another slave was faster, and the session has ended
            if member.in_flight.pop(result.number, None) is None:
                raise ProtocolError(f"a result came for task {result.number} while nothing is rendered")
            return []
        if team.own_trace is not None and isinstance(result, PhotonsTraced) and result.number in member.in_flight:
            self.tasks.take_own_trace(member, result)
            out = self._hand_out_own_trace(team)
            return out if team.at_work else out + self._lead(team, session, now)
        task = self.tasks.take(member, result, now)
        self._moved_at = now
        if task is None:
            self._dropped["repeated result"] += 1
            return self._lead(team, session, now)
        if isinstance(task, PhotonTask):
            team.traced.append(task)
        shown: list[Instruction] = [Advanced(units(task)), *bucket_done(member, result), *worth_keeping(task, result)]
        return shown + self._hand_out(session, now) + self._go_on(session, now)

    def _end_phase(self, name: str, now: float) -> None:
        self._seconds[name] = now - self._phase_at
        self._phase_at = now
