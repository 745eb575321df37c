"""A worker that has the whole scene begins with tasks before it has the irradiance records that they read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from one_cell import ready

from wdpm.cluster.records import CachePlan, Records, equal
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.task import BucketRendered, BucketTask, RecordsMade, RecordTask, TaskResult
from wdpm.cluster.work.worker import CellWorker
from wdpm.scenes import cornell_box

ROUNDS = CachePlan(rounds=2, spacing=8, rows=2, columns=4, error=0.5, least=2.0, most=6.0, wanted=0.3)
FIRST, SECOND = RecordTask(0, 0, 0, 20), RecordTask(1, 1, 0, 60)
BUCKETS = [BucketTask(2, 0, 0, 16, 16), BucketTask(3, 16, 16, 32, 32)]


@pytest.fixture
def worker() -> CellWorker:
    worker = ready(cornell_box((40, 32)), RenderSettings(photons=2000, spp=2, indirect=Indirect.CACHE))
    assert worker.replica.view is not None
    worker.set_view(replace(worker.replica.view, cache=ROUNDS))
    return worker


def records_of(results: list[TaskResult]) -> Records:
    [made] = results
    assert isinstance(made, RecordsMade)
    return made.records


def pixels_of(results: list[TaskResult]) -> dict[int, BucketRendered]:
    return {result.number: result for result in results if isinstance(result, BucketRendered)}


def test_a_round_that_began_before_its_records_has_the_same_bits(worker: CellWorker) -> None:
    first = records_of(worker.start(FIRST).results)
    worker.set_records(first)
    expected = records_of(worker.start(SECOND).results)
    assert worker.replica.view is not None
    worker.set_view(worker.replica.view)
    unread = records_of(worker.start(SECOND).results)
    assert len(unread) > len(expected) > 0  # the records of the round before leave fewer of them wanted
    worker.set_view(worker.replica.view)
    worker.await_records()
    begun = worker.start(SECOND)
    assert (begun.batches, begun.results) == ([], [])
    worker.set_records(first)
    done = worker.go_on()
    assert done.batches == []
    assert equal(records_of(done.results), expected)
    assert worker.go_on().results == []


def test_buckets_that_began_before_their_records_have_the_same_bits(worker: CellWorker) -> None:
    first = records_of(worker.start(FIRST).results)
    worker.set_records(first)
    expected = pixels_of([result for bucket in BUCKETS for result in worker.start(bucket).results])
    assert worker.replica.view is not None
    worker.set_view(worker.replica.view)
    worker.await_records()
    assert [worker.start(bucket).results for bucket in BUCKETS] == [[], []]
    worker.set_records(first)
    found = pixels_of(worker.go_on().results)
    assert found.keys() == expected.keys() == {2, 3}
    for number, bucket in found.items():
        for name, layer in bucket.layers.items():
            np.testing.assert_array_equal(layer, expected[number].layers[name])


def test_another_view_forgets_what_waits(worker: CellWorker) -> None:
    worker.await_records()
    worker.start(BUCKETS[0])
    assert worker.replica.view is not None
    worker.set_view(worker.replica.view)
    assert worker.go_on().results == []
    assert worker.start(BUCKETS[1]).results
