"""Hits of several cells are merged to the same ones in whatever order they come: the nearest, of these the first."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wdpm.cluster.batch import Arrays
from wdpm.cluster.work.bucket_home import BucketHome
from wdpm.kernels.ray_fields import HIT
from wdpm.kernels.rays.triangle import NO_HIT

RAYS = 3


def merged(batches: list[Arrays]) -> Arrays:
    """The hits that a home has after these."""
    home = BucketHome.__new__(BucketHome)
    home._rays = {name: np.zeros(RAYS, np.float32 if name == "t" else np.int32) for name in HIT}
    home._rays["t"][:] = NO_HIT
    home._rays["prim"][:] = -1
    for batch in batches:
        home._merge(batch)
    return home._rays


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.integers(0, RAYS - 1), st.integers(1, 3), st.integers(0, 9)), max_size=12), st.data())
def test_the_nearest_hit_counts_and_of_equally_near_ones_the_least_triangle(
    hits: list[tuple[int, int, int]], data: st.DataObject
) -> None:
    """Of rays, at distances, on triangles."""
    columns = {name: np.array([hit[2] for hit in hits], np.int32) for name in HIT}
    columns["slot"] = np.array([hit[0] for hit in hits], np.int32)
    columns["t"] = np.array([hit[1] for hit in hits], np.float32)
    order = np.array(data.draw(st.permutations(range(len(hits)))), np.intp)
    cuts = data.draw(st.lists(st.integers(0, len(hits)), max_size=3))
    pieces = [rows for rows in np.split(order, sorted(cuts)) if len(rows)]
    found = merged([{name: column[rows] for name, column in columns.items()} for rows in pieces])
    for ray in range(RAYS):
        best = min(((t, prim) for slot, t, prim in hits if slot == ray), default=(NO_HIT, -1))
        assert (found["t"][ray], found["prim"][ray]) == (np.float32(best[0]), best[1])
