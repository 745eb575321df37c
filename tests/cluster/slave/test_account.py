"""What a slave tells of its time and its messages, by a clock that the tests turn."""

from __future__ import annotations

import pytest
from fake_worker import arrays, make_view, make_world

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.slave import jobs as c
from wdpm.cluster.slave.account import Account
from wdpm.cluster.slave.idle_time import cause_of
from wdpm.cluster.slave.traffic import Traffic, power_below
from wdpm.cluster.task import PhotonTask
from wdpm.rendering.pass_average import merged


def batch(kind: Kind, count: int = 1) -> Batch:
    return Batch.of_task(kind, 5, 0, 1, 1, arrays(kind, count))


TASK = c.StartTask(PhotonTask(0, 0, 10))
RAYS = c.HandleBatches((batch(Kind.PHOTON),))
BUILD = c.Build(0, make_world(2), {}, (0, 1))


def spent(account: Account) -> dict[str, float]:
    told = account.attach_to(p.Statistics(1, {"photons": 5}))
    assert isinstance(told, p.Statistics)
    assert told.values["photons"] == 5
    seconds: dict[str, float] = told.values["spent_s"]
    return seconds


def do(account: Account, job: c.Job, began: float, ended: float, sent: float) -> None:
    account.idling.started(job, began)
    account.ended(job, ended)
    account.idling.sent(sent)


def built() -> Account:
    """The account of a slave that is built at time 10."""
    account = Account()
    do(account, BUILD, 3.0, 10.0, 10.0)
    return account


def test_each_wait_is_for_what_ended_it() -> None:
    account = built()
    do(account, TASK, 11.0, 15.0, 15.5)  # 1 s without a task, 4 s of work, 0.5 s of sending
    do(account, RAYS, 17.5, 18.5, 18.5)  # 2 s without rays
    do(account, c.ExchangeGhosts(), 21.5, 22.5, 22.5)  # 3 s at the end of the phase
    assert spent(account) == {"computing": 6.0, "no task": 1.0, "no rays": 2.0, "phase end": 3.0, "sending": 0.5}


def test_a_job_that_waits_already_begins_when_all_is_sent() -> None:
    account = built()
    account.idling.started(TASK, 10.0)
    account.ended(TASK, 12.0)
    account.idling.started(RAYS, 12.25)
    account.idling.sent(12.25)
    account.ended(RAYS, 13.25)
    assert spent(account) == {"computing": 3.0, "no task": 0.0, "no rays": 0.0, "phase end": 0.0, "sending": 0.25}


def test_several_tasks_at_once_are_one_stretch_of_work() -> None:
    account = built()
    account.idling.started(TASK, 10.0)
    account.idling.started(TASK, 11.0)
    account.ended(TASK, 12.0)
    account.idling.sent(12.5)
    account.ended(TASK, 14.0)
    account.idling.sent(14.0)
    assert spent(account)["computing"] == 4.0


def test_time_between_sessions_is_nobodys() -> None:
    account = built()
    do(account, c.SetView(make_view()), 10.0, 11.0, 11.0)
    account.idling.started(c.ReadStatistics(), 11.0)
    account.ended(c.ReadStatistics(), 12.0)
    assert sum(spent(account).values()) == 2.0
    account.idling.sent(12.5)
    do(account, TASK, 100.0, 101.0, 101.0)
    assert spent(account) == {"computing": 1.0, "no task": 0.0, "no rays": 0.0, "phase end": 0.0, "sending": 0.0}


def test_nothing_is_counted_before_a_slave_is_built() -> None:
    account = Account()
    account.idling.sent(1.0)
    account.attach_to(p.Heartbeat())
    assert sum(spent(account).values()) == 0.0


@pytest.mark.parametrize("job", [BUILD, c.ForgetPhotons(make_world(2).photon_plan)])
def test_the_account_begins_anew_where_the_workers_counts_do(job: c.Job) -> None:
    account = built()
    account.sent.add(p.PeerBatches(1, (batch(Kind.PHOTON),)))
    do(account, TASK, 10.0, 11.0, 11.0)
    do(account, job, 12.0, 13.0, 13.0)
    told = account.attach_to(p.Statistics(1, {}))
    assert isinstance(told, p.Statistics)
    assert told.values == {
        "spent_s": dict.fromkeys(p.SPENT, 0.0),
        "messages": {"Statistics": 1},
        "batches_by_rays": {},
        "batches_by_bytes": {},
        "bytes_in": 0,
        "bytes_out": 0,
    }


def test_photons_of_other_teams_come_at_the_end_of_a_phase() -> None:
    assert cause_of(c.HandleBatches((batch(Kind.GHOST_PHOTONS),))) == p.PHASE_END
    assert cause_of(RAYS) == p.NO_RAYS
    assert cause_of(TASK) == p.NO_TASK


def test_messages_are_counted_by_name_and_batches_by_size() -> None:
    sent = Traffic()
    photons = batch(Kind.PHOTON, 5)
    for message, size in (
        (p.Heartbeat(), 0),
        (p.Vitals(), 0),
        (p.Ready(1), 0),
        (p.PeerBatches(1, (photons,)), 500),
        (p.PeerBatches(1, (photons,)), 500),
        (p.PeerBatches(1, (batch(Kind.ENDED),)), 60),
    ):
        sent.add(message, size)
    sent.came(700)
    counts = sent.take()
    assert counts["messages"] == {"Ready": 1, "PeerBatches": 3}
    assert counts["batches_by_rays"]["4"] == 2
    assert counts["batches_by_bytes"] == {"256": 2, "32": 1}
    assert (counts["bytes_in"], counts["bytes_out"]) == (700, 1060)
    begun = {"messages": {}, "batches_by_rays": {}, "batches_by_bytes": {}, "bytes_in": 0, "bytes_out": 0}
    assert sent.take() == begun


def test_powers_of_two() -> None:
    assert [power_below(n) for n in (0, 1, 2, 3, 4, 1023, 1024)] == ["0", "1", "2", "2", "4", "512", "1024"]


def test_accounts_of_passes_are_added() -> None:
    one = {"spent_s": {"computing": 1.5, "no task": 0.5}, "batches_by_rays": {"4": 2, "8": 1}}
    other = {"spent_s": {"computing": 2.0, "no task": 1.0}, "batches_by_rays": {"8": 3, "16": 1}}
    assert merged(one, other) == {
        "spent_s": {"computing": 3.5, "no task": 1.5},
        "batches_by_rays": {"4": 2, "8": 4, "16": 1},
    }
