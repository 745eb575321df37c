"""How many tasks are done at once, and how large they are for that."""

from __future__ import annotations

from collections import Counter

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.members import Member, Members
from wdpm.cluster.session import Session

TASKS_A_PROCESS = 8
"""Photon tasks for each of several processes: so many that they end together, ..."""

PHOTON_TASK_LEAST = 4096
"""... and paths of each, so that what a launch costs the interpreter does not count."""


def processes_of(session: Session, member: Member) -> int:
    """Most tasks that a slave does at once: several only where tasks need no other slave."""
    return member.hello.processes if len(session.burdens) == 1 else 1


def at_once(session: Session, members: Members, teams: int) -> int:
    """Tasks that are done at once without waiting for each other."""
    if len(session.burdens) > 1:
        return teams
    return sum(member.hello.processes for member in members)


def in_parallel(session: Session, members: Members, teams: int) -> int:
    """Tasks of records that are computed at a time: of slaves on a machine whose cores are known, no more than those.

    More tasks than that bring nobody anything, and each takes what the interpreter does for a task however small.
    """
    if len(session.burdens) > 1:
        return max(len(members), teams)
    processes: Counter[str] = Counter()
    for member in members:
        processes[member.hello.host] += member.hello.processes
    return sum(min(count, members.cores.get(host, count)) for host, count in processes.items())


def most_in_flight(limit: int, open_tasks: int, tasks: int) -> int:
    """Tasks that each of `tasks` places may be handed: no more than its share of those that are not done.

    The first slave that is ready would take several of few, one after another, while others have none.

    Args:
        limit: however many there are.
    """
    return limit if tasks <= 1 else min(limit, max(1, open_tasks // tasks))


def photon_task_size(session: Session, tasks: int, limits: ClusterLimits) -> int:
    """Photon paths a task, where so many tasks are done at once."""
    size = limits.photon_task_paths
    if tasks > 1:
        size = min(size, max(-(-session.world.paths // (TASKS_A_PROCESS * tasks)), PHOTON_TASK_LEAST))
    return size
