"""Slaves that are lost or separated, many at a time or again and again."""

from __future__ import annotations

from fake_worker import make_session
from master_driver import LIMITS, VERSIONS, Driver, hello, noted, sent

from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Master
from wdpm.cluster.master.members import MOST_SETBACKS
from wdpm.cluster.messages import protocol as p

MANY = 2 * MOST_SETBACKS


def name(number: int) -> bytes:
    return f"slave {number}".encode()


def rendering(slaves: int, most: int | None = None, **session: int) -> Driver:
    """A cluster that has begun a session, and built no cell of it."""
    driver = Driver(slaves)
    driver.master = Master(slaves, VERSIONS, LIMITS, most)
    for number in range(slaves):
        driver.says(name(number), hello(number))
    driver(m.Begin(make_session(slaves, slaves, **session)))
    return driver


def broken(instructions: list[m.Instruction]) -> list[str]:
    return [each.reason for each in instructions if isinstance(each, m.Broken)]


def test_a_render_survives_the_loss_of_most_slaves_at_once() -> None:
    """A rack without power, or a queue of machines that are all wanted back."""
    driver = rendering(MANY)
    out = [each for number in range(1, MANY) for each in driver(m.SlaveLost(name(number), "its machine was wanted"))]
    assert not broken(out)
    assert driver.master.epoch(name(0)) >= 0


def test_connections_that_break_together_are_one_new_beginning() -> None:
    driver = rendering(MANY)
    for number in range(1, MANY):
        assert driver.says(name(0), p.PeerGone(number)) == []
        assert driver.says(name(number), p.PeerGone(0)) == []
    driver.now += LIMITS.peer_gone_s
    out = driver(m.Tick())
    assert not broken(out)
    assert noted(out).count("they connect again") == 1
    assert len([setup for setup in sent(out, name(0)) if isinstance(setup, p.Setup)]) == 1
    # What breaks after that is another setback.
    driver.says(name(0), p.PeerGone(1))
    driver.now += LIMITS.peer_gone_s
    assert noted(driver(m.Tick())).count("they connect again") == 1


def test_slaves_that_come_and_are_lost_again_and_again_end_the_render() -> None:
    driver = rendering(2, team_size=1)
    for number in range(2, 2 + MOST_SETBACKS + 1):
        assert not broken(driver(m.SlaveLost(name(number - 1), "killed")))
        driver.says(name(number), hello(number))
    [reason] = broken(driver(m.SlaveLost(name(number), "killed")))
    assert reason.startswith(f"slaves were lost or separated {MOST_SETBACKS} times, and no task was done since then: ")


def test_slaves_that_nobody_works_with_may_come_and_go_as_they_like() -> None:
    """They have joined late, and wait for a team to begin anew; no task is done while maps are built, say."""
    driver = rendering(2, most=3)
    for number in range(2, 2 + MANY):
        assert isinstance(sent(driver.says(name(number), hello(number)))[0], p.Welcome)
        assert not broken(driver(m.SlaveLost(name(number), "killed")))
