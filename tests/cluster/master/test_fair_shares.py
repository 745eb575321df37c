"""The slave that is ready first leaves others their share of few tasks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import pytest
from fake_worker import make_session, make_view, maps_built, triangles
from master_driver import LIMITS, A, B, Driver, broken, sent, tasks_of

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Phase
from wdpm.cluster.master.members import Member
from wdpm.cluster.master.records import RecordRounds
from wdpm.cluster.master.task_sizes import Capacity, record_limits
from wdpm.cluster.master.tasks import Tasks, size_of
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.messages.protocol import Hello
from wdpm.cluster.records import NO_RECORDS, CachePlan
from wdpm.cluster.task import PhotonsTraced, PhotonTask


@pytest.mark.parametrize(("buckets", "first"), [(2, 1), (3, 1), (4, 2), (8, 2)])
def test_slaves_alone_are_handed_their_shares_with_the_view(buckets: int, first: int) -> None:
    """Nobody waits for them to say that they have set it, and nothing follows from that."""
    driver = Driver().join()
    driver(m.Begin(make_session(2, 1, paths=0, team_size=1, view=make_view(16 * buckets, 16, 16))))
    for identity in (A, B):
        driver(m.PartitionMade(0, triangles(3)))
        driver.says(identity, p.PartitionReceived(driver.master.epoch(identity), 0))
        driver.says(identity, p.Ready(driver.master.epoch(identity)))
    out: list[m.Instruction] = []
    for identity in (A, B):
        out += driver.says(identity, maps_built(driver.master.epoch(identity)))
    for identity in (A, B):
        assert isinstance(sent(out, identity)[0], p.SetView)
        assert driver.says(identity, p.ViewSet(driver.master.epoch(identity))) == []
    assert len(tasks_of(out, A)) == first
    assert tasks_of(out, B)
    assert "not expected from it" in broken(driver.says(A, p.ViewSet(driver.master.epoch(A))))


def test_who_is_ready_traces_photons_while_others_are_sent_the_scene() -> None:
    driver = Driver().join()
    driver(m.Begin(make_session(2, 1, paths=450, team_size=1)))
    driver(m.PartitionMade(0, triangles(3)))
    of_a, of_b = (driver.master.epoch(identity) for identity in (A, B))
    driver.says(A, p.PartitionReceived(of_a, 0))
    waiting = tasks_of(driver.says(A, p.Ready(of_a)), A)
    assert waiting
    done: list[PhotonTask] = []
    while waiting:  # slave 1 does not come
        done.append(waiting.pop(0))
        result = PhotonsTraced(done[-1].number, done[-1].stop - done[-1].start, 0.5)
        waiting += tasks_of(driver.says(A, p.TaskDone(of_a, result)), A)
    assert (done[0].start, done[-1].stop) == (0, 450)
    assert driver.master.phase is Phase.PHOTONS  # photons of all teams go to all, so maps wait for it
    driver(m.PartitionMade(0, triangles(3)))
    driver.says(B, p.PartitionReceived(of_b, 0))
    out = driver.says(B, p.Ready(of_b))
    assert [type(message) for message in sent(out)] == [p.BuildMaps, p.BuildMaps]


def tasks_of_sizes(*sizes: int) -> Tasks:
    ends = list(itertools.accumulate(sizes, initial=0))
    tasks = Tasks()
    tasks._begin([PhotonTask(number, *paths) for number, paths in enumerate(itertools.pairwise(ends))])
    return tasks


def members(count: int) -> list[Member]:
    return [Member(number, bytes([number]), Hello({}, "host", number, 1, 0, "", 1), 0.0) for number in range(count)]


def handed(tasks: Tasks, capacities: Sequence[Capacity]) -> list[tuple[int, int]]:
    """Slaves, and the sizes of what they are handed."""
    return [(member.number, size_of(task)) for member, task in tasks.hand_out(capacities, 0.0)]


def test_the_largest_tasks_go_to_as_many_slaves() -> None:
    """The first that is ready has one of them, not all that it has room for."""
    tasks, (first, second) = tasks_of_sizes(60, 60, 20, 20, 6, 6), members(2)
    assert handed(tasks, [Capacity(first, 3, 1, 2)]) == [(0, 60)]
    both = [Capacity(first, 3, 1, 2), Capacity(second, 3, 1, 2)]
    assert handed(tasks, both) == [(1, 60), (0, 20), (1, 20), (0, 6), (1, 6)]


def test_the_last_task_waits_for_whoever_is_done_first() -> None:
    tasks, (first, second) = tasks_of_sizes(5, 5, 5), members(2)
    capacities = [Capacity(first, 3, 1, 2), Capacity(second, 3, 1, 2)]
    assert handed(tasks, capacities) == [(0, 5), (1, 5)]
    assert tasks.take(second, PhotonsTraced(1, 5, 1.0), 1.0) is not None
    assert handed(tasks, capacities) == [(1, 5)]


def test_a_lone_place_is_handed_as_many_as_the_limit_says() -> None:
    tasks, (lone,) = tasks_of_sizes(5, 5, 5, 5), members(1)
    assert handed(tasks, [Capacity(lone, 3)]) == [(0, 5)] * 3


def test_a_slave_of_several_processes_has_a_task_for_each() -> None:
    tasks, (wide, narrow) = tasks_of_sizes(5, 5, 5, 5, 2, 2, 2, 2), members(2)
    assert handed(tasks, [Capacity(wide, 9, 3, 4)]) == [(0, 5)] * 3 + [(0, 5)]
    assert handed(tasks, [Capacity(narrow, 3, 1, 4)]) == [(1, 2), (1, 2), (1, 2)]


def test_more_is_in_flight_where_slaves_hold_parts_of_the_scene() -> None:
    driver = Driver(limits=replace(LIMITS, buckets_in_flight=1, shared_in_flight=2))
    out = driver.to_buckets()
    assert [len(tasks_of(out, identity)) for identity in (A, B)] == [2, 2]


def test_slaves_that_cut_a_scene_have_one_large_task_of_records_each() -> None:
    rounds = RecordRounds(replace(make_view(512, 512), cache=CachePlan(1, 2, 16, 50)), NO_RECORDS)
    cut, whole = (record_limits(make_session(2, cells, team_size=cells), ClusterLimits()) for cells in (2, 1))
    assert len(rounds.tasks(2, cut, 0)) == 2
    assert len(rounds.tasks(2, whole, 0)) > 4
