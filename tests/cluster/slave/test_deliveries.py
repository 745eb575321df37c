"""The books that a slave keeps of what it sends, and of what comes."""

from __future__ import annotations

import itertools

from fake_worker import arrays
from slave_driver import EPOCH, Driver, to_master

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave.deliveries import MASTER, Deliveries

LIVENESS_S = 10.0
WELCOME = p.Welcome(1, "cluster", 2.0, LIVENESS_S)
HELLO = p.Hello({}, "host", 1, 1, 0, "tcp://here:1")
BATCHES = p.PeerBatches(EPOCH, (Batch.of_task(Kind.PHOTON, 5, 1, 1, 1, arrays(Kind.PHOTON, 1)),))
READY = p.Ready(EPOCH)


def joined() -> Deliveries:
    books = Deliveries()
    books.sent_to_master(HELLO, 100)
    books.master_said(WELCOME)
    return books


CLOCK = itertools.count()
"""Seconds that grow, whichever test looks at them."""


def stuck_after(books: Deliveries, seconds: float) -> list[tuple[int, str]]:
    """What is found to be stuck in so many seconds."""
    return [found for _ in range(round(seconds) + 1) for found in books.stuck(float(next(CLOCK)))]


def heartbeat(books: Deliveries) -> int:
    told = books.to_master(p.Heartbeat())
    assert isinstance(told, p.Heartbeat)
    return told.received


def test_heartbeats_tell_what_has_come_since_welcome() -> None:
    books = joined()
    assert heartbeat(books) == 0
    for message in (p.ReadStatistics(EPOCH), p.Heartbeat(3), p.ReadStatistics(EPOCH)):
        books.master_said(message)
    assert heartbeat(books) == 2
    books.master_said(WELCOME)
    assert heartbeat(books) == 0
    assert books.to_master(READY) is READY


def test_a_master_whom_nothing_reaches_is_lost() -> None:
    books = joined()
    assert stuck_after(books, 3 * LIVENESS_S) == []
    books.sent_to_master(p.Heartbeat(), 10)
    assert stuck_after(books, 3 * LIVENESS_S) == [], "heartbeats are not counted"
    books.sent_to_master(READY, 10)
    found = stuck_after(books, 2 * LIVENESS_S)
    assert found[0][0] == MASTER
    assert found[0][1].startswith("nothing that was sent to the master has come for 11 s")
    books.master_said(p.Heartbeat(1))
    assert stuck_after(books, 3 * LIVENESS_S) == []


def test_nobody_is_lost_before_welcome() -> None:
    books = joined()
    books.sent_to_master(READY, 10)
    books.sent_to_master(HELLO, 10)
    assert stuck_after(books, 3 * LIVENESS_S) == []


def test_a_peer_that_tells_what_has_come_is_not_lost() -> None:
    books = joined()
    books.sent_to_peer(2, p.PeerHello("cluster", 1), 50)
    for _ in range(2):
        books.sent_to_peer(2, BATCHES, 100)
    books.peer_told(2, p.PeerReceived(2))
    assert stuck_after(books, 3 * LIVENESS_S) == []
    books.sent_to_peer(2, BATCHES, 100)
    assert [number for number, _ in stuck_after(books, LIVENESS_S + 2)] == [2, 2]
    books.forget_peer(2)
    assert stuck_after(books, 3 * LIVENESS_S) == []


def test_peers_are_told_now_and_then_if_something_came() -> None:
    books = joined()
    books.greeted(b"a")
    books.greeted(b"b")
    assert books.answers(100.0) == []
    for _ in range(3):
        books.peer_said(b"a")
    assert books.answers(100.5) == [], "it was looked at a moment ago"
    assert books.answers(101.0) == [(b"a", p.PeerReceived(3))]
    assert books.answers(102.0) == []
    books.greeted(b"a")  # it has greeted again over the same connection, and counts anew
    books.peer_said(b"a")
    assert books.answers(103.0) == [(b"a", p.PeerReceived(1))]


def test_a_person_hears_why_a_connection_was_given_up() -> None:
    driver = Driver().ready()
    assert to_master(driver(s.PeerLost(2, "nothing has come"))) == [p.Note("nothing has come"), p.PeerGone(2)]
    [told, *_] = driver(s.MasterLost("nothing has come"))
    assert isinstance(told, s.Tell)
    assert "(nothing has come)" in told.text
