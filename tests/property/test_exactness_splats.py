"""Samples that count in several pixels: the same bits wherever buckets, waves, cells and threads end."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import effect_scenes
import numpy as np
import pytest
from digests import alone, same_bits

import wdpm
from wdpm.cluster import allotment
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings, Routing
from wdpm.cluster.work import bucket_home
from wdpm.cluster.work.whole.samples import WholeSamples
from wdpm.rendering import prepare
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box
from wdpm.scenes.model.scene import FilterKind, PixelFilter, Scene

TENT = PixelFilter(FilterKind.TENT, 1.0)
GAUSSIAN = PixelFilter(FilterKind.GAUSSIAN, 2.0, 0.5)
LANCZOS = PixelFilter(FilterKind.LANCZOS, 3.0)


def through(pixel_filter: PixelFilter, scene: Scene) -> Scene:
    return replace(scene, camera=replace(scene.camera, filter=pixel_filter))


PATH = RenderSettings(integrator=Integrator.PATH, spp=5, light_samples=2)
MAP = RenderSettings(
    integrator=Integrator.PHOTONS,
    indirect=Indirect.MAP,
    spp=8,
    light_samples=2,
    photons=1500,
    k=15,
    caustic_photons=700,
    caustic_k=12,
    volume_photons=1500,
    volume_samples=2,
    all_effects=True,
)
CASES = {
    "tent": (through(TENT, cornell_box((16, 12))), PATH),
    "gaussian": (through(GAUSSIAN, cornell_box((16, 12))), PATH),
    "lanczos, caustics": (through(LANCZOS, effect_scenes.coats()), MAP),
    "gaussian, fog": (through(GAUSSIAN, effect_scenes.fogs()), MAP),
}


@pytest.fixture(params=list(CASES))
def case(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> tuple[Scene, RenderSettings]:
    """With photons, 1 of 4 samples asks the caustic map for all."""
    choose = prepare.choose_settings
    monkeypatch.setattr(prepare, "choose_settings", lambda *given: replace(choose(*given), caustic_share=4))
    return CASES[str(request.param)]


def test_no_bucket_or_wave_changes_a_bit(case: tuple[Scene, RenderSettings], monkeypatch: pytest.MonkeyPatch) -> None:
    scene, chosen = case
    expected = alone(scene, chosen)
    for bucket, wave in ((3, 7), (5, 100)):
        monkeypatch.setattr(bucket_home, "WAVE_SAMPLES", wave)
        assert (
            render_in_process(scene, replace(chosen, bucket=bucket), workers=1, threads=3).digest() == expected.digest()
        )
    monkeypatch.setattr(WholeSamples, "can_be", False)
    assert render_in_process(scene, replace(chosen, bucket=7), workers=1, threads=1).digest() == expected.digest()


def test_no_partition_or_order_changes_a_bit(case: tuple[Scene, RenderSettings]) -> None:
    scene, chosen = case
    expected = alone(scene, chosen)
    for workers, cells, routing in ((1, 2, Routing.FORWARD), (2, 4, Routing.MERGE)):
        some = replace(chosen, routing=routing, bucket=6)
        order = random.Random(cells)
        assert same_bits(render_in_process(scene, some, workers=workers, cells=cells, shuffle=order), expected)


def test_processes_and_sockets_give_the_same_bits() -> None:
    scene, chosen = CASES["gaussian"]
    with wdpm.Cluster.local(slaves=2, threads=1) as cluster:
        together = cluster.render(scene, chosen)
    assert same_bits(together, alone(scene, chosen))


def test_pixels_that_take_other_numbers_of_samples_give_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(allotment, "UNSEEN_NOISE", 0.0)
    monkeypatch.setattr(allotment, "LEAST_WORTH", math.inf)
    scene = through(TENT, cornell_box((48, 40)))
    chosen = replace(PATH, integrator=Integrator.AUTO, spp=4)
    expected = alone(scene, chosen)
    assert any("samples a pixel, by the noise" in line for line in expected.metadata["report"]["chose"])
    some = replace(chosen, bucket=13)
    assert same_bits(render_in_process(scene, some, workers=2, cells=2, shuffle=random.Random(1)), expected)


@pytest.mark.parametrize("pixel_filter", [TENT, GAUSSIAN, LANCZOS], ids=lambda each: each.kind.value)
def test_a_crop_is_a_cut_out_but_where_samples_beyond_it_would_count(pixel_filter: PixelFilter) -> None:
    whole = through(pixel_filter, cornell_box((24, 18)))
    left, top, width, height = 5, 3, 12, 10
    seen = replace(whole.camera, width=width, height=height, crop=(left, top, width, height), full_size=(24, 18))
    cut = alone(replace(whole, camera=seen), PATH).layers["beauty"]
    expected = alone(whole, PATH).layers["beauty"][top : top + height, left : left + width]
    edge = math.ceil(pixel_filter.radius - 0.5)
    assert np.array_equal(cut[edge:-edge, edge:-edge], expected[edge:-edge, edge:-edge])
    assert not np.array_equal(cut, expected)
