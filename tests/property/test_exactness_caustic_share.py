"""Where one sample asks the caustic map for several of its pixel, bits are alike in any partition, and light stays."""

from __future__ import annotations

import random
from dataclasses import replace

import effect_scenes
import numpy as np
import pytest
from digests import alone, same_bits

from wdpm.cluster.allotment import NO_ALLOTMENT, Allotment
from wdpm.cluster.plan.view import view_of
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings, Routing
from wdpm.cluster.work.whole.samples import WholeSamples
from wdpm.cluster.work.whole.within_cell import WithinCell
from wdpm.images.image import Image
from wdpm.rendering import prepare
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import Scene

pytestmark = pytest.mark.own_kernels

PHOTONS = RenderSettings(
    integrator=Integrator.PHOTONS, spp=8, light_samples=2, photons=1500, k=15, caustic_photons=700, caustic_k=12
)
MAP, GATHER, CACHE = (replace(PHOTONS, indirect=way) for way in (Indirect.MAP, Indirect.GATHER, Indirect.CACHE))
COATS, PANES = effect_scenes.coats(), effect_scenes.panes()


def share(monkeypatch: pytest.MonkeyPatch, samples: int) -> None:
    """Have 1 of so many samples ask, as a trial may choose."""
    choose = prepare.choose_settings
    monkeypatch.setattr(prepare, "choose_settings", lambda *given: replace(choose(*given), caustic_share=samples))


def gathers_of(image: Image) -> int:
    return int(image.metadata["report"]["gathers"])


@pytest.mark.parametrize(("scene", "chosen"), [(COATS, MAP), (COATS, CACHE), (PANES, GATHER), (PANES, CACHE)])
def test_followed_whole_or_by_batches_the_bits_are_the_same(
    scene: Scene, chosen: RenderSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    every = alone(scene, chosen)
    share(monkeypatch, 4)
    whole = alone(scene, chosen)
    monkeypatch.setattr(WholeSamples, "can_be", False)
    batches = alone(scene, chosen)
    assert whole.digest() == batches.digest()
    assert gathers_of(whole) == gathers_of(batches) < gathers_of(every)
    assert not np.array_equal(whole.layers["caustic"], every.layers["caustic"])
    assert np.array_equal(whole.layers["direct"], every.layers["direct"])


@pytest.mark.parametrize(("scene", "chosen"), [(COATS, MAP), (PANES, CACHE)])
@pytest.mark.parametrize("within", [True, False], ids=["within cells", "step by step"])
def test_no_partition_or_order_changes_a_bit(
    scene: Scene, chosen: RenderSettings, within: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    share(monkeypatch, 4)
    expected = alone(scene, chosen)
    if not within:
        monkeypatch.setattr(WithinCell, "can_be", False)
    for workers, cells, routing in ((1, 2, Routing.FORWARD), (2, 4, Routing.FORWARD), (2, 2, Routing.MERGE)):
        some = replace(chosen, routing=routing, bucket=6)
        order = random.Random(cells)
        assert same_bits(render_in_process(scene, some, workers=workers, cells=cells, shuffle=order), expected)


@pytest.mark.parametrize("samples", [64, 61])
def test_light_is_as_much_as_when_all_ask(samples: int, monkeypatch: pytest.MonkeyPatch) -> None:
    every = alone(COATS, replace(MAP, spp=samples)).layers["caustic"]
    share(monkeypatch, 8)
    some = alone(COATS, replace(MAP, spp=samples)).layers["caustic"]
    assert every.mean() > 0
    assert some.mean() == pytest.approx(every.mean(), rel=0.02)


def test_passes_of_whole_runs_ask_for_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = replace(MAP, spp=16, passes=2)
    every = alone(COATS, chosen)
    share(monkeypatch, 4)
    assert gathers_of(alone(COATS, chosen)) < 0.8 * gathers_of(every)


def test_who_asks_is_told_by_whole_runs_of_all_pixels() -> None:
    view = view_of(flatten(cornell_box((24, 8))), PHOTONS, 1)

    def turn(**changes: object) -> tuple[int, int]:
        return replace(view, **changes).caustic_turn  # type: ignore[arg-type]

    def allotted(first: list[int], count: list[int]) -> Allotment:
        return Allotment(np.array([first], np.int32), np.array([count], np.int32))

    assert turn() == (1, 1)
    assert turn(caustic_share=4, spp=16) == (16, 4)
    assert turn(caustic_share=4, spp=16, first_sample=32) == (16, 4)
    assert turn(caustic_share=4, spp=12, first_sample=12) == (12, 3)
    assert turn(caustic_share=4, spp=6) == (6, 2)
    assert turn(caustic_share=8, spp=63) == (63, 8)
    assert turn(caustic_share=8, spp=16, first_sample=4) == (4, 1)
    assert turn(caustic_share=4, spp=5) == (5, 2)
    assert turn(caustic_share=4, allotment=NO_ALLOTMENT, spp=8) == (8, 2)
    assert turn(caustic_share=4, allotment=allotted([0, 0, 0], [8, 12, 20])) == (4, 1)
    assert turn(caustic_share=4, allotment=allotted([8, 0, 6], [8, 12, 20])) == (2, 1)
    assert turn(caustic_share=4, allotment=allotted([0, 0, 0], [0, 0, 0])) == (1, 1)
