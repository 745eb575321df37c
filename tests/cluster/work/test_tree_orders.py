"""Sorting of trees that several share: the parts make the very trees that one would have built."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest
from digests import without_cells

import wdpm
from wdpm.cluster.batch import Arrays
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.work import tree_orders
from wdpm.cluster.work.photon_buffers import PositionsOf
from wdpm.cluster.work.photon_store import PhotonStore
from wdpm.kernels.photons import kd_order, photon_map
from wdpm.kernels.ray_fields import PLACES_A_RUN
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.passes import render_in_passes
from wdpm.scenes.errors import ProtocolError

RNG = np.random.default_rng(5)


def places(count: int) -> np.ndarray:
    """Some on a coarse lattice, so that many coordinates are equal."""
    return np.round(RNG.random((count, 3), np.float32), 1 + count % 3).astype(np.float32)


@pytest.mark.parametrize("counts", [(1,), (7, 0, 9), (100, 3), (1000, 4097), (8, 64, 65)])
@pytest.mark.parametrize("parts", [1, 2, 3, 8])
def test_parts_make_the_trees_of_one(counts: tuple[int, ...], parts: int) -> None:
    trees = [places(count) for count in counts]
    shares = [tree_orders.sort_part(trees, part, parts) for part in range(parts)]
    random.Random(parts).shuffle(shares)
    for position, order in zip(trees, tree_orders.joined(shares, counts), strict=True):
        known: dict[str, Any] = dict.fromkeys(("flux", "normal", "direction"), position)
        known |= {"position": position, "id": np.arange(len(position))}
        alone, shared = photon_map.build(**known), photon_map.build(**known, order=order)
        for name in ("nodes", "leaves", "flux", "rank"):
            np.testing.assert_array_equal(getattr(alone, name).numpy(), getattr(shared, name).numpy())


def test_parts_are_even() -> None:
    trees = [places(20_000), places(60_000)]
    sizes = [len(places_of(tree_orders.sort_part(trees, part, 7))) for part in range(7)]
    assert sum(sizes) == 80_000
    assert max(sizes) - min(sizes) <= 2 * kd_order.LEAF_SIZE


def places_of(order: Arrays) -> np.ndarray:
    """The places that a part of an order is of."""
    return (order["place"][:, None] + np.arange(PLACES_A_RUN))[order["items"] >= 0]


def part(place: list[int], item: list[int]) -> Arrays:
    """Items one by one."""
    items = np.full((len(item), PLACES_A_RUN), -1, np.int32)
    items[:, 0] = item
    return {"place": np.array(place, np.int32), "items": items}


@pytest.mark.parametrize(
    ("parts", "error"),
    [
        ([part([0, 1], [0, 1])], "the order of 2 places of trees came; expected one of 3"),
        ([part([0, 1, 3], [0, 1, 0])], "the order of 3 places of trees came; expected one of 3"),
        ([part([0, 1, 1], [0, 1, 1])], "the order of tree 1 that came leaves out 1 of 1 items"),
        ([part([0, 1], [1, 1]), part([2], [0])], "the order of tree 0 that came leaves out 1 of 2 items"),
        ([part([0, 1, 2], [0, 2, 0])], "the order of tree 0 that came leaves out 1 of 2 items"),
    ],
)
def test_an_order_that_is_none_is_refused(parts: list[Arrays], error: str) -> None:
    with pytest.raises(ProtocolError, match=error):
        tree_orders.joined(parts, (2, 1))


def test_few_places_are_sorted_by_each_alone() -> None:
    assert not tree_orders.worth_sharing((10**9,), 1)
    assert not tree_orders.worth_sharing((tree_orders.PLACES_A_PART, tree_orders.PLACES_A_PART - 1), 2)
    assert tree_orders.worth_sharing((tree_orders.PLACES_A_PART, tree_orders.PLACES_A_PART), 2)


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[Arrays]:
    """Sharing is worth it whatever the size; the parts that were sorted."""
    monkeypatch.setattr(tree_orders, "PLACES_A_PART", 1)
    seen: list[Arrays] = []
    original = PhotonStore.sort

    def recorded(store: PhotonStore, part: int, parts: int) -> Arrays | None:
        found = original(store, part, parts)
        if found is not None:
            seen.append(found)
        return found

    monkeypatch.setattr(PhotonStore, "sort", recorded)
    return seen


@pytest.mark.parametrize(
    ("workers", "cells", "team", "indirect"),
    [(3, 1, 1, Indirect.MAP), (3, 1, 1, Indirect.CACHE), (4, 2, 2, Indirect.CACHE)],
)
def test_an_image_keeps_its_bits(sent: list[Arrays], workers: int, cells: int, team: int, indirect: Indirect) -> None:
    scene = wdpm.load("cornell-box", size=(24, 24))
    chosen = RenderSettings(photons=3000, spp=1, k=20, indirect=indirect, bucket=8)
    shares = workers if indirect is Indirect.MAP else 0  # or each has a part of the map, or of the scene
    alone = render_in_passes(scene, InProcess(threads=1), chosen)
    assert not sent
    shuffle = random.Random(workers)
    with InProcess(threads=1, workers=workers, cells=cells, team=team, shuffle=shuffle) as backend:
        image = render_in_passes(scene, backend, chosen)
    assert without_cells(image).digest() == without_cells(alone).digest()
    assert len(sent) == shares
    if shares:
        places = [places_of(each) for each in sent]
        whole = np.sort(np.concatenate(places))
        np.testing.assert_array_equal(whole, np.arange(len(whole)))
        sizes = [len(each) for each in places]
        assert max(sizes) < 1.1 * min(sizes)


def test_an_order_is_of_photons_as_their_tree_is_built_of_them(
    sent: list[Arrays], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of photons in any other order it makes the same image, a hundred times as slowly."""
    original, sizes = PhotonStore._photon_tree, []

    def checked(store: PhotonStore, number: int, order: np.ndarray | None) -> Any:
        if order is not None and len(order):
            position = np.asarray(PositionsOf(store._own[number], store._numbered[number]))
            np.testing.assert_array_equal(order, kd_order.sort(position, 0, len(position)))
            sizes.append(len(position))
        return original(store, number, order)

    monkeypatch.setattr(PhotonStore, "_photon_tree", checked)
    scene = wdpm.load("cornell-box", size=(8, 8))
    chosen = RenderSettings(photons=12_000, spp=1, k=20, indirect=Indirect.MAP, bucket=8)
    with InProcess(threads=1, workers=3, cells=1, team=1, shuffle=random.Random(1)) as backend:
        render_in_passes(scene, backend, chosen)
    assert len(sent) == 3
    assert len(sizes) == 3
    assert min(sizes) > 10_000
