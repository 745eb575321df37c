"""The slave that is ready first leaves others their share of few tasks."""

from __future__ import annotations

import pytest
from fake_worker import make_session, make_view, triangles
from master_driver import A, B, Driver, tasks_of

from wdpm.cluster.master import events as m
from wdpm.cluster.master.task_sizes import most_in_flight
from wdpm.cluster.messages import protocol as p


@pytest.mark.parametrize(("buckets", "first"), [(2, 1), (3, 1), (4, 2), (8, 3)])
def test_a_slave_that_sets_its_view_first_is_handed_its_share(buckets: int, first: int) -> None:
    driver = Driver().join()
    driver(m.Begin(make_session(2, 1, paths=0, least=1, view=make_view(16 * buckets, 16, 16))))
    for identity in (A, B):
        driver(m.PartitionMade(0, triangles(3)))
        driver.says(identity, p.PartitionReceived(driver.master.epoch(identity), 0))
        driver.says(identity, p.Ready(driver.master.epoch(identity)))
    for identity in (A, B):
        driver.says(identity, p.MapsBuilt(driver.master.epoch(identity)))
    assert len(tasks_of(driver.says(A, p.ViewSet(driver.master.epoch(A))), A)) == first
    assert tasks_of(driver.says(B, p.ViewSet(driver.master.epoch(B))), B)


def test_a_lone_place_is_handed_as_many_as_the_limit_says() -> None:
    assert most_in_flight(3, 1, 1) == 3
    assert most_in_flight(3, 0, 4) == 1
