"""The exactness contract of final gathering and of the irradiance cache: the same bits, whatever computes them."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import effect_scenes
import numpy as np
import pytest
from digests import alone, same_bits
from furnaces import box, quad, scene, view
from watched_batches import watch_batches

import wdpm
from wdpm.cluster.batch import Kind
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import machine
from wdpm.cluster.plan import view as view_plan
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.records import CachePlan, Records, equal
from wdpm.cluster.render_settings import Indirect, RenderSettings, Routing
from wdpm.cluster.work.worker import CellWorker
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process
from wdpm.report.report import EnergyLedger
from wdpm.scenes import cornell_box
from wdpm.scenes.model.bsdfs import Diffuse, TwoSided
from wdpm.scenes.model.scene import Scene

FEW = RenderSettings(
    indirect=Indirect.GATHER,
    photons=2000,
    caustic_photons=1000,
    volume_photons=2000,
    spp=2,
    k=20,
    caustic_k=10,
    all_effects=True,
)
WAYS = (Indirect.GATHER, Indirect.CACHE)


def everything() -> Scene:
    """Nearly all effects where there are records: walls without bumps, seen through no window."""
    scene = effect_scenes.everything()
    plain = TwoSided(Diffuse(effect_scenes.NOISE))
    materials = tuple(replace(m, bsdf=plain) if m.name == "walls" else m for m in scene.materials)
    return replace(scene, materials=materials, meshes=tuple(mesh for mesh in scene.meshes if mesh.name != "window"))


SCENES = {
    "diffuse": cornell_box((33, 26)),
    "coats": effect_scenes.coats(),
    "panes": effect_scenes.panes(),
    "fogs": effect_scenes.fogs(),
    "everything": everything(),
}
"""Metals and glass are in `everything`, whose kernels all of these have; what has no records besides is by itself."""

SMALL_CACHE = CachePlan(
    rounds=4, spacing=8, rows=3, columns=8, error=0.3, least=1.0, most=6.0, wanted=0.3, tolerance=0.05
)
"""Of images of a few hundred pixels: the candidates of its last round are all pixels that are left."""

_alone: dict[tuple[str, Indirect], Image] = {}


@pytest.fixture(autouse=True)
def _small_plans(small_pilot: None) -> Iterator[None]:  # noqa: ARG001
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(view_plan, "CACHE_PLAN", SMALL_CACHE)
        yield


@pytest.fixture
def tasks_of_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounds of several tasks, as large images have them."""
    monkeypatch.setattr(machine, "ClusterLimits", lambda: ClusterLimits(record_task_least=37, record_task_most=37))


@pytest.fixture(params=list(SCENES))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(params=WAYS, ids=lambda way: way.value)
def way(request: pytest.FixtureRequest) -> Indirect:
    return Indirect(request.param)


def reference(name: str, way: Indirect) -> Image:
    """The image of one cell, one thread and one bucket; the same for all tests of a scene."""
    if (name, way) not in _alone:
        _alone[name, way] = alone(SCENES[name], replace(FEW, indirect=way))
    return _alone[name, way]


@pytest.fixture
def published(monkeypatch: pytest.MonkeyPatch) -> list[Records]:
    """The records that workers are sent from now on, as they are sent."""
    seen: list[Records] = []
    set_records = CellWorker.set_records

    def noted(worker: CellWorker, records: Records) -> None:
        seen.append(records)
        set_records(worker, records)

    monkeypatch.setattr(CellWorker, "set_records", noted)
    return seen


def of_last_round(published: list[Records]) -> Records:
    """The records that the image was made with."""
    return max(published, key=len)


def test_light_is_found_by_it(name: str, way: Indirect) -> None:
    """The equality of black images would say nothing, and that of two ways that are the same neither."""
    image, report = reference(name, way), reference(name, way).metadata["report"]
    assert report["nonfinite"] == {}
    assert EnergyLedger(**report["energy"]).imbalance < 1e-5
    assert np.count_nonzero(image.layers["indirect"].any(axis=2)) > 20
    by_map = reference(name, Indirect.MAP)
    assert not np.array_equal(image.layers["indirect"], by_map.layers["indirect"])
    np.testing.assert_array_equal(image.layers["depth"], by_map.layers["depth"])
    if way is Indirect.CACHE:
        # There are records behind a window, too: something is interpolated everywhere.
        assert not same_bits(image, reference(name, Indirect.GATHER))


@pytest.mark.parametrize(
    ("cells", "workers", "threads", "bucket", "routing"),
    [(4, 3, 3, 5, Routing.FORWARD), (8, 5, 1, 7, Routing.MERGE)],
    ids=["4", "8"],
)
@pytest.mark.usefixtures("tasks_of_few")
def test_partition_threads_buckets_and_order_change_no_bit(
    name: str, way: Indirect, cells: int, workers: int, threads: int, bucket: int, routing: Routing
) -> None:
    chosen = replace(FEW, indirect=way, routing=routing, bucket=bucket)
    order = random.Random(cells)
    image = render_in_process(SCENES[name], chosen, workers=workers, cells=cells, threads=threads, shuffle=order)
    assert same_bits(image, reference(name, way))
    assert len(np.unique(image.layers["cell"])) > 1


@pytest.mark.usefixtures("tasks_of_few")
def test_records_are_the_same_in_any_order(published: list[Records]) -> None:
    """Not only what is seen of them: every bit of every record, and how many each round added."""
    chosen = replace(FEW, indirect=Indirect.CACHE)
    alone(SCENES["everything"], chosen)
    expected = of_last_round(published)
    rounds = sorted({len(records) for records in published})
    assert len(expected) > 20
    assert len(rounds) > 2  # of several rounds something was added
    for workers, cells in ((3, 8), (5, 8), (4, 4)):
        published.clear()
        order = random.Random(workers)
        render_in_process(SCENES["everything"], chosen, workers=workers, cells=cells, threads=2, shuffle=order)
        assert equal(of_last_round(published), expected)
        assert sorted({len(records) for records in published}) == rounds


def test_each_worker_keeps_the_records_that_reach_it(published: list[Records], monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer than all, or the band of records would be the whole scene; and more than their number together."""
    kept: list[int] = []
    statistics = CellWorker.statistics

    def noted(worker: CellWorker) -> dict[str, Any]:
        kept.append(int(statistics(worker)["records"]))
        return statistics(worker)

    monkeypatch.setattr(CellWorker, "statistics", noted)
    render_in_process(SCENES["diffuse"], replace(FEW, indirect=Indirect.CACHE), workers=4, cells=4)
    whole = len(of_last_round(published))
    assert len(kept) == 4
    assert min(kept) < whole
    assert sum(kept) >= whole


@pytest.mark.own_kernels
@pytest.mark.parametrize("name", ["diffuse", "coats", "fogs"])
def test_kernels_for_few_effects_give_the_same_bits(name: str, way: Indirect) -> None:
    few = replace(FEW, indirect=way, all_effects=False)
    image = render_in_process(SCENES[name], few, workers=2, cells=4, threads=2, shuffle=random.Random(1))
    assert same_bits(image, reference(name, way))


@pytest.mark.parametrize(
    ("way", "change"),
    [
        (Indirect.GATHER, {"light_samples": 2, "seed": 99}),
        (Indirect.CACHE, {"max_depth": 3, "k": 5}),
        (Indirect.CACHE, {"max_depth": 12}),
        (Indirect.CACHE, {"passes": 2}),
    ],
)
def test_every_setting_gives_the_same_bits(way: Indirect, change: dict[str, Any]) -> None:
    chosen, scene = replace(FEW, indirect=way, **change), SCENES["everything"]
    expected = alone(scene, chosen)
    assert not same_bits(expected, reference("everything", way))
    image = render_in_process(scene, chosen, workers=3, cells=8, threads=2, shuffle=random.Random(3))
    assert same_bits(image, expected)


def test_processes_change_no_bit(way: Indirect, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = reference("everything", way)
    monkeypatch.setattr("wdpm.rendering.in_process.WORTH_FORKING", 0)
    chosen = replace(FEW, indirect=way, passes=1)
    assert same_bits(render_in_process(SCENES["everything"], chosen, workers=1, threads=3), expected)


def test_small_waves_and_launches_change_no_bit(way: Indirect, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = reference("everything", way)
    monkeypatch.setattr("wdpm.cluster.work.bucket_home.WAVE_SAMPLES", 50)
    monkeypatch.setattr("wdpm.cluster.work.records.record_home.GRAIN", 1)
    monkeypatch.setattr("wdpm.cluster.work.records.extra_rays.GRAIN", 1)
    monkeypatch.setattr("wdpm.cluster.work.photon_store.GATHER_GRAIN", 1)
    monkeypatch.setattr("wdpm.cluster.work.photon_store.GATHER_RUN", 3)
    chosen = replace(FEW, indirect=way)
    assert same_bits(render_in_process(SCENES["everything"], chosen, workers=2, cells=4, threads=3), expected)


@pytest.mark.parametrize(
    ("name", "way"), [("everything", Indirect.GATHER), ("everything", Indirect.CACHE), ("fogs", Indirect.CACHE)]
)
@pytest.mark.usefixtures("tasks_of_few")
def test_every_batch_is_valid_and_no_credit_is_lost_or_made(
    name: str, way: Indirect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kinds: set[Kind] = set()
    watch_batches(monkeypatch, lambda batch: kinds.add(batch.kind))
    for routing in Routing:
        chosen = replace(FEW, indirect=way, spp=3, routing=routing)
        render_in_process(SCENES[name], chosen, workers=2, cells=4)
    assert Kind.VERTEX in kinds
    assert ({Kind.CANDIDATE, Kind.CANDIDATE_HIT, Kind.RECORD_SITES} <= kinds) == (way is Indirect.CACHE)


@pytest.mark.sockets
def test_two_slaves_over_sockets_give_the_same_bits() -> None:
    """Each picture begins without the records of the one before, which would serve its candidates."""
    pictures = [(name, way, routing) for name in ("diffuse", "everything") for routing in Routing for way in WAYS]
    with wdpm.Cluster.local(slaves=2, copies=Copies.NONE) as cluster:
        for name, way, routing in pictures:
            image = cluster.render(SCENES[name], replace(FEW, indirect=way, routing=routing))
            assert same_bits(image, reference(name, way))
            assert sum(slave["rays_in"] for slave in image.metadata["report"]["slaves"]) > 0


def sheets_in_a_box() -> Scene:
    """Sheets that divide a floor, and a lamp behind one of them."""
    sheets = [
        quad((0, -0.5, -0.5), (0, 1, 0), (0, 0, 0.6)),
        quad((-0.5, -0.5, 0.1), (0.25, 0, 0.2), (0, 0.6, 0)),
        quad((0.3, -0.5, -0.5), (0, 0.7, 0), (0.1, 0, 0.5)),
    ]
    lamp = quad((-0.6, 0.49, -0.1), (0.2, 0, 0), (0, 0, 0.2), emission=(9.0,) * 3)
    seen = view((0.8, 0.1, 0.2), (0.0, -0.4, -0.2), 70, size=16)
    return scene([box((1.0, 0.5, 0.5), inside=True), *sheets, lamp], seen, (0.5,) * 3)


@pytest.mark.parametrize("cells", [8, 32])
def test_walls_outside_of_a_cell_are_felt_in_it(way: Indirect, cells: int) -> None:
    """Without the triangles of its band a cell tells other irradiance at photons near its border."""
    settings = RenderSettings(indirect=way, photons=3000, spp=2)
    whole = render_in_process(sheets_in_a_box(), settings, workers=1, cells=1, threads=1)
    assert same_bits(render_in_process(sheets_in_a_box(), settings, workers=2, cells=cells, threads=1), whole)
