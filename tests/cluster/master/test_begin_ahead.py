"""A master has slaves set up and trace photons while the view of a session is still being planned."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from fake_worker import make_session, make_view, make_world, pixels_of, statistics_of
from master_driver import A, B, C, Driver, hello, sent, tasks_of

from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Phase
from wdpm.cluster.master.tasks import LATE_S
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.session import Session
from wdpm.cluster.task import PhotonsTraced, PhotonTask
from wdpm.cluster.world import View

OTHER_VIEW = make_view(16, 16, 16, seed=7)


def session(**others: Any) -> Session:
    """Each of two slaves has the whole scene."""
    return make_session(2, 1, **{"paths": 150, "team_size": 1, **others})


def says(driver: Driver, identity: bytes, answer: type[Any], *values: Any) -> list[m.Instruction]:
    return driver.says(identity, answer(driver.master.epoch(identity), *values))


def photons_of(task: PhotonTask) -> PhotonsTraced:
    return PhotonsTraced(task.number, task.stop - task.start, 1.0)


def set_up(driver: Driver, *slaves: bytes) -> list[m.Instruction]:
    out: list[m.Instruction] = []
    for identity in slaves:
        says(driver, identity, p.PartitionReceived, 0)
        out += says(driver, identity, p.Ready)
    return out


def trace(driver: Driver, out: list[m.Instruction]) -> list[m.Instruction]:
    """Do all photon tasks, beginning with those among these instructions."""
    todo = [(identity, task) for identity in (A, B) for task in tasks_of(out, identity)]
    while todo:
        identity, task = todo.pop()
        out = says(driver, identity, p.TaskDone, photons_of(task))
        todo += [(each, task) for each in (A, B) for task in tasks_of(out, each)]
    return out


def ahead(**others: Any) -> tuple[Driver, list[m.Instruction]]:
    driver = Driver().join()
    return driver, driver(m.BeginAhead(session(**others)))


def views(out: list[m.Instruction]) -> list[View]:
    return [message.view for message in sent(out) if isinstance(message, p.SetView)]


def kinds(out: list[m.Instruction]) -> list[type[Any]]:
    return [type(message) for message in sent(out)]


def test_it_comes_as_far_as_maps_and_then_waits_for_the_view() -> None:
    driver, out = ahead()
    assert kinds(out) == [p.Setup, p.Partition, p.Partition, p.Setup]  # one cell is on its way at a time
    assert not driver.master.rendering
    out = trace(driver, set_up(driver, A, B))
    assert kinds(out) == [p.BuildMaps, p.BuildMaps]
    assert sent(says(driver, A, p.MapsBuilt) + says(driver, B, p.MapsBuilt)) == []
    assert driver.master.phase is Phase.VIEW
    out = driver(m.Begin(session(view=OTHER_VIEW)))
    assert views(out) == [OTHER_VIEW, OTHER_VIEW]
    assert driver.master.phase is Phase.BUCKETS
    assert driver.master.rendering
    [task] = tasks_of(out, A)
    assert [type(each) for each in sent(says(driver, A, p.TaskDone, pixels_of(task, OTHER_VIEW)))] == [
        p.ReadStatistics,
        p.ReadStatistics,
    ]


@pytest.mark.parametrize("done", ["nothing", "cells", "photons"])
def test_a_session_goes_on_where_it_was_begun_ahead(done: str) -> None:
    """With the view that it has now, and nobody is set up again."""
    driver, out = ahead()
    if done != "nothing":
        out = set_up(driver, A, B)
    if done == "photons":
        out = trace(driver, out)
    assert driver(m.Begin(session(view=OTHER_VIEW))) == []
    if done == "nothing":
        out = set_up(driver, A, B)
    if done != "photons":
        out = trace(driver, out)
    assert p.BuildMaps in kinds(out)
    out = says(driver, A, p.MapsBuilt) + says(driver, B, p.MapsBuilt)
    assert views(out) == [OTHER_VIEW, OTHER_VIEW]


def test_another_scene_begins_anew() -> None:
    driver, _ = ahead()
    set_up(driver, A, B)
    before = driver.master.epoch(A)
    out = driver(m.Begin(session(digest="another")))
    assert [message.kept for message in sent(out) if isinstance(message, p.Setup)] == [(), ()]
    assert driver.master.epoch(A) > before


@pytest.mark.parametrize("retrace", [False, True])
def test_other_photons_begin_anew_in_the_same_cells(retrace: bool) -> None:
    driver, _ = ahead()
    trace(driver, set_up(driver, A, B))
    wanted = session(retrace=retrace)
    if not retrace:
        plan = wanted.world.photon_plan
        wanted = replace(wanted, world=wanted.world.with_photons(replace(plan, seed=plan.seed + 1)))
    out = driver(m.Begin(wanted))
    assert [message.kept for message in sent(out) if isinstance(message, p.Setup)] == [(0,), (0,)]
    out = says(driver, A, p.Ready) + says(driver, B, p.Ready)
    assert {task.start for identity in (A, B) for task in tasks_of(out, identity)} == {0, 100}


def test_what_came_of_tasks_that_are_void_is_dropped() -> None:
    driver, _ = ahead()
    out = set_up(driver, A, B)
    [task, *_] = tasks_of(out, A)
    before = driver.master.epoch(A)
    driver(m.Begin(session(digest="another")))
    assert driver.says(A, p.TaskDone(before, photons_of(task))) == []
    assert driver.master.dropped == {"TaskDone of another epoch": 1}


def test_photons_of_the_last_session_are_there_for_the_next() -> None:
    driver, _ = ahead()
    trace(driver, set_up(driver, A, B))
    says(driver, A, p.MapsBuilt)
    says(driver, B, p.MapsBuilt)
    assert driver(m.BeginAhead(session())) == []
    assert driver.master.phase is Phase.VIEW
    assert views(driver(m.Begin(session(view=OTHER_VIEW)))) == [OTHER_VIEW, OTHER_VIEW]


def test_a_bucket_that_another_was_faster_with_comes_when_the_next_session_has_begun() -> None:
    view = make_view(32, 16, 16)
    driver = Driver().join()
    driver(m.Begin(session(view=view)))
    trace(driver, set_up(driver, A, B))
    out = says(driver, A, p.MapsBuilt) + says(driver, B, p.MapsBuilt)
    [[mine], [late]] = tasks_of(out, A), tasks_of(out, B)
    says(driver, A, p.TaskDone, pixels_of(mine, view))
    driver.now += LATE_S + 1.0
    assert tasks_of(driver(m.Tick()), A) == [late]
    says(driver, A, p.TaskDone, pixels_of(late, view))
    assert m.Finished in map(type, says(driver, A, p.Statistics, statistics_of(make_world(1), dropped={})))
    assert driver(m.BeginAhead(session(view=view))) == []
    assert driver.master.phase is Phase.VIEW
    assert says(driver, B, p.TaskDone, pixels_of(late, view)) == []
    assert views(driver(m.Begin(session(view=OTHER_VIEW)))) == [OTHER_VIEW, OTHER_VIEW]


def test_who_asks_hears_of_no_work_that_is_left_while_the_view_is_planned() -> None:
    driver, _ = ahead()
    trace(driver, set_up(driver, A, B))
    says(driver, A, p.MapsBuilt)
    says(driver, B, p.MapsBuilt)
    [report] = sent(driver.says(C, p.AskStatus()))
    assert (report.phase, report.units, report.done) == ("view", 0, 0)


def test_a_slave_that_is_lost_meanwhile_is_replaced_by_the_other() -> None:
    driver, _ = ahead()
    trace(driver, set_up(driver, A, B))
    says(driver, A, p.MapsBuilt)
    says(driver, B, p.MapsBuilt)
    driver(m.SlaveLost(A, "killed"))
    out = driver(m.Begin(session(view=OTHER_VIEW)))
    assert views(out) == [OTHER_VIEW]
    assert tasks_of(out, B)


def test_a_slave_that_comes_meanwhile_takes_part() -> None:
    driver, _ = ahead()
    trace(driver, set_up(driver, A, B))
    driver(m.SlaveLost(A, "killed"))
    assert driver.master.phase is Phase.SETUP  # what landed in the lost one is not everywhere
    out = driver.says(C, hello(2))
    assert p.Setup in kinds(out)


def test_it_is_not_taken_up_before_all_have_joined_nor_while_something_is_rendered() -> None:
    driver = Driver()
    assert driver(m.BeginAhead(session())) == []
    driver.join()
    assert driver.master.phase is Phase.IDLE
    driver(m.Begin(session()))
    assert driver(m.BeginAhead(session(digest="another"))) == []
    assert set_up(driver, A, B)


def test_a_cluster_ends_whose_session_nobody_wanted() -> None:
    driver, _ = ahead()
    out = driver(m.Close("all is rendered"))
    assert [type(message) for message in sent(out)] == [p.Stop, p.Stop]
    assert driver(m.BeginAhead(session())) == []
