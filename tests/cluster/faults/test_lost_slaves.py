"""Slaves that are lost, leave, join and lose sight of each other at any moment: the picture stays the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from digests import without_cells
from fake_worker import FakeWorker, make_session, make_view, picture
from faulty_cluster import LIMITS, FaultyCluster
from hypothesis import given, settings
from hypothesis import strategies as st
from record_rounds import PLAN, all_records, cached, made

import wdpm
from wdpm.cluster.master.statistics import photon_tables
from wdpm.cluster.outbox import Outbox
from wdpm.cluster.plan.copies import Sharing
from wdpm.cluster.records import Records, equal
from wdpm.cluster.render_settings import Indirect, RenderSettings, Routing
from wdpm.cluster.task import BucketTask, RecordTask
from wdpm.cluster.work import tree_orders
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import View, World
from wdpm.images.image import Image
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes.flat.arrays import Triangles


@pytest.mark.parametrize("stops", [False, True], ids=["lost", "standing still"])
def test_a_picture_survives_any_faults(stops: bool) -> None:
    """Others go on without slaves that stand still, in whichever phase; some come back, some are taken for dead."""

    @settings(max_examples=50, deadline=None)
    @given(
        seed=st.integers(0, 2**32 - 1),
        slaves=st.integers(1 + stops, 5),
        team=st.integers(1, 5),
        cells=st.sampled_from([1, 2, 4, 8]),
        every=st.sampled_from([10, 40, 150, 400]),
        faults=st.integers(stops, 8),
    )
    def survives(seed: int, slaves: int, team: int, cells: int, every: int, faults: int) -> None:
        view = make_view()
        session = make_session(slaves, cells, team_size=min(team, slaves), view=view)
        most = slaves + 3 * faults
        cluster = FaultyCluster(FakeWorker, slaves, seed, every=every, faults=faults, most=most, stops=stops)
        for again in (session, replace(session, retrace=True), session):
            result = cluster.render(again)
            for name, layer in picture(view).layers.items():
                np.testing.assert_array_equal(result.layers[name], layer, str(cluster.suffered))
            assert result.paths == 1000

    survives()


RECORDS_BY = [len(all_records(rounds)) for rounds in range(PLAN.rounds + 1)]


class RecordingWorker(FakeWorker):
    """Ends no task with other irradiance records than those that it needs."""

    def set_view(self, view: View) -> None:
        super().set_view(view)
        self.records_here = 0

    def set_records(self, records: Records) -> None:
        self.records_here = len(records)

    def _take_credit(self, number: int, credit: int, outbox: Outbox) -> None:
        task, missing = self.open[number]
        if missing == credit and isinstance(task, RecordTask):
            assert self.records_here == RECORDS_BY[task.round]
            outbox.results.append(made(task))
            del self.open[number]
            return
        assert missing > credit or not isinstance(task, BucketTask) or self.records_here == RECORDS_BY[-1]
        super()._take_credit(number, credit, outbox)


@patch("faulty_cluster.LIMITS", replace(LIMITS, record_task_least=20, record_task_most=20))
@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    slaves=st.integers(2, 5),
    team=st.integers(1, 3),
    cells=st.sampled_from([1, 2]),
    every=st.sampled_from([10, 40, 150]),
    faults=st.integers(1, 8),
)
def test_records_survive_any_faults(seed: int, slaves: int, team: int, cells: int, every: int, faults: int) -> None:
    """Whoever begins with tasks before the records are there may be lost, or stand still, as well."""
    view = cached()
    session = make_session(slaves, cells, team_size=min(team, slaves), view=view)
    cluster = FaultyCluster(
        RecordingWorker, slaves, seed, every=every, faults=faults, most=slaves + 3 * faults, stops=True
    )
    for again in (session, replace(session, retrace=True)):
        result = cluster.render(again)
        np.testing.assert_array_equal(result.layers["beauty"], picture(view).layers["beauty"], str(cluster.suffered))
        assert equal(result.records, all_records(PLAN.rounds))


def make_worker(number: int, world: World, partition: Mapping[int, Triangles], holders: Sequence[int]) -> CellWorker:
    return CellWorker(number, world, partition, holders, Launcher("cpu", 1))


@pytest.mark.parametrize(
    ("team", "cells", "routing"),
    [(1, 1, Routing.MERGE), (2, 4, Routing.FORWARD), (4, 4, Routing.MERGE)],
)
def test_an_image_keeps_its_bits(monkeypatch: pytest.MonkeyPatch, team: int, cells: int, routing: Routing) -> None:
    """With kernels, an irradiance cache and two passes; every slave that was there at first may be gone at the end."""
    monkeypatch.setattr(tree_orders, "PLACES_A_PART", 1)  # few as they are, the sorting of trees is shared
    scene = wdpm.load("cornell-box", size=(40, 40))
    chosen = RenderSettings(photons=4000, spp=2, k=20, indirect=Indirect.CACHE, routing=routing, bucket=8)
    prepared = prepare(scene, chosen, 4, Launcher("cpu", 1), SilentProgress(), cells, team=lambda _: Sharing(4, team))
    undisturbed = FaultyCluster(make_worker, 1, 0, every=1, faults=0).render(prepared.session)
    expected = without_cells(Image(undisturbed.layers))
    cluster = FaultyCluster(make_worker, 4, 7 * cells, every=15, faults=6, most=8)
    for session in (prepared.session, replace(prepared.session, retrace=True)):
        result = cluster.render(session)
        assert without_cells(Image(result.layers)).digest() == expected.digest(), cluster.suffered
        for name in photon_tables(0):  # each photon once: of slaves that are gone, too
            counted, expected_counts = (np.array(each.counted[name]) for each in (result, undisturbed))
            np.testing.assert_allclose(counted, expected_counts, rtol=1e-6, err_msg=f"{name}, {cluster.suffered}")
    assert len(cluster.suffered) == 6
