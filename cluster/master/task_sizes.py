"""How many tasks are done at once, and how large they are for that."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.members import Member, Members
from wdpm.cluster.session import Session

TASKS_A_SLAVE = 8
"""Photon tasks for each of several slaves: so many that they end together, ..."""

PHOTON_TASK_LEAST = 4096
"""... and paths of each, so that what a launch costs the interpreter does not count."""


def processes_of(session: Session, member: Member, *, photons: bool = False) -> int:
    """Most tasks that a slave does at once: several only where tasks need no other slave, and none of photons.

    Those a slave traces one after another, with all its threads at each (cluster.slave.jobs.Compute).
    """
    return 1 if session.is_divided or photons else member.hello.processes


def concurrent_tasks(session: Session, members: Members, teams: int) -> int:
    """Tasks that are done at once without waiting for each other."""
    if session.is_divided:
        return teams
    return sum(member.hello.processes for member in members)


def tasks_with_cores(session: Session, members: Members, teams: int) -> int:
    """Tasks of records that are computed at a time: of slaves on a machine whose cores are known, no more than those.

    More tasks than that bring nobody anything, and each takes what the interpreter does for a task however small.
    """
    return max(len(members), teams) if session.is_divided else _processes_with_cores(members)


def _processes_with_cores(members: Members) -> int:
    """Processes of slaves that have a core each: on a machine whose cores are known, no more than those."""
    processes: Counter[str] = Counter()
    for member in members:
        processes[member.hello.host] += member.hello.processes
    return sum(min(count, members.cores.get(host, count)) for host, count in processes.items())


def parallel_record_tasks(session: Session, members: Members, teams: int, rays: int, limits: ClusterLimits) -> int:
    """Tasks of records that are made at a time.

    Where a team has cut the scene all its slaves work at each task, whoever is its home. Each home more is one that
    every cell sends its results to, and gather rays of homes that go at their own pace travel in batches of their own.
    8 slaves of the Cornell box (512x512, 8 samples) sent 3,850 messages in rounds of records with a home for 32,768
    rays, and send 2,540 with one for 131,072, which saves a tenth of their CPU seconds. But few homes are near to few
    rays (4 slaves send a seventh more bytes; of sponza a twentieth), and what a home does for many rays others wait
    for: where each slave has a core for itself, which would be idle, all are homes.

    Args:
        rays: gather rays that are expected of the round.
    """
    most = tasks_with_cores(session, members, teams)
    have_cores = _processes_with_cores(members) == sum(member.hello.processes for member in members)
    if not session.is_divided or have_cores:
        return most
    worth = max(1, -(-rays // (teams * limits.record_home_rays)))
    return min(most, teams * worth)


def parallel_tasks(session: Session, members: Members, teams: int) -> int:
    """Tasks of pixels that are computed at a time without waiting for each other."""
    return min(concurrent_tasks(session, members, teams), tasks_with_cores(session, members, teams))


def parallel_photon_tasks(session: Session, members: Members, teams: int) -> int:
    """Tasks of photons that are computed at a time without waiting for each other."""
    return min(teams if session.is_divided else len(members), tasks_with_cores(session, members, teams))


def _tasks_in_flight(session: Session, limits: ClusterLimits, *, photons: bool) -> int:
    """Most tasks that are with a slave, for each that it does at once."""
    if photons:
        return limits.photon_tasks_in_flight
    return limits.shared_in_flight if session.is_divided else limits.buckets_in_flight


def equally_fast(members: Members) -> bool:
    """Whether all slaves are processes of one machine, with as many cores each."""
    return len({(member.hello.host, member.hello.threads, member.hello.processes) for member in members}) == 1


def record_limits(session: Session, limits: ClusterLimits) -> ClusterLimits:
    """The limits that tasks of records keep: one large task for each home where the scene is divided.

    All slaves of a team work at each task there, and the fewer there are the larger are the batches that they send.
    """
    return replace(limits, record_parts=1.0) if session.is_divided else limits


@dataclass(frozen=True)
class Capacity:
    """How many tasks a slave may be handed.

    Attributes:
        most: tasks that it may have.
        at_once: how many of them it does at once; others wait there until one of these is done.
        all_at_once: tasks that all slaves do at once.
    """

    member: Member
    most: int
    at_once: int = 1
    all_at_once: int = 1

    def takes(self, size: int, at_hand: int, left: int) -> bool:
        """Whether a task of some size may wait at the slave: no slave has more than its share of what is left to do.

        The first slave that is ready would otherwise have several of few tasks, or of the largest, one after another,
        while others have none.

        Args:
            at_hand: size of all tasks that it has.
            left: size of all tasks that are not done, wherever they are.
        """
        return (at_hand + size) * self.all_at_once <= left * self.at_once


def capacities(
    session: Session, working: Iterable[Member], members: Members, teams: int, limits: ClusterLimits, *, photons: bool
) -> list[Capacity]:
    """How many tasks of a session each slave may be handed that can do some.

    Args:
        working: those slaves.
    """
    limit = _tasks_in_flight(session, limits, photons=photons)
    tasks = parallel_photon_tasks if photons else concurrent_tasks
    at_once = tasks(session, members, teams)
    return [_capacity_of(processes_of(session, member, photons=photons), member, limit, at_once) for member in working]


def _capacity_of(at_once: int, member: Member, limit: int, tasks: int) -> Capacity:
    """How many tasks a slave may be handed.

    Args:
        at_once: tasks that it does at once.
        limit: tasks for each of these.
        tasks: that all slaves do at once.
    """
    return Capacity(member, limit * at_once, at_once, max(tasks, at_once))


def photon_task_size(session: Session, members: Members, teams: int, limits: ClusterLimits) -> int:
    """Photon paths a task: more slaves than their machines have cores get no smaller ones."""
    size = limits.photon_task_paths
    tasks = parallel_photon_tasks(session, members, teams)
    if tasks > 1:
        size = min(size, max(-(-session.world.paths // (TASKS_A_SLAVE * tasks)), PHOTON_TASK_LEAST))
    return size
