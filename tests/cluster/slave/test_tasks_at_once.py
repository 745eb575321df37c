"""A slave that holds the whole scene does several tasks at once; anything else waits until they are done."""

from __future__ import annotations

from dataclasses import replace

from fake_worker import make_view, make_world, triangles
from slave_driver import EPOCH, HELLO, PEERS, WELCOME, Driver, jobs, to_master

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave.jobs import Outcome, SetView, StartTask
from wdpm.cluster.slave.machine import QUEUED, Slave
from wdpm.cluster.task import PhotonsTraced, PhotonTask

TASKS = [PhotonTask(number, 10 * number, 10 * number + 10) for number in range(9)]


def ready(processes: int, cells: int = 1) -> Driver:
    """A slave that holds all cells, as far as Ready."""
    driver = Driver()
    driver.slave = Slave(replace(HELLO, processes=processes), "tcp://master:1", 60.0, ClusterLimits())
    driver(s.Start())
    setup = p.Setup(EPOCH, make_world(cells), (1,) * cells, PEERS)
    parts = [p.Partition(EPOCH, cell, 0, 1, triangles(2, 10 * cell)) for cell in range(cells)]
    [build] = jobs(driver.told(WELCOME, setup, *parts))
    driver.computed(build)
    return driver


def start_all(driver: Driver) -> list[StartTask]:
    started = jobs(driver.told(*(p.StartTask(EPOCH, task) for task in TASKS)))
    assert all(isinstance(job, StartTask) for job in started)
    return started  # type: ignore[return-value]


def test_each_process_has_a_task_and_one_more() -> None:
    assert [job.task for job in start_all(ready(3))] == TASKS[: QUEUED * 3]


def test_one_process_does_one_task() -> None:
    assert [job.task for job in start_all(ready(1))] == TASKS[:1]


def test_tasks_that_need_other_cells_are_done_one_by_one() -> None:
    assert [job.task for job in start_all(ready(3, cells=2))] == TASKS[:1]


def test_tasks_end_in_any_order_and_others_follow() -> None:
    driver = ready(2)
    started = start_all(driver)
    out = driver.computed(started[2], results=(PhotonsTraced(2, 10, 1.0),))
    assert to_master(out) == [p.TaskDone(EPOCH, PhotonsTraced(2, 10, 1.0))]
    assert [job.task for job in jobs(out)] == [TASKS[4]]  # type: ignore[union-attr]


def test_orders_wait_for_the_tasks_under_way_and_go_before_others() -> None:
    driver = ready(2)
    started = start_all(driver)
    assert driver.told(p.SetView(EPOCH, make_view(8, 8, 8))) == []
    for job in started[:-1]:
        assert jobs(driver.computed(job, results=(PhotonsTraced(job.task.number, 10, 1.0),))) == []
    [order] = jobs(driver.computed(started[-1]))
    assert isinstance(order, SetView)
    assert len(jobs(driver(s.Computed(Outcome(order))))) == QUEUED * 2


def test_results_of_an_older_epoch_are_dropped() -> None:
    driver = ready(2)
    started = start_all(driver)
    driver.told(p.Setup(EPOCH + 1, make_world(1), (1,), PEERS))
    for job in started:
        assert to_master(driver.computed(job, results=(PhotonsTraced(job.task.number, 10, 1.0),))) == []
    assert driver.slave.dropped == {"outcome of another epoch": len(started)}
