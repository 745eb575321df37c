"""A master waits for its slaves, says for whom, and not for ever."""

from __future__ import annotations

import pytest
from fake_worker import make_session
from master_driver import A, Driver, hello
from slow_slaves import AGREED

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Phase
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.messages import protocol as p
from wdpm.scenes.errors import ClusterError

WAIT_S = int(ClusterLimits().join_timeout_s)


def ticks(driver: Driver, seconds: range) -> list[m.Instruction]:
    """Time goes on, and the first slave lives."""
    out = []
    for second in seconds:
        driver.now = second
        driver.says(A, p.Heartbeat())
        out += driver(m.Tick())
    return out


def notes(instructions: list[m.Instruction]) -> list[str]:
    return [i.text for i in instructions if isinstance(i, m.Noted)]


def waiting() -> Driver:
    """One of two slaves has joined."""
    driver = Driver()
    driver.says(A, hello(0))
    driver(m.Begin(make_session(2, 2)))
    return driver


def test_a_slave_that_never_joins_ends_the_render() -> None:
    driver = waiting()
    out = ticks(driver, range(1, WAIT_S))
    assert driver.master.phase is Phase.JOINING
    told = notes(out)
    assert len(told) == WAIT_S // 30 - 1
    assert told[0] == "1 of 2 slaves have joined (slave 0 (host, process 0)); the others are waited for 570 s more"
    [reason] = [i.reason for i in ticks(driver, range(WAIT_S, WAIT_S + 3)) if isinstance(i, m.Broken)]
    assert reason.startswith("1 of 2 slaves have joined (slave 0 (host, process 0)) within 600 s; start the others")
    assert "--join-timeout" in reason


def test_a_slave_that_joins_late_is_in_time() -> None:
    driver = waiting()
    ticks(driver, range(1, WAIT_S - 1))
    driver.says(b"b", hello(1))
    assert driver.master.phase is Phase.SETUP


def test_nobody_is_waited_for_before_there_is_something_to_render() -> None:
    driver = Driver()
    driver.says(A, hello(0))
    assert notes(ticks(driver, range(1, 2 * WAIT_S))) == []
    driver(m.Begin(make_session(2, 2)))
    assert len(notes(ticks(driver, range(2 * WAIT_S, 2 * WAIT_S + 31)))) == 1


def test_a_master_that_stood_still_did_not_wait() -> None:
    driver = waiting()
    ticks(driver, range(1, 3))
    out = ticks(driver, range(3 + WAIT_S, 4 + WAIT_S))
    assert notes(out) == []
    assert driver.master.phase is Phase.JOINING


@pytest.mark.sockets
def test_a_render_without_slaves_ends() -> None:
    limits = ClusterLimits(join_timeout_s=0.3)
    with (
        MasterServer("tcp://127.0.0.1:0", 1, limits=limits, agreed=AGREED) as master,
        pytest.raises(ClusterError, match=r"0 of 1 slaves have joined within 0\.3 s"),
    ):
        master.render(make_session(1, 1))
