"""Buffers of photons: they grow without copies, and a tree is built of one in little more memory than it takes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from wdpm.cluster.batch import Arrays, Kind
from wdpm.cluster.work import photon_buffers
from wdpm.cluster.work.photon_buffers import PHOTON_COLUMNS, ColumnBuffer, MapBuffers, Numbered, PositionsOf
from wdpm.kernels import pages
from wdpm.kernels.limits import MAPS
from wdpm.kernels.photons import kd_order, photon_map
from wdpm.scenes.errors import WdpmError


def photons(count: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Stored photons of all maps, as a batch brings them, with ids in no order."""
    rng = np.random.default_rng(seed)
    vectors = {name: rng.random((count, 3), np.float32) for name in ("position", "flux", "normal", "direction")}
    return {
        "id": rng.permutation(3 * count)[:count].astype(np.int64),
        "edges": rng.integers(1, 9, count).astype(np.int32),
        "front": rng.integers(0, 2, count).astype(np.int32),
        "map": rng.integers(0, MAPS, count).astype(np.int32),
        **vectors,
    }


def by_id(arrays: Arrays) -> dict[str, np.ndarray]:
    order = np.argsort(arrays["id"])
    return {name: column[order] for name, column in arrays.items()}


@pytest.fixture(params=[7, 64, photon_buffers.CHUNK])
def _chunks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Chunks of so many photons."""
    monkeypatch.setattr(photon_buffers, "CHUNK", request.param)


@pytest.mark.usefixtures("_chunks")
def test_what_was_added_is_there() -> None:
    own, others, every = MapBuffers(Kind.GHOST_PHOTONS), MapBuffers(Kind.GHOST_PHOTONS), photons(200)
    for begin, end in ((0, 1), (1, 1), (1, 90), (90, 150)):
        own.add({name: column[begin:end] for name, column in every.items()})
    others.add({name: column[150:170] for name, column in every.items()})
    own.join(others)
    own.add({name: column[170:] for name, column in every.items()})
    assert sum(len(own[number]) for number in range(MAPS)) == 200
    assert sum(len(others[number]) for number in range(MAPS)) == 0
    whole, expected = by_id(own.whole()), by_id(every)
    for name, column in expected.items():
        assert whole[name].dtype == column.dtype
        np.testing.assert_array_equal(whole[name], column)
    found = own.chosen(lambda number, columns: np.flatnonzero(columns["position"][:, 0] < 0.5 * number))
    rows = np.flatnonzero(every["position"][:, 0] < 0.5 * every["map"])
    np.testing.assert_array_equal(np.sort(found["id"]), np.sort(every["id"][rows]))


@pytest.mark.usefixtures("_chunks")
def test_what_others_lend_is_read_where_it_lies_among_what_was_added() -> None:
    every, lender, borrower = photons(200), MapBuffers(Kind.GHOST_PHOTONS), MapBuffers(Kind.GHOST_PHOTONS)
    lender.add({name: column[50:120] for name, column in every.items()})
    lent = lender.columns()
    for column in lent.values():
        column.flags.writeable = False
    borrower.add({name: column[:50] for name, column in every.items()})
    counts = borrower.borrow(lent)
    borrower.add({name: column[120:] for name, column in every.items()})
    assert counts.tolist() == np.bincount(every["map"][50:120], minlength=MAPS).tolist()
    whole = by_id(borrower.whole())
    assert all(np.array_equal(whole[name], column) for name, column in by_id(every).items())
    assert any(np.shares_memory(chunk["id"], lent["0 id"]) for chunk in borrower[0].peek())


@pytest.mark.parametrize("wrong", ["0 id", "0 flux", "9 id", "x id", "id"])
def test_what_is_lent_must_be_like_photons(wrong: str) -> None:
    lender, borrower = MapBuffers(Kind.GHOST_PHOTONS), MapBuffers(Kind.GHOST_PHOTONS)
    lender.add(photons(40))
    with pytest.raises(ValueError, match=r"map|columns|invalid literal"):
        borrower.borrow({**lender.columns(), wrong: np.zeros(3, np.uint8)})


@pytest.mark.usefixtures("_chunks")
def test_a_photon_that_is_stored_takes_61_bytes() -> None:
    buffers = MapBuffers(Kind.GHOST_PHOTONS)
    buffers.add(photons(100))
    assert buffers.nbytes == 100 * 61
    assert buffers.nbytes == sum(buffers[number].nbytes for number in range(MAPS))
    buffers.clear()
    assert buffers.nbytes == 0


@pytest.mark.usefixtures("_chunks")
def test_photons_are_numbered_by_their_ids() -> None:
    buffer, every = ColumnBuffer(PHOTON_COLUMNS), photons(150)
    buffer.add(every)
    numbered = Numbered(buffer)
    expected = by_id(every)
    np.testing.assert_array_equal(numbered.edges, expected["edges"])
    np.testing.assert_array_equal(np.asarray(PositionsOf(buffer, numbered)), expected["position"])
    np.testing.assert_array_equal(np.asarray(PositionsOf(buffer)), every["position"])
    buffer = ColumnBuffer(PHOTON_COLUMNS)
    buffer.add({**every, "id": np.where(every["id"] == every["id"].max(), every["id"].min(), every["id"])})
    with pytest.raises(WdpmError, match=f"photon id {every['id'].min()} comes twice"):
        Numbered(buffer)


@pytest.mark.usefixtures("_chunks")
@pytest.mark.parametrize("count", [0, 1, 8, 65, 600, 5000])
def test_a_tree_of_parts_is_that_of_the_whole(count: int) -> None:
    buffer, every = ColumnBuffer(PHOTON_COLUMNS), photons(count)
    buffer.add(every)
    numbered = Numbered(buffer)
    found = photon_map.build_of(buffer, numbered.ranks)
    expected = photon_map.build(**{name: every[name] for name in ("position", "flux", "normal", "direction", "id")})
    places = len(expected.rank)
    # Photons may stand in any order within a leaf: that depends on the order in which they come to the splits.
    order = [
        np.lexsort((tree.rank.numpy(), np.arange(places) // 8, np.arange(places) >= count))
        for tree in (found, expected)
    ]
    for name in ("rank", "flux"):
        mine, theirs = (getattr(tree, name).numpy()[rows] for tree, rows in zip((found, expected), order, strict=True))
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_array_equal(found.nodes.numpy(), expected.nodes.numpy())
    rows = np.moveaxis(found.leaves.numpy().reshape(-1, 9, 8), 1, 2).reshape(-1, 9)[:count]
    ids = by_id(every)
    mine = np.concatenate([ids[name] for name in ("position", "normal", "direction")], axis=1)
    np.testing.assert_array_equal(rows, mine[found.rank.numpy()[:count]])


class Ledger:
    """Counts the bytes of what photons lie in until a tree has them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = self.most = 0
        ledger = self

        class Counted(pages.Pages):
            def __init__(self, count: int, dtype: Any, width: int = 1) -> None:
                super().__init__(count, dtype, width)
                self._held = self.array.nbytes
                ledger.add(self._held)

            def release(self, begin: int, end: int) -> None:
                super().release(begin, end)
                given = (end - begin) * self._item
                self._held -= given
                ledger.add(-given)

            def __del__(self) -> None:
                ledger.add(-self._held)

        for module in (pages, photon_buffers, photon_map, kd_order):
            monkeypatch.setattr(module, "Pages", Counted)

    def add(self, size: int) -> None:
        self.now += size
        self.most = max(self.most, self.now)


def nbytes(tree: Any) -> int:
    """Of all arrays of a tree."""
    return sum(array.capacity for array in (tree.nodes, tree.leaves, tree.flux, tree.rank))


@pytest.mark.parametrize("count", [4097, 40_000, 65_536])
def test_a_photon_takes_at_most_64_bytes_with_its_tree(count: int) -> None:
    every = photons(count)
    tree = photon_map.build(**{name: every[name] for name in ("position", "flux", "normal", "direction", "id")})
    assert nbytes(tree) + 4 * count < 64 * count  # and the length of its path
    points = photon_map.build_points(photon_map.WholeParts({name: every[name] for name in ("position", "normal")}))
    assert nbytes(points) < 28 * count


def test_a_tree_is_built_in_little_more_than_its_photons_take(monkeypatch: pytest.MonkeyPatch) -> None:
    count = 1 << 16
    monkeypatch.setattr(photon_buffers, "CHUNK", 1 << 10)
    monkeypatch.setattr(photon_map, "PARENTS_A_PIECE", 1 << 4)
    ledger = Ledger(monkeypatch)
    buffer = ColumnBuffer(PHOTON_COLUMNS)
    buffer.add(photons(count))
    assert ledger.now == 61 * count
    numbered = Numbered(buffer)
    assert ledger.now == 48 * count  # 8 more for the ranks and the lengths of paths
    at_leaves = []
    original = photon_map._Tree._lay_out

    def watched(*arguments: Any) -> None:
        at_leaves.append(ledger.now)
        original(*arguments)
        at_leaves.append(ledger.now)

    monkeypatch.setattr(photon_map._Tree, "_lay_out", watched)
    photon_map.build_of(buffer, numbered.ranks)
    assert ledger.most <= 64 * count
    assert at_leaves == [40 * count, 0]  # what leaves are written from, and that none of it is left then
