"""How slaves greet each other: early, late, wrongly and never. State machines only."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fake_worker import arrays
from master_driver import LIMITS, A, B, broken, hello
from master_driver import Driver as MasterDriver
from slave_driver import EPOCH, PEER, PEERS, WELCOME, Driver, setup, to_master

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.limits import MOST_SLAVES, ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.slave import events as s

CLEARED = "see that nothing clears /tmp/wdpm-x, where the sockets are, or set TMPDIR to another folder"
ANSWER_S, PATIENCE_S = ClusterLimits().peer_answer_s, ClusterLimits().dead_s
BATCH = p.PeerBatches(EPOCH, (Batch.of_task(Kind.PHOTON, 5, 1, 1, 1, arrays(Kind.PHOTON, 1)),))


def set_up() -> Driver:
    """As far as Setup, and the greetings that go out then."""
    driver = Driver()
    driver(s.Start())
    driver.told(WELCOME, setup())
    return driver


def told_master(driver: Driver, until: float) -> list[p.FromSlave]:
    """What it tells the master while time goes on, apart from heartbeats; the master is heard all the time."""
    told = []
    while driver.now < until:
        driver.now += 0.5
        driver.slave.handle(s.MasterSaid(p.Heartbeat()), driver.now)
        told += to_master(driver.slave.handle(s.Tick(), driver.now))
    return [message for message in told if not isinstance(message, p.Heartbeat)]


def tick(driver: Driver, until: float) -> list[p.FromSlave]:
    """The same without what is only for a person."""
    return [message for message in told_master(driver, until) if not isinstance(message, p.Note)]


def test_a_greeting_is_answered() -> None:
    assert Driver().ready().peer(p.PeerHello("cluster", 2), b"other") == [s.AnswerPeer(b"other", p.PeerWelcome(1))]


def test_a_greeting_before_welcome_counts_after_it() -> None:
    driver = Driver()
    driver(s.Start())
    assert driver.peer(p.PeerHello("cluster", 0)) == []
    assert driver.peer(p.PeerHello("another", 2), b"stranger") == []
    answers = [i for i in driver.told(WELCOME) if isinstance(i, s.AnswerPeer)]
    assert answers[0] == s.AnswerPeer(PEER, p.PeerWelcome(1))
    assert answers[1:] == [s.AnswerPeer(b"stranger", p.Rejected("PeerHello of another cluster"))]
    driver.told(setup())
    assert [type(i) for i in driver.peer(BATCH)] == [s.Run]
    assert driver.slave.dropped == {"PeerHello of another cluster": 1}


def test_early_greetings_are_bounded() -> None:
    driver = Driver()
    driver(s.Start())
    for number in range(MOST_SLAVES):
        assert driver.peer(p.PeerHello("cluster", 0), number.to_bytes(4)) == []
    [answer] = driver.peer(p.PeerHello("cluster", 0), b"one more")
    assert isinstance(answer, s.AnswerPeer)
    assert isinstance(answer.message, p.Rejected)


def test_peers_that_answer_are_reached() -> None:
    driver = set_up()
    for peer in (0, 2):
        assert driver(s.PeerAnswered(peer, p.PeerWelcome(peer))) == []
    assert tick(driver, 3 * PATIENCE_S) == []


def test_a_peer_that_does_not_answer_is_told_once() -> None:
    driver = set_up()
    driver(s.PeerAnswered(0, p.PeerWelcome(0)))
    assert tick(driver, PATIENCE_S - 1) == []
    assert tick(driver, 3 * PATIENCE_S) == [p.PeerUnreachable(2, f"no answer within {PATIENCE_S:g} s")]


def test_a_person_hears_of_a_peer_that_does_not_answer_long_before_it_is_given_up() -> None:
    driver = set_up()
    driver(s.PeerAnswered(0, p.PeerWelcome(0)))
    assert [m for m in told_master(driver, ANSWER_S - 1) if "slave 2" in str(m)] == []
    [note] = [m for m in told_master(driver, PATIENCE_S - 1) if "slave 2" in str(m)]
    assert isinstance(note, p.Note)
    assert note.text.startswith(f"has no answer of slave 2 at {PEERS[2]} after 15 s; it waits for 75 s more")


def test_a_slave_that_stood_still_gives_its_peers_more_time() -> None:
    driver = set_up()
    tick(driver, 2.0)
    driver.now = 3600.0
    driver.slave.handle(s.Tick(), driver.now)
    assert not driver.slave.ended
    assert tick(driver, 3600.0 + PATIENCE_S / 2) == []


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (p.PeerWelcome(0), "slave 0 answers there"),
        (p.Rejected("PeerHello of another cluster"), "PeerHello of another cluster"),
    ],
)
def test_a_wrong_answer_is_told(answer: p.PeerAnswer, reason: str) -> None:
    assert to_master(set_up()(s.PeerAnswered(2, answer))) == [p.PeerUnreachable(2, reason)]


def test_a_peer_that_refuses_a_batch_is_told() -> None:
    driver = Driver().ready()
    answer = p.Rejected("PeerBatches without PeerHello")
    assert [type(message) for message in to_master(driver(s.PeerAnswered(2, answer)))] == [p.PeerUnreachable]


def test_a_broken_connection_is_told_as_such() -> None:
    driver = set_up()
    driver(s.PeerAnswered(0, p.PeerWelcome(0)))
    assert to_master(driver(s.PeerLost(2))) == [p.PeerGone(2)]
    assert tick(driver, 3 * PATIENCE_S) == []


def test_a_peer_that_has_forgotten_this_slave_is_gone() -> None:
    """It lost its master and begins anew, so it can be reached, and is no reason to end the render."""
    driver = set_up()
    driver(s.PeerAnswered(2, p.PeerWelcome(2)))
    for _ in range(2):  # one answer for each message
        answer = s.PeerAnswered(2, p.Rejected("PeerBatches without PeerHello"))
        assert to_master(driver(answer)) == [p.PeerGone(2)]


def test_peers_of_the_next_world_are_not_asked_again() -> None:
    driver = set_up()
    for peer in (0, 2):
        driver(s.PeerAnswered(peer, p.PeerWelcome(peer)))
    driver.told(setup(EPOCH + 1, peers=PEERS))
    assert tick(driver, 3 * PATIENCE_S) == []


def test_the_master_names_both_machines_and_what_to_check() -> None:
    driver = MasterDriver()
    driver.to_photons()
    assert driver.says(b"a", p.PeerUnreachable(1, "no answer within 15 s")) == []
    reason = broken(driver.master.handle(m.Tick(), driver.now + LIMITS.peer_gone_s))
    assert reason.startswith(
        "slave 0 (host, process 0) cannot reach slave 1 (host, process 1) at tcp://peer:1: no answer"
    )
    assert "firewall" in reason


@pytest.mark.parametrize("reason", ["no answer within 15 s", f"its folder is no longer there; {CLEARED}"])
def test_no_firewall_keeps_apart_whose_sockets_are_files(reason: str) -> None:
    driver = MasterDriver()
    for number, identity in enumerate((A, B)):
        driver.says(identity, replace(hello(number), peers=f"ipc:///tmp/wdpm-x/{number}"))
    driver.says(A, p.PeerUnreachable(1, reason))
    told = broken(driver.master.handle(m.Tick(), driver.now + LIMITS.peer_gone_s))
    assert "firewall" not in told
    assert told.count(CLEARED) == 1


def test_a_person_hears_early_that_a_folder_may_be_gone() -> None:
    driver = Driver()
    driver(s.Start())
    driver.told(WELCOME, setup(peers=tuple(f"ipc:///tmp/wdpm-x/{number}" for number in range(3))))
    notes = [message.text for message in told_master(driver, ANSWER_S + 1) if isinstance(message, p.Note)]
    assert len(notes) == 2
    assert all(CLEARED in note and "firewall" not in note for note in notes)


@pytest.mark.parametrize("number", [-1, 2])
def test_an_unknown_peer_breaks_the_protocol(number: int) -> None:
    driver = MasterDriver()
    driver.to_photons()
    assert "knows no slave" in broken(driver.says(b"a", p.PeerUnreachable(number, "no answer")))
