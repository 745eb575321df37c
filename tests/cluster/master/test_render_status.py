"""What a master answers to those who only look. State machine only."""

from __future__ import annotations

from dataclasses import replace

from fake_worker import make_view, pixels_of
from master_driver import EPOCH, A, B, C, Driver, hello, sent, tasks_of

from wdpm.cluster.master import events as m
from wdpm.cluster.messages import packing
from wdpm.cluster.messages import protocol as p

EYE = b"somebody who looks"


def status(driver: Driver) -> p.StatusReport:
    """The answer, as it comes over a wire."""
    [report] = sent(driver(m.SlaveSaid(EYE, p.AskStatus())))
    assert isinstance(report, p.StatusReport)
    assert packing.decode(packing.encode(report), packing.by_name(p.ToReader)) == report
    return report


def test_a_master_that_waits_tells_who_is_there() -> None:
    driver = Driver()
    assert status(driver).slaves == ()
    driver.says(A, replace(hello(7), threads=4, memory=2**34, own_memory=2**33))
    report = status(driver)
    assert (report.phase, report.expected, report.joined, report.lost) == ("joining", 2, 1, 0)
    [slave] = report.slaves
    assert (slave.process, slave.threads, slave.memory, slave.team) == (7, 4, 2**33, -1)


def test_it_counts_the_work_of_a_phase() -> None:
    driver = Driver()
    buckets = tasks_of(driver.to_buckets(), A)
    view = make_view(64, 32, 16)
    assert (status(driver).units, status(driver).done) == (8, 0)
    for task in buckets[:2]:
        driver.now += 2.0
        driver.says(A, p.TaskDone(EPOCH, pixels_of(task, view)))
    report = status(driver)
    assert (report.phase, report.units, report.done, report.images) == ("buckets", 8, 2, 0)
    assert report.phase_s > 4.0
    assert [(slave.team, slave.cells, slave.done, slave.tasks) for slave in report.slaves] == [
        (0, 1, 2, 3),
        (0, 1, 0, 3),
    ]
    assert report.slaves[0].busy_s > 6.0
    assert report.slaves[1].silent_s > 4.0


def test_it_tells_what_slaves_take_now() -> None:
    driver = Driver()
    driver.to_buckets()
    assert [slave.now for slave in status(driver).slaves] == [None, None]
    vitals = p.Vitals(2**30, 3.5, 1e6, 2e6)
    assert driver.says(B, vitals) == []
    assert [slave.now for slave in status(driver).slaves] == [None, vitals]


def test_who_looks_at_the_image_sees_cells_and_the_lost() -> None:
    driver = Driver()
    driver.to_buckets()
    driver.says(A, p.Vitals(2**30, 3.5, 1e6, 2e6))
    driver(m.SlaveLost(B, "killed"))
    here, gone = driver.master.seen()
    assert (here.memory, here.cores, here.sent, here.received, here.lost) == (2**30, 3.5, 1e6, 2e6, False)
    assert (gone.lost, gone.whole) == (True, False)


def test_it_counts_who_is_lost_and_what_is_done_again() -> None:
    driver = Driver()
    driver.to_buckets()
    driver.says(C, hello(9))
    driver(m.SlaveLost(B, "killed"))
    report = status(driver)
    assert (report.joined, report.lost, report.refused, len(report.slaves)) == (2, 1, 1, 1)
    assert report.retried == 6  # those of its team, which begins anew


def test_looking_changes_nothing() -> None:
    """Nobody who looks becomes a slave, or is told more."""
    driver, other = Driver(), Driver()
    for _ in range(3):
        status(driver)
    assert driver.master.phase is other.master.phase
    assert driver.master.members == []
    assert sent(driver.says(EYE, p.Heartbeat())) == [p.Dismissed("Heartbeat before Hello")]
