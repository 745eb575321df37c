"""Slaves begin with a round of irradiance records, or with the image, while the last records are worked out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from fake_worker import make_session, maps_built, triangles
from master_driver import VERSIONS, A, B, Driver, hello, sent, tasks_of
from record_rounds import FEW_A_TASK, cached, made

from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Master, Phase
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.records import equal
from wdpm.cluster.task import BucketTask


def to_first_round(slaves: int, cores: int = 0, **of_hello: Any) -> tuple[Driver, list[m.Instruction]]:
    """Slaves that each have the whole scene, as far as the first tasks of records.

    Args:
        cores: of the machine that the master shares with them; 0 where it has one of its own.
    """
    driver = Driver(slaves, FEW_A_TASK)
    driver.master = Master(slaves, VERSIONS, FEW_A_TASK, cores={"host": cores} if cores else {})
    out: list[m.Instruction] = []
    for number, identity in enumerate((A, B)[:slaves]):
        driver.says(identity, replace(hello(number), **of_hello))
    driver(m.Begin(make_session(slaves, 1, paths=0, team_size=1, view=cached())))
    for identity in (A, B)[:slaves]:
        driver(m.PartitionMade(0, triangles(3)))
        driver.says(identity, p.PartitionReceived(driver.master.epoch(identity), 0))
    for answer in (p.Ready, maps_built):
        out = [i for identity in (A, B)[:slaves] for i in driver.says(identity, answer(driver.master.epoch(identity)))]
    return driver, out


def end_round(driver: Driver, out: list[m.Instruction], slaves: int) -> list[m.Instruction]:
    """Have all tasks of a round done: what the master says before it has worked out how the records are shared."""
    waiting = [(identity, task) for identity in (A, B)[:slaves] for task in tasks_of(out, identity)]
    while waiting:
        identity, task = waiting.pop()
        done = p.TaskDone(driver.master.epoch(identity), made(task))
        out = driver.master.handle(m.SlaveSaid(identity, done), driver.now)
        waiting += (
            [(other, task) for other in (A, B) for task in tasks_of(out, other)] if m.GoOnLater() not in out else []
        )
    return out


def test_slaves_that_need_no_other_begin_with_a_round_before_its_records_are_worked_out() -> None:
    driver, out = to_first_round(2)
    out = end_round(driver, out, 2)
    for identity in (A, B):
        awaited, *started = sent(out, identity)
        assert isinstance(awaited, p.AwaitRecords)
        assert [message.task.round for message in started] == [1] * len(started)
        assert started
    out = driver(m.GoOn())
    assert [type(message) for message in sent(out)] == [p.SetRecords, p.SetRecords]
    assert equal(*(message.records for message in sent(out)))


def test_buckets_begin_before_records_are_smooth() -> None:
    driver, out = to_first_round(2)
    while driver.master.phase is Phase.RECORDS:
        early = end_round(driver, out, 2)
        out = early + driver(m.GoOn())
    assert [type(message) for message in sent(early, A)][:2] == [p.AwaitRecords, p.StartTask]
    assert all(isinstance(task, BucketTask) for task in tasks_of(early, A))


@pytest.mark.parametrize(("cores", "begin"), [(1, 0), (2, 1), (3, 2), (8, 2)])
def test_the_master_keeps_a_core(cores: int, begin: int) -> None:
    driver, out = to_first_round(2, cores)
    early = sent(end_round(driver, out, 2))
    assert sum(isinstance(message, p.AwaitRecords) for message in early) == begin


@pytest.mark.parametrize(("slaves", "processes"), [(1, 1), (2, 2)])
def test_who_is_alone_or_has_processes_waits_for_records(slaves: int, processes: int) -> None:
    """It has nothing else to do meanwhile, or processes that do one task after another."""
    driver, out = to_first_round(slaves, processes=processes)
    assert sent(end_round(driver, out, slaves)) == []
    assert isinstance(sent(driver(m.GoOn()), A)[0], p.SetRecords)


def test_records_that_are_sent_since_a_slave_was_lost_are_not_sent_again() -> None:
    driver, out = to_first_round(2)
    end_round(driver, out, 2)
    out = driver(m.SlaveLost(B, "killed")) + driver(m.GoOn())
    assert [type(message) for message in sent(out, A) if isinstance(message, p.SetRecords)] == [p.SetRecords]
