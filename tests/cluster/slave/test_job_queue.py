"""What a slave does first, how much of it in a turn, and for what it waits a moment."""

from __future__ import annotations

import pytest
from fake_worker import arrays
from slave_driver import EPOCH, PEER, Driver
from slave_driver import jobs as jobs_of

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave import jobs
from wdpm.cluster.slave.job_queue import FEW_ROWS, MOST_HOLD_S, ROWS_A_TURN, SHORT_S, TURNS_HELD, JobQueue
from wdpm.cluster.task import PhotonTask

HOLD_S = 0.5
TASK = jobs.StartTask(PhotonTask(6, 10, 20))


def rays(count: int = 1, kind: Kind = Kind.PHOTON) -> Batch:
    return Batch.of_task(kind, 5, 0, 1, 1, arrays(kind, count))


def at_hand(*batches: Batch, hold_s: float = HOLD_S) -> JobQueue:
    work = JobQueue(hold_s)
    for batch in batches:
        work.add(batch)
    return work


def batch(kind: Kind, cell: int = 1, home: int = 1) -> Batch:
    return Batch.of_task(kind, 5, home, cell, 1, arrays(kind, 1))


def rows_of(job: jobs.Job | None) -> list[int]:
    assert isinstance(job, jobs.HandleBatches)
    return [len(batch) for batch in job.batches]


def test_few_rows_wait_for_more_but_not_for_ever() -> None:
    work = at_hand(rays())
    assert work.wake_at is None
    assert work.next_job(10.0) is None
    assert work.wake_at == 10.0 + HOLD_S
    work.add(rays())
    assert work.next_job(10.0 + HOLD_S / 2) is None
    assert rows_of(work.next_job(10.0 + HOLD_S)) == [2]
    assert work.wake_at is None
    work.add(rays())
    assert work.next_job(20.0) is None, "the next ones wait anew"


def test_many_rows_wait_for_nothing() -> None:
    work = at_hand(rays(FEW_ROWS))
    assert rows_of(work.next_job(10.0)) == [FEW_ROWS]


def test_a_new_task_is_begun_before_few_rows_but_not_before_many() -> None:
    work = at_hand(rays())
    work.tasks.append(TASK)
    assert work.next_job(10.0) is TASK
    assert work.wake_at is None
    work.tasks.append(TASK)
    work.add(rays(FEW_ROWS))
    assert rows_of(work.next_job(10.0)) == [FEW_ROWS + 1]
    assert work.next_job(10.0) is TASK
    assert work.next_job(10.0) is None


def test_orders_and_what_maps_are_built_of_wait_for_nothing() -> None:
    work = at_hand(rays(), rays(2, Kind.GHOST_PHOTONS), rays(3, Kind.GHOST_PHOTONS))
    order = jobs.ReadStatistics()
    work.orders.append(order)
    assert work.next_job(10.0) is order
    assert rows_of(work.next_job(10.0)) == [2], "they are counted, so they are handled one by one"
    assert rows_of(work.next_job(10.0)) == [3]
    assert work.next_job(10.0) is None
    assert work.wake_at == 10.0 + HOLD_S


def test_what_is_held_is_forgotten_with_all_else() -> None:
    work = at_hand(rays())
    assert work.next_job(10.0) is None
    work.clear()
    assert work.wake_at is None
    assert work.next_job(11.0) is None


@pytest.mark.parametrize(("counts", "turns"), [((1, ROWS_A_TURN), [[ROWS_A_TURN], [1]]), ((1, 2, 3), [[3, 2, 1]])])
def test_a_turn_has_rows_enough_and_little_more(counts: tuple[int, ...], turns: list[list[int]]) -> None:
    kinds = (Kind.PHOTON, Kind.LANDED, Kind.SHADE)
    work = at_hand(*(rays(count, kind) for count, kind in zip(counts, kinds, strict=False)), hold_s=0.0)
    assert [rows_of(work.next_job(1.0)) for _ in turns] == turns
    assert work.next_job(1.0) is None


# In a slave's state machine.


def test_rows_of_several_tasks_and_homes_are_handled_together() -> None:
    driver = Driver().ready()
    [started] = jobs_of(driver.told(p.StartTask(EPOCH, PhotonTask(5, 0, 10))))
    for task, home in ((7, 2), (5, 1), (7, 2), (5, 0)):
        rays = Batch.of_task(Kind.PHOTON, task, home, 1, 1, arrays(Kind.PHOTON, 1))
        driver.peer(p.PeerBatches(EPOCH, (rays,)))
    [job] = jobs_of(driver.computed(started))
    assert isinstance(job, jobs.HandleBatches)
    [joined] = job.batches
    assert joined.runs.table.tolist() == [[0, 5, 1, 1], [1, 5, 1, 1], [2, 7, 2, 2]]


def test_no_work_begins_while_more_messages_are_at_hand() -> None:
    driver = Driver().ready()
    message = p.PeerBatches(EPOCH, (batch(Kind.PHOTON),))
    assert driver(s.PeerSaid(PEER, message, more=True)) == []
    [job] = jobs_of(driver(s.PeerSaid(PEER, message)))
    assert isinstance(job, jobs.HandleBatches)
    assert [len(joined) for joined in job.batches] == [2]


def test_what_goes_to_a_peer_goes_as_one_message() -> None:
    driver = Driver().ready()
    [started] = jobs_of(driver.told(p.StartTask(EPOCH, PhotonTask(5, 0, 10))))
    away, home = batch(Kind.PHOTON, cell=2), batch(Kind.LIT, home=2)
    out = driver.computed(started, away, home)
    assert out == [s.ToPeer(2, p.PeerBatches(EPOCH, (away, home)))]


def test_few_rows_wait_until_the_shell_tells_the_time() -> None:
    driver = Driver(hold_s=HOLD_S).ready()
    assert driver.slave.wake_at is None
    assert driver.peer(p.PeerBatches(EPOCH, (batch(Kind.PHOTON),))) == []
    assert driver.slave.wake_at == driver.now + HOLD_S
    assert driver(s.Wake()) == []
    driver.now += HOLD_S
    [job] = jobs_of(driver(s.Wake()))
    assert isinstance(job, jobs.HandleBatches)
    assert driver.slave.wake_at is None


def test_few_rows_wait_longer_where_turns_wait_for_cores() -> None:
    work = at_hand(rays())
    for _ in range(100):
        work.ended(jobs.HandleBatches((rays(),)), 0.0, HOLD_S)
        work.ended(jobs.HandleBatches((rays(FEW_ROWS),)), 0.0, 100 * HOLD_S)  # many may be computed by several threads
    assert work.next_job(10.0) is None
    assert work.wake_at == 10.0 + HOLD_S, "no longer than that, however few cores there are"
    quick = at_hand(rays(), hold_s=0.001)
    assert quick.next_job(10.0) is None
    assert quick.wake_at == 10.0 + 0.001, "no less than what is asked for"
    for _ in range(100):
        quick.ended(jobs.HandleBatches((rays(),)), 0.0, 0.005)
    assert quick.wake_at is not None
    assert quick.wake_at - 10.0 == pytest.approx(0.005 * TURNS_HELD, rel=1e-3)
    for _ in range(100):
        quick.ended(jobs.HandleBatches((rays(),)), 0.0, 1.0)
    assert quick.wake_at == 10.0 + MOST_HOLD_S


def test_who_does_not_hold_waits_for_no_core() -> None:
    work = at_hand(rays(), hold_s=0.0)
    work.ended(jobs.HandleBatches((rays(),)), 0.0, 1.0)
    assert rows_of(work.next_job(10.0)) == [1]


def test_few_rows_that_begin_late_wait_longer_the_next_time() -> None:
    quick = at_hand(rays(), hold_s=0.001)
    for start in range(10, 1010, 10):
        assert quick.next_job(start) is None
        assert quick.wake_at is not None
        job = quick.next_job(quick.wake_at + 0.004)
        assert job is not None
        quick.ended(job, 0.0, 0.001)
        quick.add(rays())
    assert quick.next_job(2000.0) is None
    assert quick.wake_at is not None
    assert quick.wake_at - 2000.0 == pytest.approx(0.005 * TURNS_HELD, rel=1e-3)


def test_turns_of_few_rows_are_short_once_others_were() -> None:
    work = at_hand()
    few = jobs.HandleBatches((rays(),))
    assert not work.is_short(few), "the first may load kernels"
    work.ended(few, 100.0, 0.0)
    assert not work.is_short(few)
    for _ in range(100):
        work.ended(few, SHORT_S / 2, 0.0)
        work.ended(jobs.HandleBatches((rays(FEW_ROWS),)), 100.0, 0.0)
    assert work.is_short(few)
    assert not work.is_short(jobs.HandleBatches((rays(FEW_ROWS),)))
    assert not work.is_short(jobs.HandleBatches((rays(), batch(Kind.LIT)))), "a home may have waited for it"
    assert not work.is_short(jobs.HandleBatches((rays(1, Kind.GHOST_PHOTONS),)))
    assert not work.is_short(TASK)
