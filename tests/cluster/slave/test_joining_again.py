"""A slave that has lost its master, or that its master has lost, joins again. State machine only."""

from __future__ import annotations

from itertools import pairwise

from slave_driver import EPOCH, HELLO, Driver, error_of, jobs, part, setup, to_master

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave import jobs as c
from wdpm.cluster.task import PhotonsTraced, PhotonTask


def test_a_slave_joins_again_when_the_master_is_lost() -> None:
    driver = Driver(patience=20.0).ready()
    driver.told(p.StartTask(EPOCH, PhotonTask(5, 0, 10)))
    out = driver(s.MasterLost())
    assert [i for i in out if not isinstance(i, s.Tell)] == [
        s.ConnectPeers(()),
        s.Reconnect(fresh=True),
        s.ToMaster(HELLO),
    ]
    assert driver.slave.number == -1
    # What the worker was at when the master went is void, though another master may count epochs from the same number.
    again = p.Welcome(0, "another", 1.0, 10.0)
    driver.told(again, setup(holders=(0, 0, 1, 1)))
    job = c.StartTask(PhotonTask(5, 0, 10))
    assert to_master(driver.computed(job, results=[PhotonsTraced(5, 10, 1.0)])) == []
    driver.told(part(0), part(1))
    assert driver.slave.number == 0


def test_a_slave_that_is_let_in_again_goes_by_its_last_number() -> None:
    """Its second Hello came so late that the master took it for one that lost its connection."""
    driver = Driver().ready()
    driver.told(p.Welcome(2, "cluster", 1.0, 10.0))
    [build] = jobs(driver.told(setup(EPOCH + 1), part(2, epoch=EPOCH + 1)))
    assert isinstance(build, c.Build)
    assert (driver.slave.number, build.number) == (2, 2)


def test_a_slave_that_joins_again_waits_for_room() -> None:
    driver = Driver().ready()
    driver(s.MasterLost())
    out = driver.told(p.Refuse("all 3 slaves have joined"))
    assert not driver.slave.ended
    assert "refuses this slave so far" in next(i.text for i in out if isinstance(i, s.Tell))
    assert s.Reconnect() in driver.slave.handle(s.Tick(), driver.now + 2.0)


def test_a_connection_that_is_cut_early_tells_nothing_of_keys() -> None:
    """ZeroMQ cannot tell it from keys that do not fit; those of a slave that had joined did."""
    driver = Driver(patience=20.0).ready()
    driver(s.MasterLost())
    driver(s.MasterRefused())
    assert "lost the master" in error_of(driver.slave.handle(s.Tick(), driver.now + 21.0))


def test_a_connection_that_was_cut_early_is_forgotten_when_the_next_stands() -> None:
    driver = Driver(patience=20.0)
    driver(s.Start())
    driver(s.MasterRefused())
    driver(s.MasterReached())
    assert "no master answered" in error_of(driver.slave.handle(s.Tick(), driver.now + 21.0))


def test_a_slave_without_a_master_gives_up() -> None:
    driver = Driver(patience=20.0).ready()
    driver(s.MasterLost())
    tenth = 0
    while not driver.slave.ended:
        tenth += 1
        out = driver.slave.handle(s.Tick(), driver.now + tenth / 10)
    assert 200 <= tenth <= 202
    [ending] = [i for i in out if isinstance(i, s.Exit)]
    assert ending.elsewhere
    assert "lost the master at tcp://master:1, and none answered there within 20 s" in error_of(out)


def test_a_master_that_was_lost_may_be_waited_for_longer_than_the_first() -> None:
    """And it is asked every few seconds: it has work."""
    driver = Driver(patience=20.0, rejoin=3600.0).ready()
    driver(s.MasterLost())
    began = driver.now
    tries = []
    for second in range(1, 3600):
        out = driver.slave.handle(s.Tick(), began + second)
        tries += [second] if s.Reconnect() in out else []
    assert not driver.slave.ended
    assert max(later - earlier for earlier, later in pairwise(tries)) <= 5  # ticks of a second
    assert "none answered there within 3600 s" in error_of(driver.slave.handle(s.Tick(), began + 3600))


def test_a_slave_that_was_taken_for_lost_joins_again() -> None:
    out = Driver().ready().told(p.Dismissed("Heartbeat before Hello"))
    assert s.Reconnect(fresh=True) in out
    assert to_master(out) == [HELLO]


def started(patience: float) -> Driver:
    driver = Driver(patience=patience)
    driver(s.Start())
    return driver


def tries_until(driver: Driver, end: int) -> list[int]:
    """Seconds at which it connects again."""
    times = range(int(driver.now) + 1, end)
    return [second for second in times if s.Reconnect() in driver.slave.handle(s.Tick(), float(second))]


def test_a_master_that_has_taken_the_connection_is_not_asked_again() -> None:
    """It may be slow, or far: it would take a second Hello for one of a slave that it has lost."""
    asked = tries_until(started(60.0), 20)
    assert asked
    driver = started(60.0)
    driver(s.MasterReached())
    assert not tries_until(driver, 20)
    driver = started(60.0)
    driver(s.MasterReached())
    driver(s.MasterLost())
    assert tries_until(driver, 20) == asked


def test_a_master_that_takes_connections_and_never_answers_is_asked_again() -> None:
    driver = started(120.0)
    driver(s.MasterReached())
    longest = int(ClusterLimits().join_longest_s)
    assert tries_until(driver, longest + 2) == [longest + 1]


def test_a_slave_that_has_no_room_yet_asks_again_though_it_is_connected() -> None:
    driver = Driver(patience=60.0).ready()
    driver(s.MasterLost())
    driver(s.MasterReached())
    driver.told(p.Refuse("all 2 slaves have joined"))
    assert tries_until(driver, int(driver.now) + 10)
