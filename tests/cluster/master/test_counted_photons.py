"""What was counted of photons is of those in the maps, each once, whoever is lost or traces them once more."""

from __future__ import annotations

from typing import Any

import pytest
from fake_worker import make_session, make_view, make_world, maps_built, pixels_of, statistics_of, triangles
from master_driver import EPOCH, A, B, C, Driver, broken, hello, sent, tasks_of

from wdpm.cluster.master import events as m
from wdpm.cluster.master.statistics import no_photons_counted
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.task import PhotonsTraced

VIEW = make_view(16, 16, 16)
LIGHTS = len(make_world(1).lights.names)


def epoch(driver: Driver, identity: bytes) -> int:
    return driver.master.epoch(identity)


def built(driver: Driver, identity: bytes, of_cell: int = 0) -> list[Any]:
    """Has the whole scene, and is ready."""
    driver(m.PartitionMade(of_cell, triangles(3)))
    driver.says(identity, p.PartitionReceived(epoch(driver, identity), of_cell))
    return driver.says(identity, p.Ready(epoch(driver, identity)))


def to_buckets(stored: tuple[int, int]) -> tuple[Driver, Any]:
    """Two slaves that each have the whole scene have stored so many photons; and the only bucket."""
    driver = Driver().join()
    driver(m.Begin(make_session(2, 1, paths=0, team_size=1, view=VIEW)))
    for identity in (A, B):
        built(driver, identity)
    driver.says(A, maps_built(epoch(driver, A), stored[0]))
    [bucket] = tasks_of(driver.says(B, maps_built(epoch(driver, B), stored[1])), A)
    return driver, bucket


def result_of(driver: Driver, bucket: Any, *others: bytes) -> Any:
    """Of the session, when A has done the bucket and all have told their statistics."""
    driver.says(A, p.TaskDone(epoch(driver, A), pixels_of(bucket, VIEW)))
    out = []
    for identity in (A, *others):
        out += driver.says(identity, p.Statistics(epoch(driver, identity), statistics_of(dropped={})))
    [finished] = [each for each in out if isinstance(each, m.Finished)]
    return finished.result


def test_what_a_lost_slave_has_stored_counts() -> None:
    driver, bucket = to_buckets((5, 7))
    driver(m.SlaveLost(B, "killed"))
    result = result_of(driver, bucket)
    assert len(result.lost) == 1
    assert result.counted == maps_built(0, 5 + 7).counted


def test_what_a_late_slave_traces_for_itself_is_not_counted_twice() -> None:
    driver, bucket = to_buckets((5, 7))
    driver(m.SlaveLost(B, "killed"))
    driver.says(C, hello(2))
    assert sent(built(driver, C), C) == [p.BuildMaps(epoch(driver, C))]
    driver.says(C, maps_built(epoch(driver, C), 12))
    assert result_of(driver, bucket, C).counted == maps_built(0, 5 + 7).counted


def test_the_next_image_from_the_same_photons_has_the_same_counts() -> None:
    driver, bucket = to_buckets((5, 7))
    result_of(driver, bucket, B)
    [bucket] = tasks_of(driver(m.Begin(make_session(2, 1, paths=0, team_size=1, view=VIEW))), A)
    assert result_of(driver, bucket, B).counted == maps_built(0, 5 + 7).counted


@pytest.mark.parametrize(
    "wrong",
    [
        {"stored_by_light": [[1.5] * LIGHTS] * 3},
        {"paths_by_light": [[1] * LIGHTS]},
        {"flux_by_light": [[float("nan")] * LIGHTS] * 3},
        {"energy": None},
        {"guards": {"a": -1}},
        {"more": 1},
    ],
    ids=str,
)
def test_counts_that_are_none_end_the_render(wrong: dict[str, Any]) -> None:
    driver = Driver()
    tasks = driver.to_photons(paths=100)
    driver.says(A, p.TaskDone(EPOCH, PhotonsTraced(tasks_of(tasks, A)[0].number, 100, 1.0)))
    out = driver.says(B, p.MapsBuilt(EPOCH, no_photons_counted(LIGHTS) | wrong))
    assert "slave 1 (host, process 1) broke the protocol: MapsBuilt: " in broken(out)
