"""What is made once a machine: the second worker maps what the first has made, and the image keeps its bits."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from digests import without_cells
from shared_memory import memory_is_shared

import wdpm
from wdpm.cluster import host_cache
from wdpm.cluster.batch import Batch
from wdpm.cluster.host_cache import CacheEntry, HostCache, name_of
from wdpm.cluster.master import phases
from wdpm.cluster.plan.copies import Sharing
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.transport import host_share
from wdpm.cluster.transport.host_share import HostShare
from wdpm.cluster.work.worker import CellWorker
from wdpm.images.image import Image
from wdpm.kernels.launch import ONE_THREAD
from wdpm.progress import SilentProgress
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.prepare import Prepared, prepare

if_shared = pytest.mark.skipif(not memory_is_shared(), reason="this system lets processes share no memory")


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each thing was made, by its name."""
    counted: Counter[str] = Counter()
    original = host_cache._values_of

    def values_of(claim: Any, entry: CacheEntry) -> Any:
        def make() -> Any:
            counted[entry.name] += 1
            return entry.make()

        return original(claim, CacheEntry(entry.name, entry.kinds, make))

    monkeypatch.setattr(host_cache, "_values_of", values_of)
    return counted


def sharing(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Have all workers of a cluster in this process share what they make, as slaves of one folder do."""
    original = CellWorker.__init__

    def begin(worker: CellWorker, *args: Any) -> None:
        original(worker, *args, HostCache(HostShare(folder), "scene"))

    monkeypatch.setattr(CellWorker, "__init__", begin)


@if_shared
@pytest.mark.parametrize("indirect", list(Indirect))
def test_an_image_keeps_its_bits(
    indirect: Indirect, made: Counter[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = wdpm.load("cornell-box", size=(24, 24))
    chosen = RenderSettings(photons=3000, spp=2, passes=2, k=20, indirect=indirect, bucket=8)
    alone = render_in_passes(scene, InProcess(threads=1), chosen)
    assert not made
    sharing(monkeypatch, tmp_path)
    with InProcess(threads=1, workers=3, cells=1, team=1, shuffle=random.Random(3)) as backend:
        image = render_in_passes(scene, backend, chosen)
    assert without_cells(image).digest() == without_cells(alone).digest()
    kinds = {name.split()[0] for name in made}
    # Where the global map is read ahead alone, each has a part of it.
    assert kinds >= {
        "cell",
        "textures",
        *(("irradiance",) if indirect in (Indirect.GATHER, Indirect.CACHE) else ("map", "points")),
    }
    assert ("records" in kinds) == (indirect is Indirect.CACHE)
    pilots = {"cell 0", "textures"}  # made by the worker of the pilot too, which has ended when the others begin
    assert {name: times for name, times in made.items() if times > 1 + (name in pilots)} == {}


def prepared_for(folder: Path, *, team: int = 1) -> Prepared:
    """The Cornell box for two slaves of this machine."""
    chosen = RenderSettings(photons=500, spp=1, k=20, indirect=Indirect.MAP)
    scene, share = wdpm.load("cornell-box", size=(8, 8)), HostShare(folder)
    return prepare(scene, chosen, 2, ONE_THREAD, SilentProgress(), team=lambda _: Sharing(2, team), neighbours=share)


def slave_of(prepared: Prepared, folder: Path) -> CellWorker:
    session = prepared.session
    cache = HostCache(HostShare(folder), session.digest)
    return CellWorker(0, session.world, {0: session.partition(0)}, [0], ONE_THREAD, cache)


@if_shared
def test_slaves_map_what_the_pilot_was_flown_in(made: Counter[str], tmp_path: Path) -> None:
    """As long as the master has it; then one of them makes it for all."""
    prepared = prepared_for(tmp_path)
    assert made == {"cell 0": 1, "textures": 1}
    slaves = [slave_of(prepared, tmp_path) for _ in range(2)]
    assert made == {"cell 0": 1, "textures": 1}
    assert all(slave.replica.host_cache.found_some for slave in slaves)
    session = replace(prepared, lent=())
    del prepared, slaves
    assert not list(tmp_path.iterdir())
    anew = [slave_of(session, tmp_path) for _ in range(2)]
    assert made == {"cell 0": 2, "textures": 2}
    assert [slave.replica.host_cache.found_some for slave in anew] == [False, True]


@if_shared
@pytest.mark.parametrize(("team", "most"), [(2, 1 << 18), (1, 1)], ids=["divided", "large"])
def test_nothing_is_lent_of_divided_and_of_large_scenes(
    team: int, most: int, made: Counter[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wdpm.rendering.prepare.WORTH_FORGETTING", most)
    assert not prepared_for(tmp_path, team=team).lent
    assert not made


@if_shared
def test_slaves_of_a_divided_scene_share_textures_alone(made: Counter[str], tmp_path: Path) -> None:
    session = prepared_for(tmp_path, team=2).session
    held = {cell: session.partition(cell) for cell in range(2)}
    slaves = [
        CellWorker(
            number,
            session.world,
            {number: held[number]},
            [0, 1],
            ONE_THREAD,
            HostCache(HostShare(tmp_path), session.digest),
        )
        for number in range(2)
    ]
    assert made == {"textures": 1}
    texels = [slave.replica.textures.texel.numpy() for slave in slaves]
    assert np.array_equal(*texels)


class Photons:
    """Watches the photons that workers of a cluster in this process send each other, who share memory.

    Attributes:
        sent: how many each batch brought.
        borrowed: whether each search for photons where they lie found them.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, folder: Path, *, gone: Sequence[int] = ()) -> None:
        self.sent: list[int] = []
        self.borrowed: list[bool] = []
        sharing(monkeypatch, folder)
        monkeypatch.setattr(phases, "all_share_memory", lambda _: True)  # as where endpoints say that all share memory
        copies, borrow = CellWorker.copies, HostCache.borrow

        def watched_copies(worker: CellWorker, *told: Any) -> list[Batch]:
            batches = copies(worker, *told)
            self.sent += map(len, batches)
            return batches

        def watched_borrow(made: HostCache, name: str) -> Any:
            lost = any(f" of {number} of " in name for number in gone)
            found = None if lost else borrow(made, name)
            self.borrowed.append(found is not None)
            return found

        monkeypatch.setattr(CellWorker, "copies", watched_copies)
        monkeypatch.setattr(HostCache, "borrow", watched_borrow)


def of_two_kinds(workers: int) -> Image:
    """An image with photons of the global map and of the caustic map."""
    scene = wdpm.load("cornell-box", size=(16, 16))
    chosen = RenderSettings(photons=4000, caustic_photons=1000, spp=2, passes=2, k=20, indirect=Indirect.GATHER)
    with InProcess(threads=1, workers=workers, cells=1, team=1) as backend:
        return render_in_passes(scene, backend, chosen)


@if_shared
@pytest.mark.parametrize("gone", [(), (0,), (1, 2)], ids=str)
def test_photons_are_read_where_they_lie(gone: Sequence[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Or, where they are not to be had any more, traced anew, which no counter tells."""
    alone = of_two_kinds(workers=1)
    photons = Photons(monkeypatch, tmp_path, gone=gone)
    image = of_two_kinds(workers=3)
    assert without_cells(image).digest() == without_cells(alone).digest()
    # Who made all that the others had mapped by then knows of nobody who can map it, and sends his.
    assert photons.sent.count(0) == len(photons.borrowed) >= 2 * 2 * 2
    assert all(photons.borrowed) == (not gone)
    one, shared = alone.metadata["report"], image.metadata["report"]
    for kind in ("photons", "caustics"):
        assert shared[kind]["stored"] == one[kind]["stored"]
        assert shared[kind]["paths"] == one[kind]["paths"]
    for slave in shared["slaves"] if not gone else ():  # who has none of what is gone, and makes no map, knows less
        assert slave["photons"] + slave["copies"] == one["slaves"][0]["photons"]


@if_shared
def test_who_has_no_photons_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where nothing tells that others can map what lies here. They would trace every path for themselves."""
    photons = Photons(monkeypatch, tmp_path)
    monkeypatch.setattr(HostCache, "found_some", property(lambda _: False, lambda *_: None), raising=False)
    scene = wdpm.load("cornell-box", size=(8, 8))
    chosen = RenderSettings(photons=200, spp=1, k=20, indirect=Indirect.MAP)
    alone = render_in_passes(scene, InProcess(threads=1), chosen)
    with InProcess(threads=1, workers=3, cells=1, team=1) as backend:
        image = render_in_passes(scene, backend, chosen)
    assert photons.borrowed
    assert all(photons.borrowed)
    assert without_cells(image).digest() == without_cells(alone).digest()


@if_shared
def test_a_divided_scene_is_not_shared(made: Counter[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = wdpm.load("cornell-box", size=(8, 8))
    chosen = RenderSettings(photons=500, spp=1, k=20, indirect=Indirect.MAP, bucket=8)
    sharing(monkeypatch, tmp_path)
    with InProcess(threads=1, workers=2, cells=2, team=2) as backend:
        render_in_passes(scene, backend, chosen)
    # Of the pilot, which has the whole scene and has ended when the others begin; they have textures in common.
    assert made == {"cell 0": 1, "textures": 2}


def test_slaves_that_can_share_nothing_make_all_by_themselves_and_say_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(_: Any) -> Any:
        raise OSError("no memory is left for files")

    monkeypatch.setattr(host_share, "_sealed", forbidden)
    scene = wdpm.load("cornell-box", size=(8, 8))
    chosen = RenderSettings(photons=500, spp=1, k=20, indirect=Indirect.MAP, bucket=8)
    alone = render_in_passes(scene, InProcess(threads=1), chosen)
    assert not alone.metadata["report"]["warnings"]
    sharing(monkeypatch, tmp_path)
    with InProcess(threads=1, workers=2, cells=1, team=1) as backend:
        image = render_in_passes(scene, backend, chosen)
    (warning,) = image.metadata["report"]["warnings"]
    assert warning.startswith("2 slaves could not share trees and maps")
    assert without_cells(image).digest() == without_cells(alone).digest()


@if_shared
def test_who_computes_on_a_device_takes_part_in_nothing_but_the_rules(tmp_path: Path) -> None:
    """All slaves must agree on whether they sort trees for each other."""
    here, device = (
        HostCache(HostShare(tmp_path), "scene"),
        HostCache(HostShare(tmp_path), "scene", in_main_memory=False),
    )
    assert here.is_shared
    assert device.is_shared
    first = here.get(table(1.0))
    assert device.get(table(2.0))[0]["x"].tolist() == [2.0] * 3
    assert first[0]["x"].tolist() == [1.0] * 3


@if_shared
def test_who_computes_on_a_device_and_has_nothing_to_lend_says_so_too(tmp_path: Path) -> None:
    device = HostCache(HostShare(tmp_path), "scene", in_main_memory=False)
    device.found_some = True
    assert device.lend("photons", lambda: {"x": np.ones(3)}) is None
    kept = device.lend("photons", dict, surely=True)
    assert HostCache(HostShare(tmp_path), "scene").borrow("photons") == {}
    assert kept is not None


def table(value: float) -> CacheEntry:
    return CacheEntry("table", (dict,), lambda: [{"x": np.full(3, value)}])


def test_where_nobody_shares_each_makes_his_own() -> None:
    for own in (HostCache(), HostCache(None, "scene"), HostCache(HostShare(Path("/nowhere")), "")):
        assert not own.is_shared
        assert own.get(table(2.0))[0]["x"].tolist() == [2.0] * 3


@if_shared
def test_other_scenes_are_others(tmp_path: Path) -> None:
    one, same, other = (HostCache(HostShare(tmp_path), name) for name in ("a", "a", "b"))
    first = one.get(table(1.0))
    assert same.get(table(2.0))[0]["x"].tolist() == [1.0] * 3
    assert other.get(table(3.0))[0]["x"].tolist() == [3.0] * 3
    assert first[0]["x"].tolist() == [1.0] * 3


@if_shared
def test_bytes_that_are_something_else_are_made_anew(tmp_path: Path) -> None:
    """Of a process that says what is not so: it costs time alone."""
    share = HostShare(tmp_path)
    with share.claim("scene table") as claim:
        assert claim is not None
        kept = claim.publish([memoryview(b"{}" * 40)])
    assert HostCache(share, "scene").get(table(5.0))[0]["x"].tolist() == [5.0] * 3
    assert kept is not None


class Recorded:
    """Says who was asked for, and in which order; somebody else is at the second."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, bool]] = []

    @contextmanager
    def claim(self, name: str, *, wait: bool = True) -> Iterator[Any]:
        self.asked.append((name, wait))
        busy = name.endswith("1") and not wait
        yield None if busy else Empty()


class Empty:
    found = None

    def publish(self, parts: Any) -> None:
        del parts


def test_what_others_are_at_comes_last() -> None:
    share = Recorded()
    entries = [CacheEntry(str(i), (dict,), lambda i=i: [{"i": np.array([i])}]) for i in range(3)]
    got = HostCache(share, "s").get_all(entries, first=1)
    assert [int(value["i"][0]) for (value,) in got] == [0, 1, 2]
    assert share.asked == [("s 1", False), ("s 2", False), ("s 0", False), ("s 1", True)]


def test_names_tell_arrays_apart() -> None:
    x = np.arange(6, dtype=np.float32)
    others = [{"x": x}, {"y": x}, {"x": x.astype(np.float64)}, {"x": x.reshape(2, 3)}, {"x": x + 1}, {"x": x, "y": x}]
    assert len({name_of(arrays) for arrays in others}) == len(others)
    assert name_of({"x": x}) == name_of({"x": x.copy()})
