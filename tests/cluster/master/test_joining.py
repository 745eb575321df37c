"""A master waits for its slaves, says for whom, and not for ever."""

from __future__ import annotations

import pytest
from fake_worker import make_session
from master_driver import LIMITS, VERSIONS, A, B, C, Driver, hello, noted, sent
from slow_slaves import AGREED

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Master, Phase
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


def joined(instructions: list[m.Instruction]) -> list[p.Hello]:
    """Who is there, as who asked is told."""
    return [hello for i in instructions if isinstance(i, m.AllJoined) for hello in i.slaves]


def waiting() -> Driver:
    """One of two slaves has joined."""
    driver = Driver()
    driver.says(A, hello(0))
    driver(m.Begin(make_session(2, 2)))
    return driver


def test_a_slave_that_never_joins_is_done_without() -> None:
    driver = waiting()
    out = ticks(driver, range(1, WAIT_S))
    assert driver.master.phase is Phase.JOINING
    told = notes(out)
    assert len(told) == WAIT_S // 30 - 1
    assert told[0] == "1 of 2 slaves have joined (slave 0 (host, process 0)); the others are waited for 570 s more"
    out = ticks(driver, range(WAIT_S, WAIT_S + 3))
    begun = "1 of 2 slaves have joined (slave 0 (host, process 0)) within 600 s (--join-timeout): these begin, and"
    assert notes(out)[0].startswith(begun)
    [setup] = [message for message in sent(out, A) if isinstance(message, p.Setup)]
    assert setup.holders == (0, 0)
    assert driver.master.phase is Phase.SETUP


def test_no_slave_at_all_ends_the_render() -> None:
    driver = Driver()
    driver(m.Begin(make_session(2, 2)))
    driver(m.Tick())
    out = [each for second in range(1, WAIT_S + 2) for each in driver.master.handle(m.Tick(), float(second))]
    [reason] = [i.reason for i in out if isinstance(i, m.Broken)]
    assert reason.startswith("no slave has joined within 600 s, of 2 that are waited for; see that `wdpm slave` runs")
    assert "--join-timeout" in reason


def test_who_waited_in_vain_hears_why_slaves_were_refused() -> None:
    driver = Driver()
    driver(m.Begin(make_session(2, 2)))
    assert notes(driver.says(A, hello(0, {"code": "2"})))[0].startswith("refused host, process 0: versions differ")
    driver(m.Tick())
    out = [each for second in range(1, WAIT_S + 2) for each in driver.master.handle(m.Tick(), float(second))]
    [reason] = [i.reason for i in out if isinstance(i, m.Broken)]
    assert reason.startswith("no slave has joined within 600 s, of 2 that are waited for; refused: host, process 0: ")


def test_whoever_asks_who_is_there_waits_no_longer_than_a_render() -> None:
    """A command asks that before it has divided the scene, so there is no session yet."""
    driver = Driver()
    driver.says(A, hello(0))
    driver(m.WaitForSlaves())
    assert not joined(ticks(driver, range(1, WAIT_S)))
    assert [hello.process for hello in joined(ticks(driver, range(WAIT_S, WAIT_S + 3)))] == [0]


def test_whoever_asks_when_all_are_lost_waits_for_one() -> None:
    driver = Driver().join()
    driver(m.SlaveLost(A, "killed"))
    driver(m.SlaveLost(B, "killed"))
    assert driver(m.WaitForSlaves()) == []
    assert [hello.process for hello in joined(driver.says(C, hello(7)))] == [7]


def test_processes_that_end_before_they_join_are_done_without() -> None:
    driver = Driver(3)
    driver.says(A, hello(0))
    driver(m.WaitForSlaves())
    out = driver(m.ProcessEnded(1, "killed by SIGKILL", 2))
    assert notes(out) == ["a slave (process 1) ended before it joined: killed by SIGKILL"]
    assert driver.master.phase is Phase.JOINING
    assert [hello.process for hello in joined(driver.says(C, hello(2)))] == [0, 2]


def test_the_last_that_is_waited_for_ends() -> None:
    driver = waiting()
    out = driver(m.ProcessEnded(1, "killed by SIGKILL", 1))
    [setup] = [message for message in sent(out, A) if isinstance(message, p.Setup)]
    assert setup.holders == (0, 0)


def test_a_slave_elsewhere_that_does_not_start_is_done_without() -> None:
    driver = Driver(3)
    driver.says(A, hello(0))
    driver(m.WaitForSlaves())
    out = driver(m.NotComing("no slave runs on anna: no such host", 2))
    assert notes(out) == ["no slave runs on anna: no such host; 2 others are there or on the way"]
    assert driver.master.phase is Phase.JOINING
    assert [hello.process for hello in joined(driver.says(B, hello(1)))] == [0, 1]
    out = driver(m.NotComing("no slave runs on bert: it was lost", 1))
    assert driver.master.phase is Phase.IDLE, "who has begun goes on with who is there"


def test_what_is_known_of_a_slave_that_is_awaited_is_passed_on() -> None:
    driver = waiting()
    assert notes(driver(m.StillAwaited("anna: ssh has said nothing"))) == ["anna: ssh has said nothing"]
    assert driver.master.phase is Phase.JOINING


@pytest.mark.parametrize("connection_first", [False, True])
def test_a_process_that_joined_and_ended_is_not_waited_for(connection_first: bool) -> None:
    driver = waiting()
    if connection_first:
        driver(m.SlaveLost(A, "its connection is gone"))
    driver(m.ProcessEnded(0, "killed by SIGKILL", 1))
    assert driver.master.phase is Phase.JOINING
    [_, setup] = sent(driver.says(B, hello(1)), B)
    assert setup.holders == (1, 1)


def test_all_processes_end_before_they_join() -> None:
    driver = Driver()
    driver(m.Begin(make_session(2, 2)))
    driver(m.ProcessEnded(7, "killed by SIGKILL", 1))
    [reason] = [i.reason for i in driver(m.ProcessEnded(8, "no memory", 0)) if isinstance(i, m.Broken)]
    assert reason == "a slave (process 8) ended before it joined: no memory; no slave is left"


def test_a_lost_connection_of_the_last_process_is_told_at_once() -> None:
    """The connection of a killed process may break before anyone sees that the process has ended."""
    driver = Driver()
    driver.to_photons()
    driver(m.ProcessEnded(0, "killed by SIGKILL", 1))
    assert not [i for i in driver(m.SlaveLost(B, "its connection is gone")) if isinstance(i, m.Broken)]
    [reason] = [i.reason for i in driver(m.ProcessEnded(1, "killed by SIGKILL", 0)) if isinstance(i, m.Broken)]
    assert reason == "slave 1 (host, process 1) is lost: killed by SIGKILL; no slave is left"


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
        pytest.raises(ClusterError, match=r"no slave has joined within 0\.3 s, of 1"),
    ):
        master.slaves()


def test_of_how_many_slaves_one_more_joined_is_true_also_later() -> None:
    """`--slaves 1..3` begins with one, and lets in two more."""
    driver = Driver()
    driver.master = Master(1, VERSIONS, LIMITS, 3)
    assert "(1 of 1)" in noted(driver.says(A, hello(0)))
    assert "(2 of 3)" in noted(driver.says(B, hello(1)))
    assert "; 1 of 3 left" in noted(driver(m.SlaveLost(B, "killed")))
