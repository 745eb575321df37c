"""The exactness contract with materials, lights, cameras and media: in any partition, and whatever kernels are for."""

from __future__ import annotations

import random
from dataclasses import dataclass, replace
from typing import Any

import effect_scenes
import numpy as np
import pytest
from digests import alone, same_bits
from watched_batches import watch_batches

import wdpm
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.render_settings import RenderSettings, Routing
from wdpm.cluster.work.replica import with_camera
from wdpm.images.image import Image
from wdpm.kernels.features import ALL
from wdpm.rendering.in_process import render_in_process
from wdpm.report.report import EnergyLedger
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import Scene

pytestmark = pytest.mark.usefixtures("small_pilot")

FEW = RenderSettings(
    photons=2000, caustic_photons=1000, caustic_radius=0.5, volume_photons=2000, spp=2, k=20, caustic_k=10
)


@dataclass(frozen=True)
class Case:
    """A scene, what kernels it must call for, and in which layers its effects must show."""

    scene: Scene
    features: frozenset[str]
    layers: frozenset[str] = frozenset({"direct", "indirect", "caustic"})


def case(scene: Scene, features: str, layers: str = "direct indirect caustic") -> Case:
    return Case(scene, frozenset(features.split()), frozenset(layers.split()))


CASES = {
    "metals": case(effect_scenes.metals(), "conductor rough bitmaps textured_lights lens"),
    "glasses": case(effect_scenes.glasses(), "dielectric rough bitmaps points spots textured_lights"),
    "coats": case(
        effect_scenes.coats(),
        "conductor plastic principled rough blend bent bitmaps checkerboards vertex_colors environment",
    ),
    "panes": case(
        effect_scenes.panes(),
        "conductor thin_dielectric translucent rough_pane blend passing bitmaps directionals environment orthographic",
    ),
    "fogs": case(effect_scenes.fogs(), "dielectric passing points media", "direct indirect caustic volume"),
    "everything": case(
        effect_scenes.everything(),
        # settings ask for two of them; test_exactness_instances has the third
        " ".join(name for name in ALL.names() if name not in ("orthographic", "traced", "instances")),
        "direct indirect caustic volume",
    ),
}

OWN = [pytest.param(name, marks=pytest.mark.own_kernels) for name in CASES if name != "everything"]
"""The scene of all effects is rendered with the kernels that have all, in place of nearly all."""

_alone: dict[str, Image] = {}


@pytest.fixture(params=[*OWN, "everything"])
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def reference(name: str) -> Image:
    """The image of one cell, one thread and one bucket; the same for all tests of a scene."""
    if name not in _alone:
        _alone[name] = alone(CASES[name].scene, FEW)
    return _alone[name]


def test_scenes_call_for_what_they_are_here_for(name: str, reference: Image) -> None:
    flat = flatten(CASES[name].scene)
    assert set(with_camera(features_of(flat, FEW), flat.camera).names()) == CASES[name].features
    report = reference.metadata["report"]
    assert report["nonfinite"] == {}
    assert EnergyLedger(**report["energy"]).imbalance < 1e-5
    for layer in CASES[name].layers:
        assert np.count_nonzero(reference.layers[layer].any(axis=2)) > 10, layer
    assert ("volume" in reference.layers) == ("volume" in CASES[name].layers)
    assert report["caustics"]["stored"] > 50


@pytest.mark.parametrize(
    ("cells", "workers", "threads", "bucket", "routing"),
    [(2, 1, 1, 32, Routing.FORWARD), (4, 3, 3, 5, Routing.MERGE), (8, 2, 1, 7, Routing.FORWARD)],
    ids=["2", "4", "8"],
)
def test_partition_threads_buckets_and_order_change_no_bit(
    name: str, reference: Image, cells: int, workers: int, threads: int, bucket: int, routing: Routing
) -> None:
    chosen = replace(FEW, routing=routing, bucket=bucket)
    order = random.Random(cells) if cells > 2 else None
    image = render_in_process(CASES[name].scene, chosen, workers=workers, cells=cells, threads=threads, shuffle=order)
    assert same_bits(image, reference)
    if cells == 8:  # of fewer, one may have all that the camera sees
        assert len(np.unique(image.layers["cell"])) > 1
    for of_map in ("photons", "caustics", "volume"):
        assert image.metadata["report"][of_map] == reference.metadata["report"][of_map]


@pytest.mark.parametrize("name", [pytest.param("coats", marks=pytest.mark.own_kernels), "everything"])
@pytest.mark.parametrize("worth_forking", [0, 1 << 16], ids=["processes", "threads"])
def test_threads_change_no_bit_in_one_cell(
    name: str, reference: Image, worth_forking: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wdpm.rendering.in_process.WORTH_FORKING", worth_forking)
    image = render_in_process(CASES[name].scene, replace(FEW, bucket=9), workers=1, cells=1, threads=3)
    assert same_bits(image, reference)


@pytest.mark.parametrize("name", OWN)
def test_kernels_with_all_effects_give_the_same_bits(name: str, reference: Image) -> None:
    every = replace(FEW, all_effects=True)
    image = render_in_process(CASES[name].scene, every, workers=2, cells=4, threads=2, shuffle=random.Random(1))
    assert same_bits(image, reference)


@pytest.mark.parametrize("change", [{"light_samples": 2}, {"max_depth": 3}, {"seed": 99}, {"caustic_photons": 0}])
def test_every_setting_gives_the_same_bits(change: dict[str, Any]) -> None:
    chosen, scene = replace(FEW, **change), CASES["everything"].scene
    expected = alone(scene, chosen)
    assert ("caustic" in expected.layers) == (chosen.caustic_photons > 0)
    image = render_in_process(scene, chosen, workers=3, cells=8, threads=2, shuffle=random.Random(3))
    assert same_bits(image, expected)


@pytest.mark.parametrize("name", ["everything"])
def test_small_waves_and_full_photon_regions_change_no_bit(
    name: str, reference: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wdpm.cluster.work.bucket_home.WAVE_SAMPLES", 50)
    monkeypatch.setattr("wdpm.cluster.work.photon_paths.DEPOSITS_A_PATH", 1)
    monkeypatch.setattr("wdpm.cluster.work.photon_paths.LEAST_DEPOSITS", 1)
    monkeypatch.setattr("wdpm.cluster.work.photon_gathers.GATHER_GRAIN", 1)
    monkeypatch.setattr("wdpm.cluster.work.photon_gathers.GATHER_RUN", 3)
    assert same_bits(render_in_process(CASES[name].scene, FEW, workers=2, cells=4, threads=3), reference)


@pytest.mark.parametrize("routing", list(Routing))
def test_every_batch_carries_credit_and_none_is_lost_or_made(routing: Routing, monkeypatch: pytest.MonkeyPatch) -> None:
    watch_batches(monkeypatch)
    render_in_process(CASES["everything"].scene, replace(FEW, spp=1, routing=routing), workers=2, cells=4)


@pytest.mark.sockets
@pytest.mark.parametrize("name", ["everything"])
def test_two_slaves_over_sockets_give_the_same_bits(name: str, reference: Image) -> None:
    with wdpm.Cluster.local(slaves=2, copies=Copies.NONE) as cluster:
        for routing in Routing:
            image = cluster.render(CASES[name].scene, replace(FEW, routing=routing, all_effects=True))
            assert same_bits(image, reference)
        assert sum(slave["rays_in"] for slave in image.metadata["report"]["slaves"]) > 0
