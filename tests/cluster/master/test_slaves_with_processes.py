"""Slaves that do several tasks at once: what of photons they are handed, and what where they have but a part."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fake_worker import make_session, triangles
from master_driver import EPOCH, LIMITS, A, Driver, hello, sent, tasks_of

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.machine import Master
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


@pytest.mark.parametrize("paths", [400_000, 20_000])
def test_photons_are_handed_out_as_to_one_process_since_threads_trace_them(paths: int) -> None:
    tasks = first_tasks(16, paths)
    assert tasks == first_tasks(1, paths)
    assert len(tasks[0]) == min(paths, ClusterLimits().photon_task_paths)


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
