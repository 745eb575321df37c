"""What is known to have come, and when a connection over which nothing comes is given up."""

from __future__ import annotations

from wdpm.cluster.transport.receipts import SLOWEST_LINK, Receipts, patience_s

DEAD_S = 10.0
STEP_S = 0.5
KEY = "other"


class Clocked:
    """Receipts of one connection, and a clock; the books are looked at twice a second."""

    def __init__(self) -> None:
        self.receipts: Receipts[str] = Receipts()
        self.receipts.begin(KEY)
        self.now = 0.0
        self.receipts.stuck(self.now, DEAD_S)

    def passes(self, seconds: float) -> bool:
        """Whether the connection is given up meanwhile."""
        found = []
        for _ in range(round(seconds / STEP_S)):
            self.now += STEP_S
            found += self.receipts.stuck(self.now, DEAD_S)
        return found != []


def test_what_does_not_come_is_missed_later_than_silence_is_noticed() -> None:
    link = Clocked()
    link.receipts.sent(KEY, 100)
    assert patience_s(DEAD_S) > DEAD_S
    assert not link.passes(patience_s(DEAD_S))
    assert link.passes(2 * STEP_S)


def test_nothing_is_missed_where_nothing_was_sent() -> None:
    link = Clocked()
    assert not link.passes(10 * DEAD_S)
    link.receipts.sent(KEY, 100)
    link.receipts.told(KEY, 1)
    assert not link.passes(10 * DEAD_S)
    link.receipts.sent(KEY, 100)  # long after: it has all its time
    assert not link.passes(DEAD_S)


def test_a_long_queue_that_moves_is_not_given_up() -> None:
    link = Clocked()
    for _ in range(100):
        link.receipts.sent(KEY, 10_000_000)
    for come in range(1, 100):
        assert not link.passes(DEAD_S)
        link.receipts.told(KEY, come)
    assert link.passes(2 * patience_s(DEAD_S) + 10_000_000 / SLOWEST_LINK)


def test_a_long_message_has_its_time_on_a_slow_link() -> None:
    link = Clocked()
    link.receipts.sent(KEY, round(100.0 * SLOWEST_LINK))
    link.receipts.sent(KEY, 10**12)  # this one has its own time later
    assert not link.passes(100.0 + DEAD_S)
    assert link.passes(5.0)


def test_time_in_which_this_process_stood_still_does_not_count() -> None:
    link = Clocked()
    link.receipts.sent(KEY, 100)
    link.now += 1000.0
    assert link.receipts.stuck(link.now, DEAD_S) == []
    assert not link.passes(DEAD_S - 1.0)


def test_words_that_come_late_or_speak_of_more_than_was_sent_change_nothing() -> None:
    link = Clocked()
    for _ in range(3):
        link.receipts.sent(KEY, 100)
    link.receipts.told(KEY, 2)
    assert not link.passes(DEAD_S)
    for count in (2, 1, 0, -1, 4, 2**40):
        link.receipts.told(KEY, count)
    assert link.passes(2.0)


def test_a_connection_is_counted_from_its_beginning_only() -> None:
    receipts: Receipts[int] = Receipts()
    receipts.sent(1, 100)
    receipts.came(1)
    receipts.told(1, 1)
    assert receipts.have_come(1) == 0
    receipts.begin(1)
    receipts.came(1)
    receipts.came(1)
    assert receipts.have_come(1) == 2
    receipts.count_arrivals_anew(1)
    receipts.came(1)
    assert receipts.have_come(1) == 1
    receipts.forget(1)
    receipts.forget(1)
    assert receipts.have_come(1) == 0


def test_what_stays_in_this_process_is_not_waited_for() -> None:
    link = Clocked()
    link.receipts.sent(KEY, 0)
    assert not link.passes(10 * DEAD_S)
