"""The master's state machine: events in, instructions compared. No sockets, no clock, no workers."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from fake_worker import make_session, make_view, maps_built, pixels_of, statistics_of, triangles
from master_driver import EPOCH, LIMITS, A, B, C, Driver, broken, hello, noted, sent, tasks_of

from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Phase
from wdpm.cluster.master.tasks import LATE_S
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.task import BucketTask, PhotonsTraced, PhotonTask


def test_slaves_are_welcomed_in_order() -> None:
    driver = Driver()
    first, second = driver.says(A, hello(7)), driver.says(B, hello(8))
    [welcome_a], [welcome_b] = sent(first), sent(second)
    assert (welcome_a.number, welcome_b.number) == (0, 1)
    assert welcome_a.cluster == welcome_b.cluster
    assert [member.process for member in driver.master.members] == [7, 8]


def test_a_second_hello_of_the_same_slave_is_answered_alike() -> None:
    driver = Driver()
    assert sent(driver.says(A, hello())) == sent(driver.says(A, hello()))
    assert driver.master.phase is Phase.JOINING


def test_versions_that_differ_are_named() -> None:
    [refusal] = sent(Driver().says(A, hello(versions={"code": "2", "more": "x"})))
    assert isinstance(refusal, p.Refuse)
    assert "code: master 1, slave 2" in refusal.reason
    assert "more: master none, slave x" in refusal.reason
    assert "install the same" in refusal.reason


def test_one_slave_too_many_is_refused() -> None:
    [refusal] = sent(Driver().join().says(C, hello(2)))
    assert isinstance(refusal, p.Refuse)
    assert "all 2 slaves" in refusal.reason


def test_a_session_waits_for_the_slaves() -> None:
    driver = Driver()
    assert driver(m.Begin(make_session(2, 2))) == []
    driver.says(A, hello())
    out = driver.says(B, hello(1))
    assert [type(message) for message in sent(out, A)] == [p.Setup]


def test_cells_go_out_one_after_another_in_parts() -> None:
    driver = Driver().join()
    out = driver(m.Begin(make_session(2, 4)))
    setups = sent(out)
    assert [setup.peers for setup in setups] == [("tcp://peer:0", "tcp://peer:1")] * 2
    assert [i for i in out if isinstance(i, m.MakePartition)] == [m.MakePartition(0)]
    parts = sent(driver(m.PartitionMade(0, triangles(9))), A)
    assert [(part.cell, part.part, part.parts, len(part.triangles)) for part in parts] == [
        (0, 0, 3, 4),
        (0, 1, 3, 4),
        (0, 2, 3, 1),
    ]
    assert driver.says(A, p.PartitionReceived(EPOCH, 0)) == [m.MakePartition(1)]
    [empty] = sent(driver(m.PartitionMade(1, triangles(0))), B)
    assert (empty.part, empty.parts, len(empty.triangles)) == (0, 1, 0)


def test_two_photon_tasks_are_in_flight_for_each_slave() -> None:
    driver = Driver()
    out = driver.to_photons()
    assert m.Started("photons", 450) in out
    ranges = {identity: [(task.start, task.stop) for task in tasks_of(out, identity)] for identity in (A, B)}
    assert ranges == {A: [(0, 100), (200, 300)], B: [(100, 200), (300, 400)]}
    first = tasks_of(out, B)[0]
    out = driver.says(B, p.TaskDone(EPOCH, PhotonsTraced(first.number, 100, 1.0)))
    assert m.Advanced(100) in out
    assert [(task.start, task.stop) for task in tasks_of(out, B)] == [(400, 450)]
    assert tasks_of(out, A) == []


def test_the_exchange_waits_for_the_last_photon() -> None:
    driver = Driver()
    out = driver.to_photons(paths=200)
    [task_a], [task_b] = tasks_of(out, A), tasks_of(out, B)
    assert sent(driver.says(A, p.TaskDone(EPOCH, PhotonsTraced(task_a.number, 100, 1.0)))) == []
    out = driver.says(B, p.TaskDone(EPOCH, PhotonsTraced(task_b.number, 100, 1.0)))
    assert sent(out, A) == sent(out, B) == [p.BuildMaps(EPOCH)]
    assert sent(driver.says(A, maps_built(EPOCH))) == []
    assert [type(message) for message in sent(driver.says(B, maps_built(EPOCH)))] == [p.SetView, p.SetView]


def test_buckets_to_the_end() -> None:
    driver = Driver()
    out = driver.to_buckets()
    pending = [(identity, task) for identity in (A, B) for task in tasks_of(out, identity)]
    assert len(pending) == 6
    view = make_view(64, 32, 16)
    while pending:
        identity, task = pending.pop()
        out = driver.says(identity, p.TaskDone(EPOCH, pixels_of(task, view)))
        pending += [(other, task) for other in (A, B) for task in tasks_of(out, other)]
    assert sent(out) == [p.ReadStatistics(EPOCH)] * 2
    of_a, of_b = (statistics_of(triangles=count, dropped={}) for count in (1, 2))
    driver.says(B, p.Statistics(EPOCH, of_b))
    [finished] = driver.says(A, p.Statistics(EPOCH, of_a))
    assert isinstance(finished, m.Finished)
    assert finished.result.statistics == [{**of_a, "slave": 0}, {**of_b, "slave": 1}]
    whole = pixels_of(BucketTask(0, 0, 0, 64, 32), view)
    for name, layer in whole.layers.items():
        np.testing.assert_array_equal(finished.result.layers[name], layer)
    assert driver.master.phase is Phase.IDLE


# What goes wrong.


def test_a_repeated_result_is_dropped_if_it_is_the_same() -> None:
    driver = Driver()
    task = tasks_of(driver.to_buckets(), A)[0]
    result = pixels_of(task, make_view(64, 32, 16))
    driver.says(A, p.TaskDone(EPOCH, result))
    assert driver.says(A, p.TaskDone(EPOCH, result)) == []
    assert driver.master.dropped == {"repeated result": 1}
    assert driver.master.phase is Phase.BUCKETS


def test_two_different_results_end_the_render() -> None:
    driver = Driver()
    task = tasks_of(driver.to_buckets(), A)[0]
    driver.says(A, p.TaskDone(EPOCH, pixels_of(task, make_view(64, 32, 16))))
    out = driver.says(A, p.TaskDone(EPOCH, pixels_of(task, make_view(64, 32, 16, seed=1))))
    assert f"two results of task {task.number} differ" in broken(out)


def test_two_different_photon_results_end_the_render() -> None:
    driver = Driver()
    task = tasks_of(driver.to_photons(), A)[0]
    driver.says(A, p.TaskDone(EPOCH, PhotonsTraced(task.number, 100, 1.0)))
    assert driver.says(A, p.TaskDone(EPOCH, PhotonsTraced(task.number, 100, 1.0))) == []
    assert "differ" in broken(driver.says(A, p.TaskDone(EPOCH, PhotonsTraced(task.number, 100, 2.0))))


def test_a_result_of_an_unknown_task_ends_the_render() -> None:
    driver = Driver()
    driver.to_photons()
    assert "task 99" in broken(driver.says(A, p.TaskDone(EPOCH, PhotonsTraced(99, 100, 1.0))))


def test_a_result_of_another_slaves_task_ends_the_render() -> None:
    driver = Driver()
    task = tasks_of(driver.to_photons(), B)[0]
    out = driver.says(A, p.TaskDone(EPOCH, PhotonsTraced(task.number, 100, 1.0)))
    assert "not handed" in broken(out)


def test_a_photon_result_with_too_few_paths_ends_the_render() -> None:
    driver = Driver()
    task = tasks_of(driver.to_photons(), A)[0]
    assert "has 100 paths; it says 99" in broken(driver.says(A, p.TaskDone(EPOCH, PhotonsTraced(task.number, 99, 1.0))))


def test_a_photon_result_for_a_bucket_ends_the_render() -> None:
    driver = Driver()
    task = tasks_of(driver.to_buckets(), A)[0]
    assert "PhotonsTraced came for" in broken(driver.says(A, p.TaskDone(EPOCH, PhotonsTraced(task.number, 1, 1.0))))


@pytest.mark.parametrize("fault", ["place", "layers", "dtype", "shape", "nan"])
def test_a_bucket_that_does_not_fit_ends_the_render(fault: str) -> None:
    driver = Driver()
    task = tasks_of(driver.to_buckets(), A)[0]
    result = pixels_of(task, make_view(64, 32, 16))
    match fault:
        case "place":
            result = dataclasses.replace(result, x0=result.x0 + 1)
        case "layers":
            del result.layers["depth"]
        case "dtype":
            result.layers["depth"] = result.layers["depth"].astype(np.float64)  # type: ignore[assignment]
        case "shape":
            result.layers["depth"] = result.layers["depth"][:1]
        case "nan":
            result.layers["beauty"][0, 0, 1] = np.nan
    assert "broke the protocol" in broken(driver.says(A, p.TaskDone(EPOCH, result)))


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        statistics_of(),
        statistics_of(dropped={}, more=1),
        *(
            statistics_of(**{"dropped": {}, name: value})
            for name, value in (
                ("triangles", "many"),
                ("triangles", -1),
                ("triangles", True),
                ("busy_s", float("nan")),
                ("guards", {"a": "b"}),
                ("cells", [2]),
                ("photons", [1, 2]),
                ("ghosts", [1, 2, 1.5]),
            )
        ),
    ],
)
def test_statistics_that_are_none_end_the_render(wrong: dict[str, Any]) -> None:
    """The report reads them as they are, after all the work."""
    driver = Driver()
    out = driver.to_buckets()
    pending = [(identity, task) for identity in (A, B) for task in tasks_of(out, identity)]
    while pending:
        identity, task = pending.pop()
        out = driver.says(identity, p.TaskDone(EPOCH, pixels_of(task, make_view(64, 32, 16))))
        pending += [(other, task) for other in (A, B) for task in tasks_of(out, other)]
    reason = broken(driver.says(B, p.Statistics(EPOCH, wrong)))
    assert "slave 1 (host, process 1) broke the protocol: Statistics: " in reason


@pytest.mark.parametrize("epoch", [0, 2])
def test_a_message_of_another_epoch_is_dropped(epoch: int) -> None:
    driver = Driver()
    task = tasks_of(driver.to_photons(), A)[0]
    assert driver.says(A, p.TaskDone(epoch, PhotonsTraced(task.number, 100, 1.0))) == []
    assert driver.master.dropped == {"TaskDone of another epoch": 1}
    assert driver.master.phase is Phase.PHOTONS


@pytest.mark.parametrize(
    "message",
    [p.Ready(EPOCH), p.MapsBuilt(EPOCH, {}), p.ViewSet(EPOCH), p.Statistics(EPOCH, {}), p.PhotonsForgotten(EPOCH)],
)
def test_an_answer_out_of_turn_ends_the_render(message: p.FromSlave) -> None:
    driver = Driver()
    driver.to_photons()
    assert "not expected from it in phase photons" in broken(driver.says(A, message))


def test_an_answer_while_nothing_is_rendered_is_dropped() -> None:
    driver = Driver().join()
    assert driver.says(A, p.Ready(0)) == []
    assert driver.master.dropped == {"Ready of another epoch": 1}


def test_a_cell_that_was_not_sent_ends_the_render() -> None:
    driver = Driver().join()
    driver(m.Begin(make_session(2, 2)))
    driver(m.PartitionMade(0, triangles(3)))
    assert "got cell 1" in broken(driver.says(A, p.PartitionReceived(EPOCH, 1)))


def test_a_master_that_slept_does_not_blame_the_slaves() -> None:
    driver = Driver()
    driver.to_photons()
    driver.master.handle(m.Tick(), 1.0)
    out = driver.master.handle(m.Tick(), 3600.0)
    assert sent(out, A) == [p.Heartbeat()]


@pytest.mark.parametrize(
    ("event", "reason"),
    [
        (m.SlaveSaid(B, p.Failed("no memory")), "slave 1 (host, process 1) failed: no memory"),
        (m.SlaveSaid(B, p.Rejected("what?")), "slave 1 (host, process 1) could not read"),
        (m.Unreadable(B, "7 frames"), "slave 1 (host, process 1) broke the protocol: 7 frames"),
        (m.Abort("the disk is full"), "the disk is full"),
    ],
)
def test_what_no_other_slave_can_mend_ends_the_render(event: m.Event, reason: str) -> None:
    driver = Driver()
    driver.to_photons()
    assert broken(driver(event)).startswith(reason)
    assert driver.master.phase is Phase.ENDED
    assert driver(m.SlaveLost(A, "too")) == []
    assert driver(m.Begin(make_session(2, 2))) == [m.Broken("the cluster has ended; start another")]
    assert [type(message) for message in sent(driver.says(C, hello()))] == [p.Refuse]


@pytest.mark.parametrize(
    ("event", "reason"),
    [
        (m.SlaveLost(B, "its connection is gone"), "its connection is gone"),
        (m.ProcessEnded(1, "killed by SIGKILL", 1), "killed by SIGKILL"),
        (m.SlaveSaid(B, p.Goodbye("interrupted")), "it left (interrupted)"),
    ],
)
def test_others_go_on_when_a_slave_is_lost(event: m.Event, reason: str) -> None:
    driver = Driver()
    driver.to_photons()
    out = driver(event)
    assert noted(out) == f"slave 1 (host, process 1) is lost: {reason}; 1 of 2 left"
    [setup] = sent(out, A)
    assert (setup.holders, setup.kept, setup.peers) == ((0, 0), (0,), ("tcp://peer:0", ""))
    assert [i for i in out if isinstance(i, m.MakePartition)] == [m.MakePartition(1)]
    [part] = sent(driver(m.PartitionMade(1, triangles(3))), A)
    assert (part.epoch, part.cell) == (setup.epoch, 1)
    # What was said before it knew of the new epoch is void.
    assert driver.says(A, p.TaskDone(EPOCH, PhotonsTraced(0, 100, 1.0))) == []
    driver.says(A, p.PartitionReceived(setup.epoch, 1))
    again = tasks_of(driver.says(A, p.Ready(setup.epoch)), A)
    assert [(task.start, task.stop) for task in again] == [(0, 100), (200, 300)]


def test_buckets_that_are_done_stay() -> None:
    driver = Driver()
    out = driver.to_buckets()
    first, second = tasks_of(out, A)[:2]
    view = make_view(64, 32, 16)
    driver.says(A, p.TaskDone(EPOCH, pixels_of(first, view)))
    out = driver(m.SlaveLost(B, "killed"))
    epoch = sent(out, A)[0].epoch
    driver(m.PartitionMade(1, triangles(3)))
    driver.says(A, p.PartitionReceived(epoch, 1))
    pending = driver.says(A, p.Ready(epoch))
    assert sent(pending) == [p.BuildMaps(epoch)]  # no photon path is to be traced in this scene
    pending = driver.says(A, maps_built(epoch))
    assert driver.says(A, p.ViewSet(epoch)) == []  # alone in its team, it was handed tasks with the view
    numbers = set()
    while tasks := tasks_of(pending, A):
        pending = []
        for task in tasks:
            numbers.add(task.number)
            pending += driver.says(A, p.TaskDone(epoch, pixels_of(task, view)))
    assert second.number in numbers
    assert first.number not in numbers
    assert sent(pending) == [p.ReadStatistics(epoch)]
    values = statistics_of(dropped={})
    [finished] = driver.says(A, p.Statistics(epoch, values))
    assert isinstance(finished, m.Finished)
    assert finished.result.lost == ("slave 1 (host, process 1)",)


def test_a_slave_that_lost_its_connection_comes_back() -> None:
    driver = Driver()
    driver.to_photons()
    out = driver.says(B, hello(1))
    assert "is lost: it lost its connection, and came back" in noted(out)
    [welcome, setup] = sent(out, B)
    assert (welcome.number, setup.kept) == (2, ())


def test_a_master_without_slaves_waits_for_one_and_gives_up() -> None:
    driver = Driver()
    driver.to_photons()
    driver(m.SlaveLost(A, "killed"))
    driver(m.SlaveLost(B, "killed"))
    assert driver.master.phase is Phase.PHOTONS
    driver.master.handle(m.Tick(), LIMITS.rejoin_s)
    out = driver.master.handle(m.Tick(), LIMITS.rejoin_s + 1)
    [reason] = [i.reason for i in out if isinstance(i, m.Broken)]
    assert reason == "slave 1 (host, process 1) is lost: killed; no slave is left, and none came within 60 s"


def test_nobody_starts_a_slave_of_this_process_again() -> None:
    driver = Driver()
    driver.to_photons()
    driver(m.ProcessEnded(0, "killed by SIGKILL", 1))
    out = driver(m.ProcessEnded(1, "killed by SIGKILL", 0))
    [reason] = [i.reason for i in out if isinstance(i, m.Broken)]
    assert reason == "slave 1 (host, process 1) is lost: killed by SIGKILL; no slave is left"


def test_a_broken_connection_to_a_slave_that_is_lost_is_no_news() -> None:
    driver = Driver()
    driver.to_photons()
    assert driver.says(A, p.PeerGone(1)) == []
    driver(m.SlaveLost(B, "killed"))
    assert not noted(driver.master.handle(m.Tick(), driver.now + LIMITS.peer_gone_s))


def test_a_broken_connection_between_live_slaves_is_mended() -> None:
    driver = Driver()
    driver.to_photons()
    driver.says(A, p.PeerGone(1))
    out = driver.master.handle(m.Tick(), driver.now + LIMITS.peer_gone_s)
    expected = "the connection from slave 0 (host, process 0) to slave 1 (host, process 1) broke; they connect again"
    assert noted(out) == expected
    assert [setup.kept for setup in sent(out) if isinstance(setup, p.Setup)] == [(0,), (1,)]


def test_a_task_that_takes_very_long_is_given_to_another_slave() -> None:
    driver = Driver().join()
    driver(m.Begin(make_session(2, 1, paths=0, team_size=1, view=make_view(64, 32, 16))))
    for identity in (A, B):
        driver(m.PartitionMade(0, triangles(3)))
        driver.says(identity, p.PartitionReceived(driver.master.epoch(identity), 0))
        driver.says(identity, p.Ready(driver.master.epoch(identity)))
    out = [i for identity in (A, B) for i in driver.says(identity, maps_built(driver.master.epoch(identity)))]
    late, pending = tasks_of(out, A), tasks_of(out, B)
    assert late
    view = make_view(64, 32, 16)
    while pending:
        done = driver.says(B, p.TaskDone(driver.master.epoch(B), pixels_of(pending.pop(), view)))
        pending += tasks_of(done, B)
    assert not tasks_of(driver.master.handle(m.Tick(), driver.now + 1.0), B)
    driver.now += LATE_S + 1.0
    again = tasks_of(driver(m.Tick()), B)
    assert [task.number for task in again] == [late[0].number]
    assert m.Advanced(1) in driver.says(B, p.TaskDone(driver.master.epoch(B), pixels_of(again[0], view)))
    assert driver.says(A, p.TaskDone(driver.master.epoch(A), pixels_of(late[0], view))) == []
    assert driver.master.dropped == {"repeated result": 1}


def test_a_team_that_sets_the_view_when_all_is_rendered_is_asked_what_it_counted() -> None:
    driver = Driver().join()
    view = make_view(16, 16, 16)
    driver(m.Begin(make_session(2, 1, paths=0, team_size=1, view=view)))
    for identity in (A, B):
        driver(m.PartitionMade(0, triangles(3)))
        driver.says(identity, p.PartitionReceived(driver.master.epoch(identity), 0))
        driver.says(identity, p.Ready(driver.master.epoch(identity)))
    of_a, of_b = (driver.master.epoch(identity) for identity in (A, B))
    driver.says(A, maps_built(of_a))
    [task] = tasks_of(driver.says(B, maps_built(of_b)), A)
    out = driver.says(A, p.TaskDone(of_a, pixels_of(task, view)))
    assert (sent(out, A), sent(out, B)) == ([p.ReadStatistics(of_a)], [p.ReadStatistics(of_b)])
    assert driver.says(A, p.Statistics(of_a, statistics_of(dropped={}))) == []
    assert driver.says(B, p.ViewSet(of_b)) == []
    [finished] = driver.says(B, p.Statistics(of_b, statistics_of(dropped={})))
    assert isinstance(finished, m.Finished)
    assert [of_slave["slave"] for of_slave in finished.result.statistics] == [0, 1]


def test_strangers_are_answered_and_counted() -> None:
    driver = Driver()
    driver.to_photons()
    assert sent(driver(m.Unreadable(C, "noise"))) == [p.Rejected("noise")]
    assert [type(message) for message in sent(driver.says(C, p.Ready(EPOCH)))] == [p.Dismissed]
    assert driver(m.SlaveLost(C, "gone")) == []
    assert driver.master.dropped == {"unreadable message": 1, "message before Hello": 1}
    assert driver.master.phase is Phase.PHOTONS


def test_close_stops_everyone() -> None:
    out = Driver().join()(m.Close("done"))
    assert sent(out) == [p.Stop("done", True)] * 2
    assert not [i for i in out if isinstance(i, m.Broken)]


@pytest.mark.parametrize("last_word", [p.Goodbye("stopped"), p.Failed("too late")])
def test_an_ended_cluster_knows_who_is_still_to_say_goodbye(last_word: p.FromSlave) -> None:
    driver = Driver().join()
    driver(m.Close("all is rendered"))
    assert not driver.master.all_left
    driver.says(A, last_word)
    driver.says(B, p.Heartbeat())
    driver.says(C, p.Goodbye("a stranger"))
    assert not driver.master.all_left
    driver.says(B, p.Goodbye("stopped"))
    assert driver.master.all_left


@pytest.mark.parametrize("event", [m.SlaveLost(A, "its connection is gone"), m.ProcessEnded(0, "killed", 1)])
def test_nobody_waits_for_the_goodbye_of_a_lost_slave(event: m.Event) -> None:
    driver = Driver().join()
    driver(event)
    driver(m.Close("all is rendered"))
    assert not driver.master.all_left
    driver.says(B, p.Goodbye("stopped"))
    assert driver.master.all_left


def test_a_note_names_the_slave() -> None:
    assert Driver().join().says(B, p.Note("compiles kernels")) == [m.Noted("slave 1 compiles kernels")]


def test_task_numbers_never_repeat() -> None:
    driver = Driver()
    photons = [*tasks_of(driver.to_photons(paths=200), A), PhotonTask(1, 100, 200)]
    for identity, task in zip((A, B), photons, strict=True):
        driver.says(identity, p.TaskDone(EPOCH, PhotonsTraced(task.number, 100, 1.0)))
    for answer in (maps_built(EPOCH), p.ViewSet(EPOCH)):
        driver.says(A, answer)
        out = driver.says(B, answer)
    buckets = tasks_of(out, A) + tasks_of(out, B)
    assert min(task.number for task in buckets) == 2
