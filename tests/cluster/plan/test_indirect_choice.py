"""Where indirect light comes from with photons, both ways."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.helpers.effect_scenes import fogs
from wdpm.cluster.integrators.indirect_choice import SAMPLES_TO_REPAY, choose_indirect
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.bsdfs import Bsdf, Plastic, Principled
from wdpm.scenes.model.scene import Material, Scene

BOX = cornell_box((128, 128))
ENOUGH = SAMPLES_TO_REPAY // 128**2


GREY = (0.6, 0.6, 0.6)
COAT, DISNEYS, GLOSS = Plastic(GREY), Principled(GREY), Principled(GREY, layered=True)
CLOTH = Principled(GREY, sheen=0.5, layered=True)


def covered(scene: Scene, bsdf: Bsdf, *names: str) -> Scene:
    """The same with some materials of another kind."""
    return replace(
        scene, materials=tuple(Material(each.name, bsdf) if each.name in names else each for each in scene.materials)
    )


def chosen(scene: Scene, *, wanted: bool = True, **settings: object) -> tuple[Indirect, str | None]:
    return choose_indirect(flatten(scene), RenderSettings(**{"spp": ENOUGH, **settings}), wanted=wanted)


def test_records_are_made_for_samples_enough_to_repay_them() -> None:
    assert chosen(BOX)[0] is Indirect.CACHE
    how, why = chosen(BOX, spp=ENOUGH - 1)
    assert how is Indirect.MAP
    assert why is not None
    assert "too few to repay gathering" in why


def test_samples_are_those_of_a_pass() -> None:
    assert chosen(BOX, spp=4 * ENOUGH, passes=4)[0] is Indirect.CACHE
    assert chosen(BOX, spp=4 * ENOUGH, passes=8)[0] is Indirect.MAP


@pytest.mark.parametrize("uneven", [CLOTH, DISNEYS], ids=["cloth", "Disney's"])
def test_records_serve_no_surfaces_that_send_light_back(uneven: Bsdf) -> None:
    """A part of the box that does is looked up in the map; where it is most of it, all of it is."""
    assert chosen(covered(BOX, uneven, "red"))[0] is Indirect.CACHE
    how, why = chosen(covered(BOX, uneven, "red", "white"))
    assert how is Indirect.MAP
    assert why is not None
    assert why.endswith("of the diffuse surface has bumps, sheen or Disney's base")


@pytest.mark.parametrize("even", [GLOSS, COAT], ids=["gloss", "coat"])
def test_records_serve_surfaces_under_gloss(even: Bsdf) -> None:
    assert chosen(covered(BOX, even, "red", "green", "white"))[0] is Indirect.CACHE


def test_media_are_for_the_map() -> None:
    assert chosen(fogs(), spp=64) == (Indirect.MAP, "indirect light: map, since the scene has media")


def test_without_a_map_of_indirect_light_there_is_nothing_to_choose() -> None:
    assert chosen(BOX, wanted=False) == (Indirect.MAP, None)


@pytest.mark.parametrize("kind", [kind for kind in Indirect if kind is not Indirect.AUTO])
def test_what_was_asked_for_is_done(kind: Indirect) -> None:
    assert chosen(BOX, indirect=kind, spp=1) == (kind, None)
