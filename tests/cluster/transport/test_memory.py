"""Whole sessions in one process, with workers that know no light."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from fake_worker import FakeWorker, make_session, make_view, picture

from wdpm.cluster.in_process import MemoryCluster, run
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.world import MapPlan
from wdpm.scenes.errors import ClusterError
from wdpm.scenes.flat.arrays import Triangles

SMALL = ClusterLimits(photon_task_paths=64, part_triangles=3)


@pytest.mark.parametrize(("slaves", "cells"), [(1, 1), (1, 4), (2, 2), (3, 8), (4, 4), (8, 8)])
@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_a_session_ends_with_the_whole_picture(slaves: int, cells: int, seed: int | None) -> None:
    shuffle = None if seed is None else random.Random(seed)
    cluster = MemoryCluster(FakeWorker, slaves, limits=SMALL, shuffle=shuffle)
    session = make_session(slaves, cells)
    result = cluster.render(session)
    expected = picture(session.view)
    assert result.layers.keys() == expected.layers.keys()
    for name, layer in expected.layers.items():
        np.testing.assert_array_equal(result.layers[name], layer)
    assert result.paths == 1000
    assert [traced.number for traced in result.photons_traced] == list(range(16))
    assert result.emitted == 8.0
    assert sum(values["photons"][0] for values in result.statistics) == 16 * cells * 3
    assert sum(values["triangles"] for values in result.statistics) == sum(5 + cell for cell in range(cells))
    assert result.seconds.keys() == {"partition", "photons", "map", "render"}
    assert result.dropped == {}


@pytest.mark.parametrize("seed", range(5))
def test_geometry_and_photons_are_used_again(seed: int) -> None:
    cluster = MemoryCluster(FakeWorker, 2, limits=SMALL, shuffle=random.Random(seed))
    first = cluster.render(make_session(2, 4))
    second = make_session(2, 4, view=make_view(seed=7))
    again = cluster.render(second)
    assert again.seconds.keys() == {"render"}
    assert again.photons_traced == first.photons_traced
    np.testing.assert_array_equal(again.layers["beauty"], picture(second.view).layers["beauty"])
    traced = cluster.render(make_session(2, 4, retrace=True))
    assert traced.seconds.keys() == {"photons", "map", "render"}
    other = cluster.render(make_session(2, 8, digest="b"))
    assert other.seconds.keys() == {"partition", "photons", "map", "render"}
    assert sum(values["triangles"] for values in other.statistics) == sum(5 + cell for cell in range(8))


def test_other_photons_of_the_same_cells_are_traced_without_sending_geometry() -> None:
    cluster = MemoryCluster(FakeWorker, 2, limits=SMALL, shuffle=random.Random(0))
    first = make_session(2, 4)
    cluster.render(first)
    plan = replace(first.world.photon_plan, seed=7, global_map=MapPlan(500, 0.05, 0.05))

    def forbidden(cell: int) -> Triangles:
        raise AssertionError(cell)

    second = replace(first, world=first.world.with_photons(plan), partition=forbidden)
    result = cluster.render(second)
    assert result.seconds.keys() == {"photons", "map", "render"}
    assert result.paths == 500
    assert cluster.render(second).seconds.keys() == {"render"}
    assert cluster.render(first).paths == 1000


def test_no_photon_paths() -> None:
    result = MemoryCluster(FakeWorker, 2).render(make_session(2, 2, paths=0))
    assert result.paths == 0
    assert result.photons_traced == ()


def test_run_takes_workers_that_are_built_already() -> None:
    session = make_session(2, 2)
    workers = [FakeWorker(number, session.world, {number: session.partition(number)}, (0, 1)) for number in range(2)]

    def forbidden(cell: int) -> Triangles:
        raise AssertionError(cell)

    object.__setattr__(session, "partition", forbidden)
    result = run(session, workers, shuffle=random.Random(0))
    np.testing.assert_array_equal(result.layers["cell"], picture(session.view).layers["cell"])


def test_progress_adds_up() -> None:
    told: list[tuple[str, int]] = []

    class Recorder:
        def start(self, phase: str, total: int | None = None) -> None:
            assert total is not None
            told.append((phase, total))

        def advance(self, amount: int = 1) -> None:
            phase, left = told[-1]
            told[-1] = (phase, left - amount)

        def note(self, text: str) -> None:
            raise AssertionError(text)

    MemoryCluster(FakeWorker, 3, limits=SMALL).render(make_session(3, 4), Recorder())
    assert told == [("partition", 0), ("photons", 0), ("map", 0), ("render", 0)]


def test_a_worker_that_raises_ends_the_render_with_its_error() -> None:
    class Failing(FakeWorker):
        def finish_maps(self) -> None:
            raise ClusterError("no memory")

    with pytest.raises(ClusterError, match="no memory"):
        MemoryCluster(Failing, 2).render(make_session(2, 2))
