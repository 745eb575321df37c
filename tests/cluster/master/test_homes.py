"""Tasks go to who holds what they see, as far as nobody is idle for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_worker import make_session, make_view

from wdpm.cluster.kept import RecordsKept
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.homes import ANYWHERE, cell_of_bucket, cells_of_pixels, home_cells
from wdpm.cluster.master.members import Member
from wdpm.cluster.master.records import RecordRounds
from wdpm.cluster.master.task_sizes import Capacity
from wdpm.cluster.master.tasks import Tasks, size_of
from wdpm.cluster.master.waiting import Waiting
from wdpm.cluster.messages.protocol import Hello
from wdpm.cluster.records import NO_RECORDS, ROUND_BITS, CachePlan, Records, candidates
from wdpm.cluster.session import Session
from wdpm.cluster.task import BucketTask, PhotonTask, RecordsMade, RecordTask
from wdpm.scenes.errors import ProtocolError

LEFT_RIGHT = np.array([[0, 0, 1, 1], [0, 0, 1, 1], [-1, 0, 1, 1], [-1, -1, -1, 1]], np.int32)
"""Cell 0 is seen on the left, cell 1 on the right, and nothing at the lower left."""

PLAN = CachePlan(rounds=2, spacing=4)


def session_of(sight: np.ndarray = LEFT_RIGHT, width: int = 64, height: int = 64, bucket: int = 16) -> Session:
    view = replace(make_view(width, height, bucket), cache=PLAN)
    return make_session(2, 2, view=view, sight=sight)


def member(number: int, *cells: int) -> Member:
    return Member(number, bytes([number]), Hello({}, "host", number, 1, 0, "", 1), 0.0, cells=frozenset(cells))


def task(number: int) -> PhotonTask:
    return PhotonTask(number, 0, 1)


def test_a_bucket_is_at_home_where_most_of_its_pixels_look() -> None:
    session = session_of()
    assert cell_of_bucket(session, BucketTask(0, 0, 0, 16, 16)) == 0
    assert cell_of_bucket(session, BucketTask(0, 16, 16, 64, 32)) == 1
    assert cell_of_bucket(session, BucketTask(0, 0, 48, 16, 64)) == ANYWHERE
    assert cell_of_bucket(session, BucketTask(0, 0, 32, 64, 64)) == 1
    assert cell_of_bucket(session_of(np.empty((0, 0), np.int32)), BucketTask(0, 0, 0, 16, 16)) == ANYWHERE


@pytest.mark.parametrize(("width", "height"), [(64, 64), (7, 5), (3, 2), (1, 1)])
def test_every_pixel_of_an_image_of_any_size_is_looked_up(width: int, height: int) -> None:
    """Also where the grid is finer than the image."""
    pixels = np.arange(width * height, dtype=np.int32)
    seen = cells_of_pixels(session_of(width=width, height=height), pixels).reshape(height, width)
    rows, columns = (np.arange(height) * 4 // height, np.arange(width) * 4 // width)
    np.testing.assert_array_equal(seen, LEFT_RIGHT[rows][:, columns])


def test_own_tasks_come_first_and_only_the_idle_do_those_of_others() -> None:
    cells = {0: 0, 1: 0, 2: 1, 3: ANYWHERE, 4: 1, 5: 1}
    waiting = Waiting(map(task, cells), lambda each: cells[each.number])
    order = []
    for held, idle in (((0,), False), ((0,), False), ((0,), False), ((0,), False), ((0,), True), ((1,), False)):
        found = waiting.next_for(held, idle=idle)
        order.append(None if found is None else found.number)
        if found is not None:
            waiting.take(found)
    assert order == [0, 1, 3, None, 2, 4]
    assert len(waiting) == 1


def test_what_is_given_back_waits_before_others_of_its_cell() -> None:
    waiting = Waiting(map(task, range(4)), lambda each: each.number % 2)
    first = waiting.next_for((0,), idle=False)
    assert first is not None
    waiting.take(first)
    waiting.put_back([first])
    assert waiting.next_for((0,), idle=False) is first
    with pytest.raises(AssertionError, match="is not the first"):
        waiting.take(task(2))


def test_slaves_are_handed_the_buckets_that_see_their_cells() -> None:
    session, tasks = session_of(), Tasks()
    tasks.render(session)
    capacities = [Capacity(member(0, 0), 6), Capacity(member(1, 1), 6)]
    for given, bucket in tasks.hand_out(capacities, 0.0):
        assert isinstance(bucket, BucketTask)
        assert cell_of_bucket(session, bucket) in (given.number, ANYWHERE)
    assert [len(capacity.member.in_flight) for capacity in capacities] == [6, 6]


def test_tasks_of_records_see_one_cell_each_and_leave_out_no_candidate() -> None:
    session = session_of()
    rounds = RecordRounds(session.view, NO_RECORDS)
    count = len(candidates(64, 64, PLAN, 0))
    tasks, cells = rounds.tasks_by_cell(session, 2, 10)
    assert [each.number for each in tasks] == [10, 11]
    assert sorted(np.concatenate([each.candidates for each in tasks]).tolist()) == list(range(count))
    assert sum(map(size_of, tasks)) == count
    pixels = candidates(64, 64, PLAN, 0)
    fewest = min(cells.values(), key=lambda cell: (cells_of_pixels(session, pixels) == cell).sum())
    for each in tasks:
        seen = set(cells_of_pixels(session, pixels[each.candidates]).tolist())
        assert seen - {ANYWHERE} == {cells[each.number]}
        assert (ANYWHERE in seen) == (cells[each.number] == fewest)


def test_a_cell_that_most_see_has_several_tasks() -> None:
    """Two teams, or four slaves, of which two see nothing: all shall have some."""
    tasks, cells = RecordRounds(session_of().view, NO_RECORDS).tasks_by_cell(session_of(), 4, 0)
    assert sorted(cells.values()) == [0, 0, 1, 1]
    assert len({each.count for each in tasks}) <= 4


def test_where_nothing_is_seen_one_task_has_all_candidates() -> None:
    session = session_of(np.full((4, 4), -1, np.int32))
    tasks, cells = RecordRounds(session.view, NO_RECORDS).tasks_by_cell(session, 1, 0)
    assert [each.count for each in tasks] == [len(candidates(64, 64, PLAN, 0))]
    assert set(cells.values()) == {ANYWHERE}


def test_few_homes_are_those_of_the_cells_that_most_see_and_share_the_others() -> None:
    seen = np.repeat(np.array([0, 1, 2, 3, ANYWHERE], np.int32), [5, 40, 30, 20, 9])
    about = home_cells(seen, 2)
    assert (about[seen == 1] == 1).all()
    assert (about[seen == 2] == 2).all()
    assert (about[seen == 3] == 2).all(), "the fewer of the two"
    assert (about[seen == 0] == 1).all()
    assert (about[seen == ANYWHERE] == 1).all()
    assert (home_cells(seen, 9)[seen >= 0] == seen[seen >= 0]).all(), "each has its own where there are enough homes"
    assert (home_cells(np.full(3, ANYWHERE, np.int32), 2) == ANYWHERE).all()
    assert not len(home_cells(np.empty(0, np.int32), 2))


@pytest.mark.parametrize("by_cell", [True, False])
def test_candidates_that_were_kept_are_not_asked_for_again(by_cell: bool) -> None:
    """Whether they were made of ranges or of some of them, and whichever way the others are made."""
    session, count = session_of(), len(candidates(64, 64, PLAN, 0))
    some = RecordTask(0, 0, 3, 90, np.array([3, 50, 89], np.int32))
    kept = [RecordsKept(each, RecordsMade(0, 0, NO_RECORDS, 0)) for each in (some, RecordTask(1, 0, 100, 120))]
    rounds = RecordRounds(session.view, NO_RECORDS, kept)
    tasks = rounds.tasks_by_cell(session, 2, 0)[0] if by_cell else rounds.tasks(1, ClusterLimits(), 0)
    left = sorted(np.concatenate([each.candidates for each in tasks]).tolist())
    assert left == sorted(set(range(count)) - {3, 50, 89, *range(100, 120)})
    assert rounds.kept == 23


def test_records_of_candidates_that_were_not_asked_for_are_refused() -> None:
    task = RecordTask(0, 0, 3, 9, np.array([3, 8], np.int32))
    rounds = RecordRounds(session_of().view, NO_RECORDS)
    rounds.put(task, RecordsMade(0, 0, record(8), 4))
    with pytest.raises(ProtocolError, match="were not asked for"):
        rounds.put(task, RecordsMade(0, 0, record(5), 4))


def record(candidate: int) -> Records:
    number = np.array([(0 << ROUND_BITS) + candidate], np.int64)
    row, rows = np.ones((1, 3), np.float32), np.ones((1, 3, 3), np.float32)
    return Records(number, row, row, row, rows, rows, *np.ones((2, 1), np.float32), np.zeros(1, np.float32))
