"""Teams that others wait for while photons are traced and maps are built, and that they go on without."""

from __future__ import annotations

from typing import Any

from fake_worker import make_session, make_view, maps_built, pixels_of, statistics_of, triangles
from master_driver import A, B, Driver, noted, sent, tasks_of

from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Phase
from wdpm.cluster.master.tasks import LATE_S
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.task import PhotonsTraced, PhotonTask
from wdpm.cluster.world import View

LEFT = "others go on without slave 1 (host, process 1), which is late"


def begun(*ready: bytes, view: View | None = None) -> tuple[Driver, dict[bytes, list[PhotonTask]]]:
    """Two slaves that hold the whole scene each; the tasks of those that are ready."""
    driver = Driver().join()
    out = driver(m.Begin(make_session(2, 1, paths=450, team_size=1, view=view or make_view(64, 32, 16))))
    for identity in (A, B):
        out += driver(m.PartitionMade(0, triangles(3)))
        out += driver.says(identity, p.PartitionReceived(epoch(driver, identity), 0))
        if identity in ready:
            out += driver.says(identity, p.Ready(epoch(driver, identity)))
    return driver, {identity: tasks_of(out, identity) for identity in (A, B)}


def epoch(driver: Driver, identity: bytes) -> int:
    return driver.master.epoch(identity)


def done(driver: Driver, identity: bytes, task: PhotonTask) -> list[m.Instruction]:
    paths = task.stop - task.start
    return driver.says(identity, p.TaskDone(epoch(driver, identity), PhotonsTraced(task.number, paths, 1.0)))


def trace_all(driver: Driver, identity: bytes, tasks: list[PhotonTask]) -> list[m.Instruction]:
    """A slave does its photon tasks, and those that it is handed then; what the master said last."""
    out: list[m.Instruction] = []
    while tasks:
        out = done(driver, identity, tasks.pop(0))
        tasks += tasks_of(out, identity)
    return out


def later(driver: Driver, seconds: float) -> list[m.Instruction]:
    """Slave 0 says something meanwhile, slave 1 nothing."""
    out: list[m.Instruction] = []
    for _ in range(int(seconds)):
        driver.now += 1.0
        driver.says(A, p.Heartbeat())
        out += driver(m.Tick())
    return out


def test_photons_of_a_late_slave_are_traced_by_others() -> None:
    driver, tasks = begun(A, B)
    assert trace_all(driver, A, tasks[A]) == [m.Advanced(50)]
    first = tasks[B].pop(0)
    done(driver, B, first)
    assert not noted(later(driver, LATE_S - 1.0))
    out = later(driver, 3.0)
    assert LEFT in noted(out)
    assert driver.master._phases.tasks._left == 2 * 100, "what it has traced is with it"
    again = tasks_of(out, A)
    [setup] = [message for message in sent(out, B) if isinstance(message, p.Setup)]
    assert setup.kept == (0,)
    out = trace_all(driver, A, again)
    assert [type(message) for message in sent(out)] == [p.BuildMaps]
    assert sent(out, A)[0].copies == ()
    assert driver.master.phase is Phase.MAPS


def test_nobody_is_late_after_the_master_itself_stood_still() -> None:
    """On a laptop whose lid was shut all did."""
    driver, tasks = begun(A, B)
    trace_all(driver, A, tasks[A])
    done(driver, B, tasks[B].pop(0))
    driver(m.Tick())
    driver.now += 3600.0
    assert not noted(driver(m.Tick()))
    assert LEFT in noted(later(driver, LATE_S + 3.0))


def test_it_traces_all_photons_for_itself_when_it_is_back() -> None:
    driver, tasks = begun(A, B)
    trace_all(driver, A, tasks[A])
    out = trace_all(driver, A, tasks_of(later(driver, LATE_S + 3.0), A))
    assert sent(driver.says(B, p.Ready(epoch(driver, B))), B) == []
    out = driver.says(A, maps_built(epoch(driver, A)))
    assert driver.master.phase is Phase.BUCKETS
    alone = tasks_of(out, B)
    assert [(task.start, task.stop) for task in alone] == [(0, 100), (100, 200)]
    out = trace_all(driver, B, alone)
    assert [type(message) for message in sent(out, B)] == [p.BuildMaps]
    assert tasks_of(driver.says(B, maps_built(epoch(driver, B))), B)


def test_maps_do_not_wait_for_a_slave_that_is_still_sent_the_scene() -> None:
    driver, tasks = begun(A)
    trace_all(driver, A, tasks[A])
    assert driver.master.phase is Phase.PHOTONS
    before = epoch(driver, B)
    out = later(driver, LATE_S + 3.0)
    assert LEFT in noted(out)
    assert epoch(driver, B) == before, "what it is sent it need not be sent again"
    assert driver.master.phase is Phase.MAPS


def test_a_slave_that_was_left_behind_is_waited_for_when_nobody_else_is_there() -> None:
    driver, tasks = begun(A, B)
    trace_all(driver, A, tasks[A])
    later(driver, LATE_S + 3.0)
    driver(m.SlaveLost(A, "killed"))
    out: list[Any] = driver.says(B, p.Ready(epoch(driver, B)))
    out = trace_all(driver, B, tasks_of(out, B))
    assert [type(message) for message in sent(out, B)] == [p.BuildMaps]


def test_nobody_is_late_where_all_are() -> None:
    driver, _ = begun(A, B)
    assert not noted(later(driver, 9.0))
    assert "has been silent" in noted(later(driver, 60.0))
    assert driver.master.phase is Phase.PHOTONS
    assert epoch(driver, A) == 1


def test_a_slave_that_falls_silent_while_maps_are_built_is_done_without() -> None:
    driver, tasks = begun(A, B)
    trace_all(driver, A, tasks[A])
    trace_all(driver, B, tasks[B])
    assert driver.master.phase is Phase.MAPS
    out = later(driver, LATE_S + 3.0)
    assert LEFT in noted(out)
    assert "photons are traced again" in noted(out)
    out = driver.says(A, p.Ready(epoch(driver, A)))
    out = trace_all(driver, A, tasks_of(out, A))
    assert [type(message) for message in sent(out)] == [p.BuildMaps]
    driver.says(A, maps_built(epoch(driver, A)))
    assert driver.master.phase is Phase.BUCKETS


def test_the_loss_of_a_slave_that_builds_no_maps_costs_others_nothing() -> None:
    driver, tasks = begun(A, B)
    trace_all(driver, A, tasks[A])
    trace_all(driver, A, tasks_of(later(driver, LATE_S + 3.0), A))
    assert driver.master.phase is Phase.MAPS
    out = driver(m.SlaveLost(B, "killed"))
    assert not sent(out, A)
    assert driver.master.phase is Phase.MAPS


def test_a_bucket_that_another_was_faster_with_comes_when_the_next_session_has_begun() -> None:
    view = make_view(32, 16, 16)
    driver, tasks = begun(A, B, view=view)
    trace_all(driver, A, tasks[A])
    trace_all(driver, B, tasks[B])
    out = [each for identity in (A, B) for each in driver.says(identity, maps_built(epoch(driver, identity)))]
    [[mine], [late]] = tasks_of(out, A), tasks_of(out, B)
    driver.says(A, p.TaskDone(epoch(driver, A), pixels_of(mine, view)))
    assert tasks_of(later(driver, LATE_S + 1.0), A) == [late]
    driver.says(A, p.TaskDone(epoch(driver, A), pixels_of(late, view)))
    out = driver.says(A, p.Statistics(epoch(driver, A), statistics_of(dropped={})))
    [finished] = [each for each in out if isinstance(each, m.Finished)]
    assert [len(finished.result.statistics), finished.result.lost] == [1, ()]
    assert [name.split()[:2] for name in finished.result.unheard] == [["slave", "1"]], "what it counted is not known"
    [first, *_] = tasks_of(driver(m.Begin(make_session(2, 1, paths=450, team_size=1, view=view))), A)
    out = driver.says(B, p.TaskDone(epoch(driver, B), pixels_of(late, view)))
    assert tasks_of(out, B), "it has nothing more to do of the last session"
    assert driver.master.dropped == {"repeated result": 1}
    assert tasks_of(driver.says(A, p.TaskDone(epoch(driver, A), pixels_of(first, view))), A) == []
