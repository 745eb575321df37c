"""`wdpm inspect`: the plan says what the scene calls for, because of what, and what is left out."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from wdpm import api
from wdpm.bench import effects_scenes as scenes
from wdpm.cli import main
from wdpm.cluster.integrators.photons import RULE
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.effects_in_words import WITHOUT, Effect, causes_of
from wdpm.cluster.render_settings import EFFECTS_TO_LEAVE_OUT, RenderSettings
from wdpm.cluster.work.replica import with_camera
from wdpm.images.image import load as load_image
from wdpm.inspection.inspect import Inspection, inspect
from wdpm.inspection.tables import LIGHTS_SHOWN, print_inspection
from wdpm.kernels.features import WORDS, Features
from wdpm.rendering.approximations import is_round
from wdpm.scenes.builtin.cornell_box import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Material, Scene

FEW = {"photons": 2000, "caustic_photons": 2000, "volume_photons": 2000}


def printed(inspection: Inspection, width: int = 100) -> str:
    console = Console(width=width, no_color=True)
    with console.capture() as capture:
        print_inspection(inspection, console)
    return capture.get()


def effect(inspection: Inspection, name: str) -> Effect:
    return next(each for each in inspection.effects if each.name == name)


def test_the_plan_has_every_feature_and_every_effect_that_can_be_left_out() -> None:
    assert set(WORDS) == {field.name for field in fields(Features)}
    assert set(WITHOUT) == set(EFFECTS_TO_LEAVE_OUT)


@pytest.mark.parametrize("name", scenes.names())
def test_what_is_said_to_be_called_for_is_what_kernels_are_compiled_for(name: str) -> None:
    flat = flatten(scenes.scene_of(name, (8, 8)))
    features = with_camera(features_of(flat, RenderSettings()), flat.camera)
    causes = causes_of(flat, ["fog"])
    assert {name for name in WORDS if causes[name]} == set(features.names())


def test_a_plan_names_what_calls_for_an_effect() -> None:
    inspection = inspect(scenes.scene_of("+ mirror", (8, 8)), slaves=2, **FEW)
    assert inspection.features == ("conductor",)
    mirror, caustics = effect(inspection, "conductor"), effect(inspection, "caustic photon map")
    assert mirror.called
    assert mirror.because == ("tall block",)
    assert caustics.on
    assert caustics.because == ("tall block",)
    assert effect(inspection, "aimed photons").on
    assert not effect(inspection, "dielectric").called
    assert not effect(inspection, "volume photon map").on
    assert inspection.photons == (2000, 2000, 0)
    assert inspection.approximated[0] == RULE
    assert len(inspection.slaves) == 2
    text = printed(inspection)
    row = next(line for line in text.splitlines() if line.startswith("metals and mirrors"))
    assert row.split() == ["metals", "and", "mirrors", "yes", "tall", "block", "Fresnel's", "formulas", "for", "metals"]
    assert text.index("Not called for, and so off") < text.index("glass   ")
    data = json.loads(inspection.to_json())
    assert {each["name"]: each["because"] for each in data["effects"]}["conductor"] == ["tall block"]


def test_three_names_and_how_many_more() -> None:
    one = Effect("e", "e", True, True, ("a", "b", "c"), "")
    assert one.reason == "a, b, c"
    assert replace(one, because=tuple("abcdef")).reason == "a, b, c and 3 more"


def test_all_effects_are_on_without_being_called_for() -> None:
    inspection = inspect(cornell_box((8, 8)), slaves=1, all_effects=True, **FEW)
    glass = effect(inspection, "dielectric")
    assert (glass.called, glass.on, glass.left_out) == (False, True, False)
    assert not effect(inspection, "caustic photon map").on  # a map that nobody needs is not made all the same
    assert "no, but on" in printed(inspection)


def test_what_is_left_out_knowingly_is_told() -> None:
    scene = scenes.scene_of("+ mirror", (8, 8))
    inspection = inspect(scene, slaves=1, without=("caustics", "lens"), **FEW)
    assert effect(inspection, "caustic photon map").left_out
    assert inspection.left_out == ("left out by --without caustics: caustics (tall block)",)  # there is no lens
    assert "LEFT OUT" in printed(inspection)
    assert "warning: left out by --without caustics" in printed(inspection)
    none = inspect(scene, slaves=1, **{**FEW, "caustic_photons": 0})
    assert none.left_out == ("left out by --caustic-photons 0: caustics (tall block)",)
    assert inspect(scene, slaves=1, **FEW).left_out == ()


def test_what_is_left_out_stands_in_the_header_and_in_the_report(tmp_path: Path) -> None:
    scene = scenes.scene_of("+ lens", (8, 8))
    image = api.render(scene, spp=1, without=("lens",), **FEW)
    said = ["left out by --without lens: depth of field (the camera)"]
    assert image.metadata["left_out"] == said
    assert image.metadata["report"]["left_out"] == said
    image.save(tmp_path / "a.exr")
    assert load_image(tmp_path / "a.exr").metadata["left_out"] == said
    assert "left_out" not in api.render(scene, spp=1, **FEW).metadata


def test_lights_that_do_not_shine_get_no_photons() -> None:
    box = cornell_box((8, 8))
    dark = replace(box.meshes[0], name="dark lamp", emission=(0.0, 0.0, 0.0))
    off = PointLight("switched off", (278.0, 270.0, 280.0), (0.0, 0.0, 0.0))
    weak = PointLight("weak", (278.0, 270.0, 280.0), (100.0, 100.0, 100.0))
    scene = replace(box, meshes=(dark, *box.meshes[1:]), lights=(off, weak))
    inspection = inspect(scene, slaves=1, **FEW)
    lights = {light.name: light for light in inspection.lights}
    assert set(lights) == {"lamp", "switched off", "weak", "dark lamp"}
    assert lights["dark lamp"].photons == lights["switched off"].photons == 0.0
    assert {name for name, light in lights.items() if light.why_none} == {"dark lamp", "switched off"}
    assert lights["lamp"].by_power + lights["weak"].by_power == pytest.approx(1.0)
    assert sum(light.photons for light in inspection.lights) == pytest.approx(1.0)
    text = printed(inspection)
    assert "no photons for light dark lamp: it has no power" in text
    assert "no photons for light switched off: it has no power" in text


def test_many_lights_are_added_up() -> None:
    points = tuple(PointLight(f"p{i}", (278.0, 270.0, 280.0), (1e4,) * 3) for i in range(LIGHTS_SHOWN + 4))
    text = printed(inspect(replace(cornell_box((8, 8)), lights=points), slaves=1, **FEW))
    assert "5 more" in text


def test_spheres_are_recognised() -> None:
    ball = scenes.scene_of("+ glass", (8, 8)).meshes[-1]
    assert is_round(ball)
    assert not is_round(replace(ball, vertices=ball.vertices * np.array([1.0, 1.0, 1.001])))
    assert not is_round(replace(ball, normals=None))
    assert not any(is_round(mesh) for mesh in cornell_box().meshes)


def test_a_material_that_no_mesh_has_calls_for_nothing() -> None:
    box = cornell_box((8, 8))
    scene: Scene = replace(box, materials=(*box.materials, Material("unused", Conductor())))
    assert causes_of(flatten(scene))["conductor"] == ()


def test_the_command_prints_json_with_settings(capsys: pytest.CaptureFixture[str]) -> None:
    line = "inspect cornell-box --size 8x8 --slaves 1 --photons 1k --without indirect --json"
    assert main.main(line.split()) == 0
    data: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert data["size"] == [8, 8]
    assert data["left_out"][0].startswith("left out by --without indirect: light off diffuse surfaces (")


def test_memory_makes_copies_of_the_scene() -> None:
    scene = cornell_box((8, 8))
    cut = inspect(scene, slaves=4, **FEW).slaves
    assert [share.team for share in cut] == [0, 0, 0, 0]
    assert sum(share.photons for share in cut) == pytest.approx(1.0, abs=0.01)
    whole = inspect(scene, slaves=4, memory=1 << 30, **FEW)
    assert [share.team for share in whole.slaves] == [0, 1, 2, 3]
    assert all(share.triangles == 1.0 and share.ghosts == 0.0 for share in whole.slaves)
    assert "4 copies of the scene" in printed(whole)
    none = inspect(scene, slaves=4, copies=Copies.NONE, memory=1 << 30, **FEW)
    assert [share.team for share in none.slaves] == [0, 0, 0, 0]
    assert max(share.memory for share in cut) <= whole.slaves[0].memory
    assert max(share.received for share in none.slaves) > 0


def test_too_little_memory_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["inspect", "cornell-box", "--slaves", "2", "--memory", "1M"]) == 2
    assert "use more slaves" in capsys.readouterr().err
