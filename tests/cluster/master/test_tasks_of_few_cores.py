"""How many tasks are done at a time: no more than a machine has cores, and of few rays few where the scene is cut."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fake_worker import make_session, make_view, maps_built, triangles
from master_driver import LIMITS, VERSIONS, A, B, Driver, hello
from record_rounds import cached

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.buckets import buckets
from wdpm.cluster.master.machine import Master
from wdpm.cluster.master.members import Members
from wdpm.cluster.master.records import RecordRounds
from wdpm.cluster.master.task_sizes import (
    PHOTON_TASK_LEAST,
    TASKS_A_SLAVE,
    capacities,
    equally_fast,
    parallel_record_tasks,
    photon_task_size,
    tasks_with_cores,
)
from wdpm.cluster.master.tasks import Tasks
from wdpm.cluster.messages import protocol as p

RAYS = 1000


def members_of(hosts: dict[str, int], cores: dict[str, int], processes: int = 1) -> Members:
    """So many slaves on each host."""
    members = Members(8, 8, {}, cores)
    for host in (host for host, slaves in hosts.items() for _ in range(slaves)):
        number = len(members)
        members.add(b"%d" % number, replace(hello(number), host=host, processes=processes), 0.0)
    return members


@pytest.mark.parametrize(
    ("hosts", "cores", "processes", "expected"),
    [
        ({"here": 8}, {"here": 2}, 1, 2),
        ({"here": 2}, {"here": 16}, 1, 2),
        ({"here": 2}, {"here": 3}, 4, 3),
        ({"here": 4, "there": 3}, {"here": 2}, 1, 5),
        ({"there": 3}, {"here": 2}, 2, 6),
        ({"there": 3}, {}, 1, 3),
    ],
)
def test_no_more_than_cores(hosts: dict[str, int], cores: dict[str, int], processes: int, expected: int) -> None:
    members = members_of(hosts, cores, processes)
    assert tasks_with_cores(make_session(len(members), 1), members, len(members)) == expected


def test_a_team_of_several_computes_one_task_together() -> None:
    """However few cores: what one of them waits for, others compute."""
    members = members_of({"here": 4}, {"here": 1})
    assert tasks_with_cores(make_session(4, 4), members, 1) == 4


@pytest.mark.parametrize(
    ("hosts", "alike"), [({"here": 4}, True), ({"there": 1}, True), ({"here": 2, "there": 2}, False)]
)
def test_slaves_of_one_machine_have_few_large_tasks_of_records(hosts: dict[str, int], alike: bool) -> None:
    """Slaves that are equally fast end together with two tasks each; others need small ones at the end for that."""
    members = members_of(hosts, {"here": 2})
    assert equally_fast(members) == alike
    tasks, session = Tasks(), make_session(4, 1, view=cached(make_view(512, 512, 64)))
    rounds = RecordRounds(session.view, session.records)
    tasks.make_records(rounds, session, members, 4, ClusterLimits(record_task_rays=1))
    assert (tasks.total <= 2 * tasks_with_cores(session, members, 4)) == alike


def test_a_slave_with_more_threads_is_faster_than_others_of_its_machine() -> None:
    members = members_of({"here": 2}, {})
    members.add(b"more", replace(hello(2), host="here", threads=4), 0.0)
    assert not equally_fast(members)


@pytest.mark.parametrize(
    ("slaves", "cells", "teams", "rays", "homes"),
    [
        (8, 8, 1, 0, 1),
        (8, 8, 1, RAYS, 1),
        (8, 8, 1, RAYS + 1, 2),
        (8, 8, 1, 100 * RAYS, 8),
        (8, 4, 2, 1, 2),
        (8, 4, 2, 3 * RAYS, 4),
        (8, 1, 8, 1, 8),
    ],
)
def test_rounds_of_few_rays_have_few_homes_where_the_scene_is_cut(
    slaves: int, cells: int, teams: int, rays: int, homes: int
) -> None:
    """Each team has one at least; where nobody needs another slave, each slave has a task."""
    session, limits = make_session(slaves, cells), ClusterLimits(record_home_rays=RAYS)
    sharing, alone = members_of({"here": slaves}, {"here": 1}), members_of({"here": slaves}, {"here": slaves})
    if cells > 1:
        assert parallel_record_tasks(session, sharing, teams, rays, limits) == homes
        assert parallel_record_tasks(session, alone, teams, rays, limits) == slaves, "no core is idle"
    else:
        assert parallel_record_tasks(session, alone, teams, rays, limits) == homes


@pytest.mark.parametrize(
    ("slaves", "cores", "burdens", "tasks"), [(1, 2, 1, 1), (8, 2, 1, 2), (4, 16, 1, 4), (4, 1, 4, 1), (2, 1, 1, 1)]
)
def test_photon_tasks_are_as_many_as_cores_are_worth(slaves: int, cores: int, burdens: int, tasks: int) -> None:
    """In one process all are as large as they may be; a team that has cut the scene traces one after another."""
    members, limits = members_of({"here": slaves}, {"here": cores}), ClusterLimits(photon_task_paths=1 << 20)
    session = make_session(slaves, burdens, paths=1 << 19)
    each = photon_task_size(session, members, slaves if burdens == 1 else 1, limits)
    assert each == (1 << 20 if tasks == 1 else max((1 << 19) // (TASKS_A_SLAVE * tasks), PHOTON_TASK_LEAST))


def test_a_slave_of_several_processes_has_one_large_photon_task_at_a_time() -> None:
    """It traces them with all its threads; buckets are for its processes."""
    members, limits, session = members_of({"here": 1}, {}, 16), ClusterLimits(), make_session(1, 1)
    assert photon_task_size(session, members, 1, limits) == limits.photon_task_paths
    [of_photons] = capacities(session, members, members, 1, limits, photons=True)
    [of_pixels] = capacities(session, members, members, 1, limits, photons=False)
    assert (of_photons.at_once, of_photons.all_at_once, of_photons.most) == (1, 1, limits.photon_tasks_in_flight)
    assert (of_pixels.at_once, of_pixels.all_at_once, of_pixels.most) == (16, 16, 16 * limits.buckets_in_flight)


@pytest.mark.parametrize(("cores", "cut_for"), [({}, 2), ({"host": 2}, 2), ({"host": 1}, 1)])
def test_buckets_are_cut_for_cores_that_there_are(cores: dict[str, int], cut_for: int) -> None:
    view, driver = make_view(512, 512, 128), Driver()
    driver.master = Master(2, VERSIONS, LIMITS, cores=cores)
    driver.join()(m.Begin(make_session(2, 1, paths=0, team_size=1, view=view)))
    for identity in (A, B):
        driver(m.PartitionMade(0, triangles(3)))
        driver.says(identity, p.PartitionReceived(driver.master.epoch(identity), 0))
        driver.says(identity, p.Ready(driver.master.epoch(identity)))
    out = [each for one in (A, B) for each in driver.says(one, maps_built(driver.master.epoch(one)))]
    assert m.Started("render", len(buckets(view, cut_for, 0))) in out
    assert len(buckets(view, 2, 0)) > len(buckets(view, 1, 0)) == 16
