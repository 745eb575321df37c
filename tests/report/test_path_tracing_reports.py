"""What is said of path-traced images is true of them: plans, reports, replays."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from furnaces import box, scene, view

from wdpm.cli import main
from wdpm.cluster.integrators.path import HIDDEN
from wdpm.cluster.integrators.photons import RULE
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.images.image import Image
from wdpm.inspection.inspect import inspect
from wdpm.rendering.approximations import settings_without_effect
from wdpm.rendering.in_process import InProcess, render_in_process
from wdpm.replaying.run import Replayer
from wdpm.replaying.vertices import LAYERS
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import GuardError, SettingsError
from wdpm.scenes.model.bsdfs import Conductor, Dielectric, Null
from wdpm.scenes.model.lights import Environment, PointLight
from wdpm.scenes.model.scene import Material, Medium, Scene

PATH = RenderSettings(integrator=Integrator.PATH, spp=3, light_samples=2, all_effects=True)

FOR_PATHS = {
    "spp",
    "light_samples",
    "max_depth",
    "passes",
    "pass_samples",
    "plan_samples",
    "adaptive",
    "seed",
    "bucket",
    "routing",
    "integrator",
    "all_effects",
    "instances",
}


def foggy_room() -> Scene:
    """The camera in a haze, a box of smoke, a block of glass, and an open side under a sky."""
    room = box((1, 1, 1), inside=True)
    room = replace(room, faces=room.faces[2:])
    smoke = replace(box((0.4, 0.3, 0.35), (0.3, -0.5, 0.3)), material=1, interior=1, exterior=0, bounds=True)
    glass = replace(box((0.2, 0.4, 0.2), (-0.5, -0.5, 0.2)), material=2, exterior=0, bounds=True)
    what = scene([room, smoke, glass], replace(view((0, 0, -0.9), (0, -0.2, 0.5), 70, 5), medium=0), (0.7, 0.6, 0.5))
    media = Medium("haze", (0.3, 0.4, 0.5), (0.9, 0.8, 0.7), 0.2), Medium("smoke", (4.0,) * 3, (0.9,) * 3)
    lights = (
        PointLight("lamp", (0.2, 0.7, 0.1), (2.0, 1.8, 1.5), 0),
        Environment("sky", np.full((1, 1, 3), 0.5, np.float32)),
    )
    more = Material("nothing", Null()), Material("glass", Dielectric(1.5))
    return replace(what, materials=(*what.materials, *more), lights=lights, media=media)


def test_every_setting_is_looked_at_or_named() -> None:
    every = {field.name for field in fields(RenderSettings)}
    ignored = set(Integrator.PATH.algorithm.ignored)
    assert every - ignored - FOR_PATHS == {"strict", "without"}
    assert ignored <= every


def test_settings_without_effect_are_named() -> None:
    assert settings_without_effect(PATH) == ()
    assert settings_without_effect(RenderSettings(photons=10)) == ()
    (line,) = settings_without_effect(replace(PATH, photons=10, caustic_k=7))
    assert line.endswith("photons, caustic_k")


@pytest.mark.parametrize("without", ["indirect", "caustics"])
def test_photon_maps_cannot_be_left_out(without: str) -> None:
    with pytest.raises(SettingsError, match=f"without {without} .* max_depth 2"):
        replace(PATH, without=(without,))


def test_inspection_of_what_has_no_photons() -> None:
    found = inspect(foggy_room(), integrator=Integrator.PATH, all_effects=True, photons=1234)
    assert found.paths == (0, 0)
    assert found.photons == (0, 0, 0)
    assert found.left_out == ()
    effects = {effect.name: effect for effect in found.effects}
    assert effects["traced"].because == ("--integrator path",)
    for name in ("global photon map", "caustic photon map", "aimed photons", "volume photon map", "light shares"):
        assert not effects[name].called, name
        assert not effects[name].on, name
    assert effects["media"].called
    assert effects["media"].on
    assert any("photons" in line for line in found.warnings)
    assert HIDDEN in found.approximated  # the lamp has no size, the glass is smooth
    assert RULE not in found.approximated
    assert not any("photons" in line or "averaged" in line for line in found.approximated)


def test_nothing_is_hidden_where_lights_have_size_or_surfaces_are_rough() -> None:
    what = foggy_room()
    rough = Material("metal", Conductor(alpha_u=0.2, alpha_v=0.2))
    for other in (
        replace(what, lights=what.lights[1:]),
        replace(what, materials=(*what.materials[:2], rough)),
    ):
        assert inspect(other, integrator=Integrator.PATH, all_effects=True).approximated == ()


def summed(image: Image, replayer: Replayer) -> None:
    """All samples of all pixels, replayed, are the image, bit for bit."""
    height, width = image.layers["depth"].shape
    kinds = set()
    for y in range(height):
        for x in range(width):
            samples = [replayer.sample(x, y, number) for number in range(PATH.spp)]
            sums = {name: np.zeros(3) for name in LAYERS}
            for sample in samples:
                sums = {name: sums[name] + sample.layers[name] for name in LAYERS}
                for vertex in sample.vertices:
                    kinds.add("collision" if vertex.collision else "hit" if vertex.hit else "beyond")
                    assert vertex.indirect is None
                    assert vertex.caustic is None
                told = sum(
                    np.sum([ray.arrives for ray in vertex.direct if ray.arrives] or [np.zeros(3)], axis=0)
                    / (PATH.light_samples if vertex.bounce == 0 and vertex.hit else 1)
                    + vertex.emission
                    for vertex in sample.vertices
                )
                np.testing.assert_allclose(told, sample.value, rtol=1e-12, atol=1e-15)
            for name in LAYERS:
                if name in image.layers:
                    expected = (sums[name] * (1.0 / PATH.spp)).astype(np.float32)
                    assert (image.layers[name][y, x] == expected).all(), (x, y, name)
    assert kinds == {"collision", "hit", "beyond"}


def test_all_samples_come_back_bit_for_bit() -> None:
    what = foggy_room()
    summed(render_in_process(what, PATH, workers=2, cells=4), Replayer(what, InProcess(threads=1), PATH))


def test_a_replay_on_the_command_line_tells_of_collisions(capsys: pytest.CaptureFixture[str]) -> None:
    command = "render cornell-box --integrator path --all-effects --size 8x8 --spp 2 --replay 4,4,1"
    assert main.main(command.split()) == 0
    out = capsys.readouterr().out
    assert "Vertex 0" in out
    assert "photons within" not in out


def test_media_and_lens_can_be_left_out() -> None:
    what = foggy_room()
    what = replace(what, camera=replace(what.camera, aperture_radius=0.05, focus_distance=1.0))
    image = render_in_process(what, replace(PATH, without=("media", "lens")), workers=1)
    assert "volume" not in image.layers
    lost = image.metadata["report"]["left_out"]
    assert {line.split(":")[0] for line in lost} == {"left out by --without media", "left out by --without lens"}


def test_strict_renders_are_the_same_bits_or_an_error() -> None:
    what = foggy_room()
    plain, strict = (render_in_process(what, replace(PATH, strict=on), workers=1) for on in (False, True))
    assert plain.digest() == strict.digest()
    mirrors = replace(box((1, 1, 1), inside=True, emission=(1.0, 1.0, 1.0)), interior=0, exterior=0, bounds=True)
    milk = Medium("milk", (2000.0,) * 3, (1.0,) * 3)
    endless = replace(scene([mirrors], replace(view((0, 0, -0.5), (0, 0, 1), 40), medium=0), (0.0,) * 3), media=(milk,))
    with pytest.raises(GuardError, match="limit of vertices"):
        render_in_process(endless, replace(PATH, strict=True), workers=1)


def test_a_box_without_effects_says_so() -> None:
    image = render_in_process(cornell_box((4, 4)), PATH, workers=1)
    report = image.metadata["report"]
    assert report["photons"]["paths"] == report["photons"]["asked"] == 0
    assert report["left_out"] == report["approximated"] == report["warnings"] == []
