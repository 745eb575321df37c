"""Slaves that do several tasks at once are handed as many, where the scene is one cell."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fake_worker import make_session, triangles
from master_driver import EPOCH, LIMITS, A, Driver, hello, sent, tasks_of

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Master
from wdpm.cluster.master.task_sizes import PHOTON_TASK_LEAST, TASKS_A_PROCESS
from wdpm.cluster.messages import protocol as p


def first_tasks(processes: int, paths: int) -> list[range]:
    """Photon paths of the first tasks that a lone slave is handed."""
    driver = Driver(1)
    driver.master = Master(1, {"code": "1"}, replace(LIMITS, photon_task_paths=ClusterLimits().photon_task_paths))
    driver.says(A, replace(hello(), processes=processes))
    driver(m.Begin(make_session(1, 1, paths=paths)))
    driver(m.PartitionMade(0, triangles(3)))
    driver.says(A, p.PartitionReceived(EPOCH, 0))
    return [range(task.start, task.stop) for task in tasks_of(driver.says(A, p.Ready(EPOCH)), A)]


def test_tasks_are_so_many_that_processes_end_together() -> None:
    paths = 400_000
    alone, several = first_tasks(1, paths), first_tasks(4, paths)
    assert len(several) == 4 * len(alone)
    assert len(several[0]) == -(-paths // (TASKS_A_PROCESS * 4)) < len(alone[0])


def test_tasks_stay_large_enough_for_a_launch() -> None:
    assert {len(paths) for paths in first_tasks(16, 20_000)} == {PHOTON_TASK_LEAST, 20_000 % PHOTON_TASK_LEAST}


@pytest.mark.parametrize("processes", [0, -1, 1 << 40])
def test_a_number_of_processes_that_cannot_be_is_refused(processes: int) -> None:
    from wdpm.cluster.messages import packing
    from wdpm.scenes.errors import ProtocolError

    frames = packing.encode(replace(hello(), processes=processes))
    with pytest.raises(ProtocolError, match="processes"):
        packing.decode(frames, {"Hello": p.Hello})


def test_a_slave_with_a_part_of_the_scene_is_handed_a_few() -> None:
    driver = Driver()
    for number, identity in enumerate((A, b"b")):
        driver.says(identity, replace(hello(number), processes=8))
    driver(m.Begin(make_session(2, 2, paths=450)))
    for cell, identity in enumerate((A, b"b")):
        driver(m.PartitionMade(cell, triangles(3)))
        driver.says(identity, p.PartitionReceived(EPOCH, cell))
    driver.says(A, p.Ready(EPOCH))
    out = driver.says(b"b", p.Ready(EPOCH))
    assert len(tasks_of(out, A)) == LIMITS.photon_tasks_in_flight
    assert all(isinstance(message, p.StartTask) for message in sent(out))
