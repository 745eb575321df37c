"""Slaves that have not room for a share of the scene are left aside, until nobody else is there."""

from __future__ import annotations

from dataclasses import replace

from fake_worker import make_session, triangles
from master_driver import A, B, C, Driver, hello, noted, sent

from wdpm.cluster.host_memory import PROCESS_BYTES
from wdpm.cluster.master import events as m
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.session import Session

GIB = 1 << 30
SMALL = PROCESS_BYTES + GIB // 2
LARGE = PROCESS_BYTES + 2 * GIB


def of_memory(process: int, own: int) -> p.Hello:
    return replace(hello(process), own_memory=own)


def session(team_size: int = 1, cells: int = 1) -> Session:
    """Of a scene of which each slave needs room for a gibibyte."""
    return make_session(team_size, cells, team_size=team_size, room=float(GIB), paths=0)


def ready(driver: Driver, identity: bytes, epoch: int) -> list[m.Instruction]:
    """A slave that holds the only cell builds it."""
    driver(m.PartitionMade(0, triangles(3)))
    driver.says(identity, p.PartitionReceived(epoch, 0))
    return driver.says(identity, p.Ready(epoch))


def test_a_small_slave_is_left_aside() -> None:
    driver = Driver()
    driver.says(A, of_memory(0, LARGE))
    driver.says(B, of_memory(1, SMALL))
    out = driver(m.Begin(session()))
    assert [message.holders for message in sent(out, A)] == [(0,)]
    assert sent(out, B) == []
    assert "slave 1 (host, process 1) has not the memory for a share of the scene" in noted(out)


def test_it_goes_on_when_nobody_else_is_left() -> None:
    driver = Driver()
    driver.says(A, of_memory(0, LARGE))
    driver.says(B, of_memory(1, SMALL))
    driver(m.Begin(session()))
    out = driver(m.SlaveLost(A, "killed"))
    assert [message.holders for message in sent(out, B)] == [(1,)]


def test_one_that_joins_late_is_told_once() -> None:
    driver = Driver(1)
    driver.master._members.most = 3
    driver.says(A, of_memory(0, LARGE))
    [setup] = sent(driver(m.Begin(session())), A)
    ready(driver, A, setup.epoch)
    out = driver.says(B, of_memory(1, SMALL))
    assert [type(message) for message in sent(out, B)] == [p.Welcome]
    assert "has not the memory" in noted(out)
    out = driver.says(C, of_memory(2, LARGE))
    assert [type(message) for message in sent(out, C)] == [p.Welcome, p.Setup]
    assert "has not the memory" not in noted(out)


def test_where_nobody_has_room_all_are_used() -> None:
    """What a scene takes is an estimate from above, and a large slave may be lost while the scene is divided."""
    driver = Driver()
    driver.says(A, of_memory(0, SMALL))
    driver.says(B, of_memory(1, SMALL))
    out = driver(m.Begin(session(team_size=2, cells=2)))
    assert [message.holders for message in sent(out, A)] == [(0, 1)]
    assert [message.holders for message in sent(out, B)] == [(0, 1)]


def test_a_team_that_lost_a_slave_takes_no_small_one() -> None:
    driver = Driver(3)
    for process, (identity, own) in enumerate([(A, LARGE), (B, LARGE), (C, SMALL)]):
        driver.says(identity, of_memory(process, own))
    out = driver(m.Begin(session(team_size=2, cells=2)))
    assert [message.holders for message in sent(out, A)] == [(0, 1)]
    assert sent(out, C) == []
    out = driver(m.SlaveLost(B, "killed"))
    assert [message.holders for message in sent(out, A)] == [(0, 0)]
    assert sent(out, C) == []
