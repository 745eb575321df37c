"""Slaves that are lost, leave, join and lose sight of each other at any moment: the picture stays the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from fake_worker import FakeWorker, make_session, make_view, picture
from faulty_cluster import FaultyCluster
from hypothesis import given, settings
from hypothesis import strategies as st


@settings(max_examples=200, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    slaves=st.integers(1, 5),
    team=st.integers(1, 5),
    cells=st.sampled_from([1, 2, 4, 8]),
    every=st.sampled_from([20, 100, 400]),
    faults=st.integers(0, 8),
)
def test_a_picture_survives_any_faults(seed: int, slaves: int, team: int, cells: int, every: int, faults: int) -> None:
    view = make_view()
    session = make_session(slaves, cells, least=min(team, slaves), view=view)
    cluster = FaultyCluster(FakeWorker, slaves, seed, every=every, faults=faults, most=slaves + faults)
    for again in (session, replace(session, retrace=True), session):
        result = cluster.render(again)
        for name, layer in picture(view).layers.items():
            np.testing.assert_array_equal(result.layers[name], layer, str(cluster.suffered))
        assert result.paths == 1000
