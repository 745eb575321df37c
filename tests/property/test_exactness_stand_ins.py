"""Kernels with all effects that stand in for a scene's own give the same bits, whichever of them do."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import effect_scenes
import pytest
import warp as wp
from digests import alone, same_bits

from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.images.image import Image
from wdpm.kernels import stand_ins
from wdpm.kernels.variants import CAN_DO_WITHOUT, make_variants
from wdpm.rendering.compiling import Compiling
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.passes import render_in_passes
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import Scene

pytestmark = [pytest.mark.usefixtures("small_pilot"), pytest.mark.own_kernels]

FEW: dict[str, Any] = {"photons": 2000, "caustic_photons": 1000, "volume_photons": 2000, "k": 20, "caustic_k": 10}
BOX = cornell_box((12, 12))
CASES = {
    "paths that end at once": (BOX, RenderSettings(**FEW, spp=2, indirect=Indirect.MAP)),
    "final gathering": (BOX, RenderSettings(**FEW, spp=2, indirect=Indirect.CACHE)),
    "media, short paths": (effect_scenes.fogs(), RenderSettings(**FEW, spp=2, indirect=Indirect.MAP, max_depth=3)),
}

Lack = Callable[[Collection[str]], None]

_alone: dict[str, Image] = {}


@pytest.fixture
def lack(monkeypatch: pytest.MonkeyPatch) -> Lack:
    """Has a scene's own kernels of these names be taken for not compiled; those with all effects are."""

    def only(names: Collection[str]) -> None:
        every = {kernel.module.name for kernel in stand_ins.stand_ins().kernels().values()}

        def seems_compiled(module: wp.Module) -> bool:
            return module.name in every or not {kernel.func.__name__ for kernel in module.kernels.values()} & set(names)

        monkeypatch.setattr(stand_ins, "seems_compiled", seems_compiled)

    return only


def standing_in(scene: Scene, settings: RenderSettings) -> Image:
    """An image that is rendered with kernels that stand in for others."""
    with InProcess(threads=1, compiling=Compiling.NO) as backend:
        return render_in_passes(scene, backend, settings)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(
    "names",
    [
        None,
        ("gather_glossy", "trace_photons", "visit_camera_rays"),
        ("emit_photons", "visit_paths", "visit_shadow_segments", "start_paths", "visit_walks", "pass_surfaces"),
    ],
    ids=["all", "shading", "others"],
)
def test_the_bits_are_those_of_own_kernels(case: str, names: tuple[str, ...] | None, lack: Lack) -> None:
    scene, settings = CASES[case]
    if case not in _alone:
        _alone[case] = alone(scene, settings)
    own = make_variants(features_of(flatten(scene), settings)).kernels()
    missing = own.keys() if names is None else own.keys() & set(names)
    lack(missing)
    image = standing_in(scene, settings)
    kernels = image.metadata["report"]["kernels"]
    assert len(missing) <= kernels["standing_in"] <= len(own)
    assert (kernels["kernels"], kernels["all_effects"]) == (len(own.keys() - (CAN_DO_WITHOUT & missing)), False)
    assert same_bits(image, _alone[case])


def test_kernels_that_shade_are_own_or_stand_in_all_alike(lack: Lack) -> None:
    features = features_of(flatten(BOX), CASES["final gathering"][1])
    own = make_variants(features).kernels()
    lack({"gather_glossy"})
    chosen = stand_ins.compiled_kernels(features)
    assert chosen.standing_in == stand_ins.SHADING & own.keys() > {"gather_glossy"}
    assert chosen.outputs.coated
    assert not features.coated
    lack({"trace_photons"})
    chosen = stand_ins.compiled_kernels(features)
    assert chosen.standing_in == {"trace_photons"}
    assert chosen.outputs == features
    assert {name for name, kernel in chosen.variants.kernels().items() if kernel is not own[name]} == {"trace_photons"}


def test_own_kernels_are_taken_where_they_are_compiled(lack: Lack) -> None:
    features = features_of(flatten(BOX), CASES["final gathering"][1])
    lack(())
    assert stand_ins.compiled_kernels(features) == stand_ins.own_kernels(features)


def test_what_is_compiled_neither_way_is_a_scenes_own(monkeypatch: pytest.MonkeyPatch) -> None:
    features = features_of(flatten(BOX), CASES["final gathering"][1])
    monkeypatch.setattr(stand_ins, "seems_compiled", lambda _: False)
    assert stand_ins.compiled_kernels(features) == stand_ins.own_kernels(features)


def test_a_pass_that_begins_later_has_kernels_that_were_compiled_meanwhile(
    lack: Lack, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, settings = BOX, RenderSettings(**FEW, spp=4, passes=4, indirect=Indirect.CACHE)
    expected = alone(scene, settings)
    lack({"shade_vertices"})
    chosen = []
    choose = stand_ins.compiled_kernels

    def remember(features: Any) -> Any:
        chosen.append(choose(features))
        if len(chosen) == 6:
            lack(())
        return chosen[-1]

    monkeypatch.setattr("wdpm.kernels.compile.compiled_kernels", remember)
    image = standing_in(scene, settings)
    stood_in = [bool(each.standing_in) for each in chosen]
    assert stood_in[:6] == [True] * 6
    assert len(stood_in) > 6
    assert not any(stood_in[6:])
    assert same_bits(image, expected)
