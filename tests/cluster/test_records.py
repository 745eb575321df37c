"""Rounds of irradiance records: the master's and the slave's part, in order and shuffled. No light, no sockets."""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import slave_driver
from fake_worker import (
    FakeWorker,
    irradiance_records,
    make_session,
    make_view,
    maps_built,
    picture,
    pixels_of,
    statistics_of,
)
from master_driver import EPOCH, VERSIONS, A, B, Driver, broken, sent, tasks_of
from numpy.typing import NDArray
from record_rounds import FEW_A_TASK, PLAN, all_records, cached, made

from wdpm.cluster.in_process import MemoryCluster
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Master, Phase
from wdpm.cluster.master.records import READ_FURTHER, RecordRounds, _interleaved
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.outbox import Outbox
from wdpm.cluster.records import (
    NEIGHBOURS,
    NO_RECORDS,
    ROUND_BITS,
    Records,
    candidate_count,
    candidates,
    check_records,
    equal,
    take_near,
)
from wdpm.cluster.slave import jobs as c
from wdpm.cluster.task import PhotonsTraced, RecordsMade, RecordTask
from wdpm.kernels.irradiance.record_clamp import clamped
from wdpm.kernels.irradiance.record_smoothing import smoothed
from wdpm.scenes.errors import ProtocolError


class Rounds(Driver):
    """Two slaves that make records."""

    def __init__(self) -> None:
        super().__init__()
        self.master = Master(2, VERSIONS, FEW_A_TASK)

    def to_records(self, **session: Any) -> list[m.Instruction]:
        """As far as the view is set on both."""
        out = self.to_photons(**{"paths": 0, "view": cached(), **session})
        for answer in (maps_built(EPOCH), p.ViewSet(EPOCH)):
            out += self.says(A, answer) + self.says(B, answer)
        return out

    def to_sharing(self, out: list[m.Instruction], order: random.Random | None = None) -> list[m.Instruction]:
        """Have all tasks of a round done, each slave's in its own order."""
        waiting = [(identity, task) for identity in (A, B) for task in tasks_of(out, identity)]
        while waiting:
            place = order.randrange(len(waiting)) if order else 0
            identity, task = waiting.pop(place)
            out = self.says(identity, p.TaskDone(EPOCH, made(task)))
            waiting += [(other, task) for other in (A, B) for task in tasks_of(out, other)]
        return out

    def taken(self) -> list[m.Instruction]:
        """Both slaves have the records."""
        assert self.says(B, p.RecordsSet(EPOCH)) == []
        return self.says(A, p.RecordsSet(EPOCH))


def shared_with(out: list[m.Instruction], identity: bytes) -> Records:
    """The records that are sent to a slave."""
    [message] = [message for message in sent(out, identity) if isinstance(message, p.SetRecords)]
    return message.records


# The master.


@pytest.mark.parametrize("slaves", [1, 2, 7, 64])
def test_tasks_grow_smaller_and_cover_a_round(slaves: int) -> None:
    plan = replace(PLAN, rows=16, columns=50)
    rounds = RecordRounds(replace(make_view(512, 512, 16), cache=plan), NO_RECORDS)
    count = len(candidates(512, 512, plan, 0))
    tasks = rounds.tasks(slaves, ClusterLimits(), 10)
    assert [task.number for task in tasks] == list(range(10, 10 + len(tasks)))
    assert np.sort(np.concatenate([task.candidates for task in tasks])).tolist() == list(range(count))
    sizes = [task.count for task in tasks]
    assert sizes[:-slaves] == sorted(sizes[:-slaves], reverse=True)
    assert max(sizes[-slaves:]) - min(sizes[-slaves:]) < slaves  # each has one of the last
    assert all(len(set(sizes[batch : batch + slaves])) == 1 for batch in range(0, len(sizes) - slaves, slaves))
    if slaves == 1:
        assert sizes == [count]
    elif slaves == 2:
        assert max(sizes) == -(-count // 3)
        assert max(sizes[-2:]) <= count // 16
    else:
        assert len(tasks) >= min(2 * slaves, count // ClusterLimits().record_task_least)


@pytest.mark.parametrize("slaves", [2, 4, 8, 16])
def test_tasks_of_a_batch_have_like_candidates(slaves: int) -> None:
    """Of each neighbourhood, and of each place within the grid of a round: none has more of some columns."""
    rounds = RecordRounds(replace(make_view(512, 512, 16), cache=replace(PLAN, rows=16, columns=50)), NO_RECORDS)
    first = rounds.tasks(slaves, ClusterLimits(), 0)[:slaves]
    every = np.sort(np.concatenate([task.candidates for task in first]))
    for task in first:
        rank = np.searchsorted(every, task.candidates)
        assert np.diff(rank).max() < 2 * slaves  # one of so many each time
        of_run = np.bincount(task.candidates % NEIGHBOURS, minlength=NEIGHBOURS)
        assert of_run.max() - of_run.min() <= 0.1 * len(rank) + 2


@pytest.mark.parametrize("processes", [2, 5])
def test_processes_of_one_machine_get_equal_tasks_first_and_small_ones_last(processes: int) -> None:
    plan = replace(PLAN, rows=16, columns=50)
    rounds = RecordRounds(replace(make_view(512, 512, 16), cache=plan), NO_RECORDS)
    count = len(candidates(512, 512, plan, 0))
    sizes = [task.count for task in rounds.tasks(processes, ClusterLimits(), 0, alike=True)]
    assert sum(sizes) == count
    assert sizes[:processes] == [math.ceil(count * ClusterLimits().record_even / processes)] * processes
    assert sizes == sorted(sizes, reverse=True)
    assert len(sizes) < len(rounds.tasks(processes, ClusterLimits(), 0))
    assert max(sizes[-processes:]) <= sizes[0] // 2


def test_processes_of_one_machine_get_a_small_round_in_equal_parts() -> None:
    rounds = RecordRounds(replace(make_view(512, 512, 16), cache=PLAN), NO_RECORDS)
    count = len(candidates(512, 512, PLAN, 0))
    limits = replace(ClusterLimits(), record_task_rays=count * math.prod(PLAN.strata(0)) // 3)
    assert [task.count for task in rounds.tasks(2, limits, 0, alike=True)] == [-(-count // 2), count // 2]


def test_a_round_of_few_rays_is_one_small_task_for_each_slave() -> None:
    """As many as there are processes, and no more: what the interpreter does for each would not be worth it."""
    rounds = RecordRounds(replace(make_view(512, 512, 16), cache=PLAN), NO_RECORDS)
    assert len(rounds.tasks(4, ClusterLimits(), 0)) == 4
    several = rounds.tasks(2, replace(ClusterLimits(), record_task_rays=1), 0)
    for task in several:
        rounds.put(task, made(task))
    rounds.end_round()
    wanted = replace(ClusterLimits(), record_task_rays=2000)
    expected = sum(len(made(task).records) for task in several) * math.prod(PLAN.strata(1))
    assert 2 < len(rounds.tasks(2, wanted, 0)) <= expected // 2000 + 1


def test_every_candidate_of_a_round_is_in_one_task() -> None:
    driver = Rounds()
    out = driver.to_records()
    assert driver.master.phase is Phase.RECORDS
    assert m.Started("records", sum(len(candidates(64, 32, PLAN, number)) for number in range(3))) in out
    seen: list[RecordTask] = []
    waiting = [(identity, task) for identity in (A, B) for task in tasks_of(out, identity)]
    assert {identity for identity, _ in waiting} == {A, B}
    while waiting:
        identity, task = waiting.pop(0)
        seen.append(task)
        out = driver.says(identity, p.TaskDone(EPOCH, made(task)))
        assert m.Advanced(task.count) in out
        waiting += [(other, task) for other in (A, B) for task in tasks_of(out, other)]
    assert [task.count for task in seen] == [4, 4]
    assert sorted(place for task in seen for place in task.candidates) == list(range(8))
    assert {task.round for task in seen} == {0}
    assert driver.master.phase is Phase.RECORDS


@pytest.mark.parametrize("order", [None, *range(6)])
def test_rounds_follow_each_other_and_are_published_whole(order: int | None) -> None:
    """What slaves are sent is the same whatever the order of results: all records so far, clamped, by number."""
    driver = Rounds()
    shuffle = None if order is None else random.Random(order)
    out = driver.to_records()
    for number in range(PLAN.rounds):
        assert {task.round for identity in (A, B) for task in tasks_of(out, identity)} == {number}
        out = driver.to_sharing(out, shuffle)
        expected = all_records(number + 1)
        expected = replace(expected, radius=clamped(expected.position, expected.radius))
        if number == PLAN.rounds - 1:
            # Once all are there they are smoothed, and read further than they were placed by.
            further = expected.radius * np.float32(READ_FURTHER)
            expected = replace(expected, **smoothed(vars(expected)), radius=further)
        for identity in (A, B):
            assert equal(shared_with(out, identity), expected)
            assert tasks_of(out, identity) == []  # nothing of the next round before all have this one
        assert (m.Started("render", 8) in out) == (number == PLAN.rounds - 1)
        out = driver.taken()
    assert driver.master.phase is Phase.BUCKETS


def test_the_result_has_the_records_as_they_were_made() -> None:
    """Unclamped: they may be joined with those of another view before they are clamped."""
    driver = Rounds()
    out = driver.to_records()
    for _ in range(PLAN.rounds):
        driver.to_sharing(out, random.Random(1))
        out = driver.taken()
    waiting = [(identity, task) for identity in (A, B) for task in tasks_of(out, identity)]
    while waiting:
        identity, task = waiting.pop()
        out = driver.says(identity, p.TaskDone(EPOCH, pixels_of(task, cached())))
        waiting += [(other, task) for other in (A, B) for task in tasks_of(out, other)]
    nothing = statistics_of(dropped={})
    driver.says(A, p.Statistics(EPOCH, nothing))
    [finished] = driver.says(B, p.Statistics(EPOCH, nothing))
    assert isinstance(finished, m.Finished)
    assert equal(finished.result.records, all_records(PLAN.rounds))
    rounds = finished.result.records.number >> ROUND_BITS
    assert finished.result.record_rays == sum(math.prod(PLAN.strata(int(number))) for number in rounds)
    assert "records" in finished.result.seconds


def test_records_that_are_there_already_are_shared_and_none_are_made() -> None:
    there = all_records(2)
    driver = Rounds()
    out = [i for i in driver.to_records(records=there) if not tasks_of([i], A) + tasks_of([i], B)]
    for identity in (A, B):
        radius = clamped(there.position, there.radius) * np.float32(READ_FURTHER)
        assert equal(shared_with(out, identity), replace(there, radius=radius))
    driver.taken()
    assert driver.master.phase is Phase.BUCKETS


def test_a_view_without_a_cache_has_no_rounds() -> None:
    driver = Rounds()
    driver.to_records(view=make_view(64, 32, 16))
    assert driver.master.phase is Phase.BUCKETS


def test_rounds_without_records_are_published_too() -> None:
    """As in a view of the sky: the next round's candidates find nothing there either."""
    driver = Rounds()
    out = driver.to_records()
    for _ in range(PLAN.rounds):
        waiting = [(identity, task) for identity in (A, B) for task in tasks_of(out, identity)]
        while waiting:
            identity, task = waiting.pop(0)
            none = RecordsMade(task.number, task.round, NO_RECORDS, 0)
            out = driver.says(identity, p.TaskDone(EPOCH, none))
            waiting += [(other, task) for other in (A, B) for task in tasks_of(out, other)]
        assert len(shared_with(out, A)) == 0
        out = driver.taken()
    assert driver.master.phase is Phase.BUCKETS


@pytest.mark.parametrize(("width", "height"), [(1, 1), (64, 32), (33, 17), (5, 70)])
def test_no_pixel_is_a_candidate_twice(width: int, height: int) -> None:
    rounds = [candidates(width, height, PLAN, number) for number in range(PLAN.rounds)]
    together = np.concatenate(rounds)
    assert len(np.unique(together)) == len(together)
    y, x = np.divmod(np.sort(together), width)
    step = PLAN.spacing >> (PLAN.rounds - 1)
    assert (x % step == 0).all()
    assert (y % step == 0).all()
    assert len(together) == -(-width // step) * -(-height // step)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (64, 32), (33, 17), (5, 70), (8, 0)])
@pytest.mark.parametrize("corner", [(0, 0), (5, 2)])
def test_a_task_finds_its_own_candidates_alone(width: int, height: int, corner: tuple[int, int]) -> None:
    plan = replace(PLAN, left=corner[0], top=corner[1])
    for number in range(plan.rounds):
        every = candidates(width, height, plan, number)
        count = candidate_count(width, height, plan, number)
        assert (len(every), every.dtype) == (count, np.int32)
        cuts = sorted({0, count // 3, count // 3 + 1, count // 2, count})
        parts = [candidates(width, height, plan, number, *cut) for cut in itertools.pairwise(cuts)]
        np.testing.assert_array_equal(np.concatenate([every[:0], *parts]), every)


@pytest.mark.parametrize("tasks", [2, 3, 4, 7])
def test_each_range_of_candidates_is_spread_over_the_image(tasks: int) -> None:
    width, height = 320, 200
    for number in range(2, PLAN.rounds):
        pixels = candidates(width, height, PLAN, number)
        for part in np.array_split(pixels, tasks):
            y, x = np.divmod(part, width)
            for values, size in ((x, width), (y, height)):
                quarters = np.bincount(values * 4 // size, minlength=4) / len(part)
                np.testing.assert_allclose(quarters, 0.25, atol=0.06)


def test_a_picture_of_one_pixel_has_one_candidate() -> None:
    """The rounds after the first have no tasks; what the first made is shared once."""
    driver = Rounds()
    driver.to_sharing(driver.to_records(view=replace(make_view(1, 1, 16), cache=PLAN)))
    assert driver.master.phase is Phase.BUCKETS
    assert tasks_of(driver.taken(), A)


# What goes wrong.


def test_a_repeated_result_is_dropped_if_it_is_the_same() -> None:
    driver = Rounds()
    task = tasks_of(driver.to_records(), A)[0]
    driver.says(A, p.TaskDone(EPOCH, made(task)))
    assert driver.says(A, p.TaskDone(EPOCH, made(task))) == []
    assert driver.master.dropped == {"repeated result": 1}
    assert driver.master.phase is Phase.RECORDS


def test_two_different_results_end_the_render() -> None:
    driver = Rounds()
    task = tasks_of(driver.to_records(), A)[0]
    first = made(task)
    other = replace(first, records=replace(first.records, radius=first.records.radius * np.float32(2)))
    driver.says(A, p.TaskDone(EPOCH, first))
    assert f"two results of task {task.number} differ" in broken(driver.says(A, p.TaskDone(EPOCH, other)))


def _wrong(records: Records, name: str, value: Any) -> Records:
    column: NDArray[Any] = getattr(records, name).copy()
    column[0] = value
    return replace(records, **{name: column})


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        ("position", np.nan, "position is not finite"),
        ("irradiance", np.inf, "irradiance is not finite"),
        ("rotation", np.nan, "rotation is not finite"),
        ("radius", 3e38, "with numbers above 1e+35"),
        ("irradiance", 3e38, "with numbers above 1e+35"),
        ("radius", 0.0, "are not those of candidates 0 to 7"),
        ("number", -1, "are not those of candidates 0 to 7"),
        ("number", 3, "are not those of candidates 0 to 7"),  # twice
        ("number", 4, "are not those of candidates 0 to 7"),  # not ascending
    ],
)
def test_records_that_cannot_be_end_the_render(name: str, value: float, error: str) -> None:
    driver = Rounds()
    task = tasks_of(driver.to_records(), A)[0]
    assert (task.start, task.stop) == (0, 8)
    good = made(task)
    assert len(good.records) == 2
    wrong = replace(good, records=_wrong(good.records, name, value))
    assert error in broken(driver.says(A, p.TaskDone(EPOCH, wrong)))


@pytest.mark.parametrize(("number", "start", "stop"), [(1, 0, 5), (0, 5, 8), (0, 0, 3)])
def test_records_of_other_candidates_end_the_render(number: int, start: int, stop: int) -> None:
    records = made(RecordTask(0, 0, 0, 5)).records  # 0 and 3 of round 0
    check_records(records, 0, 0, 5)
    with pytest.raises(ProtocolError, match=f"candidates {start} to {stop - 1} of round {number}"):
        check_records(records, number, start, stop)


@pytest.mark.parametrize(
    ("some", "right"),
    [([], True), ([0, 3], True), ([0, 1, 3, 4], True), ([0, 1, 2], False), ([1, 3, 4], False), ([4], False)],
)
def test_records_are_of_candidates_that_were_asked_for(some: list[int], right: bool) -> None:
    records = made(RecordTask(0, 0, 0, 5)).records  # 0 and 3
    asked = np.array(some, np.int32)
    if right:
        check_records(records, 0, 0, 5, asked)
    else:
        with pytest.raises(ProtocolError, match="of candidates that were not asked for"):
            check_records(records, 0, 0, 5, asked)
    check_records(NO_RECORDS, 0, 0, 5, asked)


def test_photons_for_records_end_the_render() -> None:
    driver = Rounds()
    task = tasks_of(driver.to_records(), A)[0]
    assert "PhotonsTraced came for" in broken(driver.says(A, p.TaskDone(EPOCH, PhotonsTraced(task.number, 5, 1.0))))


def test_records_taken_out_of_turn_end_the_render() -> None:
    driver = Rounds()
    driver.to_records()
    assert "not expected from it in phase records" in broken(driver.says(A, p.RecordsSet(EPOCH)))


def test_records_taken_twice_end_the_render() -> None:
    driver = Rounds()
    driver.to_sharing(driver.to_records())
    driver.says(A, p.RecordsSet(EPOCH))
    assert "not expected from it in phase records" in broken(driver.says(A, p.RecordsSet(EPOCH)))


# The slave.


def test_a_slave_takes_records_before_it_says_so() -> None:
    driver = slave_driver.Driver().ready()
    records = irradiance_records(4)
    [job] = slave_driver.jobs(driver.told(p.SetRecords(slave_driver.EPOCH, records)))
    assert isinstance(job, c.SetRecords)
    assert job.records is records
    taken = driver.computed(c.SetRecords(NO_RECORDS))
    assert slave_driver.to_master(taken) == [p.RecordsSet(slave_driver.EPOCH)]


def test_a_slave_drops_records_of_another_epoch() -> None:
    driver = slave_driver.Driver().ready()
    assert driver.told(p.SetRecords(slave_driver.EPOCH - 1, irradiance_records(4))) == []
    assert driver.slave.dropped == {"SetRecords of another epoch": 1}


# Whole sessions, shuffled.


class RecordWorker(FakeWorker):
    """Its records are those of `made`, and it notes what it was sent."""

    def _take_credit(self, number: int, credit: int, outbox: Outbox) -> None:
        task, missing = self.open[number]
        if not isinstance(task, RecordTask) or missing > credit:
            super()._take_credit(number, credit, outbox)
            return
        before = len(self.sent[-1]) if self.sent else 0
        assert before == len(all_records(task.round))  # it has all of the rounds before, and nothing of this one
        del self.open[number]
        outbox.results.append(made(task))

    @property
    def sent(self) -> list[Records]:
        """Records that came, in turn."""
        return self.__dict__.setdefault("_sent", [])

    def set_records(self, records: Records) -> None:
        self.sent.append(records)


@pytest.mark.parametrize(("slaves", "cells"), [(1, 1), (2, 4), (3, 8), (5, 8)])
@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_a_session_ends_with_the_same_records(slaves: int, cells: int, seed: int | None) -> None:
    shuffle = None if seed is None else random.Random(seed)
    cluster = MemoryCluster(RecordWorker, slaves, limits=replace(FEW_A_TASK, photon_task_paths=500), shuffle=shuffle)
    session = make_session(slaves, cells, view=cached())
    result = cluster.render(session)
    assert equal(result.records, all_records(PLAN.rounds))
    for name, layer in picture(session.view).layers.items():
        np.testing.assert_array_equal(result.layers[name], layer)
    assert result.dropped == {}
    again = cluster.render(replace(session, records=result.records))
    assert equal(again.records, result.records)
    assert again.record_rays == 0


# Which records a slave keeps.


def test_records_are_kept_where_they_reach() -> None:
    """By the distance between the record and the nearest point of a box, never by the box around its sphere."""
    records = irradiance_records(1)
    at = replace(records, position=np.array([[2.0, 2.0, 0.0]], np.float32), radius=np.array([1.4], np.float32))
    low, high = np.zeros(3, np.float32), np.ones(3, np.float32)
    assert len(take_near(at, [(low, high)])) == 0  # sqrt(2) away from the edge
    assert len(take_near(replace(at, radius=np.array([1.5], np.float32)), [(low, high)])) == 1
    exact = replace(at, position=np.array([[2.0, 0.5, 0.5]], np.float32), radius=np.ones(1, np.float32))
    assert len(take_near(exact, [(low, high)])) == 1  # it ends at the face
    assert len(take_near(exact, [])) == 0


def test_records_of_many_boxes_are_kept_once() -> None:
    records = irradiance_records(5)
    boxes = [(np.full(3, float(i), np.float32), np.full(3, i + 0.5, np.float32)) for i in range(5)]
    assert equal(take_near(records, boxes), records)


def test_candidates_of_a_round_are_dealt_out_one_by_one() -> None:
    """Every task gets one of each turn, and who begins it is another one each time; the rest goes to the first."""
    places = np.arange(100, 100 + 4 * 50 + 3, dtype=np.int32)
    tasks = _interleaved(places, 4)
    assert [len(task) for task in tasks] == [51, 51, 51, 50]
    assert np.array_equal(np.sort(np.concatenate(tasks)), places)
    turns = np.stack([(task[:50] - 100) // 4 for task in tasks])
    assert (turns == np.arange(50)).all()
    first = np.argmin([task[:50] for task in tasks], axis=0)
    assert set(first.tolist()) == {0, 1, 2, 3}
    assert [task[-1] for task in tasks[:3]] == places[-3:].tolist()
