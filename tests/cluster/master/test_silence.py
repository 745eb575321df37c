"""Slaves that say nothing: late at first, lost much later."""

from __future__ import annotations

from dataclasses import replace

from master_driver import LIMITS, A, B, Driver, noted, sent

from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Phase
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.transport.transport import TURN_S


def silent_slave(driver: Driver, seconds: range) -> list[str]:
    """What the person is told while slave 1 says nothing and slave 0 does."""
    told = []
    for second in seconds:
        out = driver.master.handle(m.Tick(), second)
        assert sent(out, A) == [p.Heartbeat()]
        driver.master.handle(m.SlaveSaid(A, p.Heartbeat()), second)
        told += [i.text for i in out if isinstance(i, m.Noted)]
    return told


def test_a_silent_slave_is_lost() -> None:
    driver = Driver()
    driver.to_photons()
    told = silent_slave(driver, range(1, 90))
    assert told == ["slave 1 (host, process 1) has been silent for 11 s; it is waited for 79 s more"]
    out = driver.master.handle(m.Tick(), 91.0)
    assert "slave 1 (host, process 1) is lost: it has been silent" in noted(out)
    assert [type(message) for message in sent(out, A)] == [p.Setup, p.Heartbeat]


def test_a_slave_that_stands_still_and_cannot_be_reached_is_lost() -> None:
    """The master stood still, too: it waits for the slave anew, and another one has waited long enough."""
    driver = Driver()
    driver.to_photons()
    driver.master.handle(m.Tick(), 1.0)
    driver.master.handle(m.Tick(), 80.0)
    told = silent_slave(driver, range(81, 93))
    driver.master.handle(m.SlaveSaid(A, p.PeerUnreachable(1, "no answer within 90 s")), 93.0)
    out = driver.master.handle(m.Tick(), 93.0 + LIMITS.peer_gone_s)
    assert told == ["slave 1 (host, process 1) has been silent for 11 s; it is waited for 79 s more"]
    assert "slave 1 (host, process 1) is lost: slave 0 (host, process 0) cannot reach it, and it has been" in noted(out)
    assert [type(message) for message in sent(out, A)] == [p.Setup, p.Heartbeat]


def test_turns_of_the_loop_are_no_sleep() -> None:
    """However short the silence that counts: a process that stands still does so for longer."""
    driver = Driver(limits=replace(LIMITS, late_s=0.4, dead_s=2.0))
    driver.to_photons()
    told = []
    for turn in range(1, 12):
        now = turn * TURN_S
        driver.master.handle(m.SlaveSaid(A, p.Heartbeat()), now)
        told += [text] if (text := noted(driver.master.handle(m.Tick(), now))) else []
    assert told[0] == "slave 1 (host, process 1) has been silent for 0 s; it is waited for 2 s more"
    assert "is lost: it has been silent for 2 s" in told[1]


def test_a_slave_that_is_late_may_come_back() -> None:
    driver = Driver()
    driver.to_photons()
    silent_slave(driver, range(1, 61))
    driver.master.handle(m.SlaveSaid(B, p.Heartbeat()), 60.5)
    assert silent_slave(driver, range(61, 71)) == ["slave 1 (host, process 1) is back"]
    assert driver.master.phase is Phase.PHOTONS
