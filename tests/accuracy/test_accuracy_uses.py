"""Knobs that change nothing in a render: which, why, and that nobody's time is spent on turning them."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from wdpm import api
from wdpm.accuracy import render
from wdpm.accuracy.knobs import KNOBS, parse_sweep
from wdpm.accuracy.run import Request, measure
from wdpm.accuracy.uses import idle_by_settings, idle_knobs
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.kernels.launch import Launcher
from wdpm.local_backend import backend_here
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.load import load
from wdpm.scenes.model.bsdfs import Dielectric
from wdpm.scenes.model.left_out import leave_out
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Medium, Scene

SIZE = (12, 10)
ONE_THREAD = partial(backend_here, threads=1, copies=Copies.NONE)
CAUSTIC = {"caustic_photons", "caustic_k", "caustic_radius"}
VOLUME = {"volume_photons", "volume_samples", "volume_radius"}
GLOBAL = {"photons", "k", "radius", "indirect"}
ALL = {knob.name for knob in KNOBS}


def cornell_box() -> Scene:
    return load("cornell-box", size=SIZE)


def with_glass(which: int) -> Scene:
    """The box with one of its meshes made of glass."""
    scene = cornell_box()
    glass = replace(scene.materials[0], bsdf=Dielectric())
    meshes = list(scene.meshes)
    meshes[which] = replace(meshes[which], material=len(scene.materials))
    return replace(scene, meshes=tuple(meshes), materials=(*scene.materials, glass))


def glass_box() -> Scene:
    """A block of glass."""
    return with_glass(-2)


def glass_lamp() -> Scene:
    """Nothing but the lamp is of glass, which light never meets again."""
    return with_glass(-1)


def foggy_box() -> Scene:
    """The box, and the camera in fog."""
    scene = cornell_box()
    meshes = tuple(replace(mesh, interior=0, exterior=0) for mesh in scene.meshes)
    media = (Medium("fog", (0.2, 0.2, 0.2)),)
    return replace(scene, meshes=meshes, media=media, camera=replace(scene.camera, medium=0))


def bulb_box() -> Scene:
    """The box, lit by a point instead of the lamp."""
    scene = cornell_box()
    lamp = next(mesh for mesh in scene.meshes if mesh.emission is not None)
    bulb = PointLight("bulb", (0.0, 1.0, 0.0), (1.0, 1.0, 1.0))
    return replace(scene, meshes=tuple(m for m in scene.meshes if m is not lamp), lights=(bulb,))


def idle(scene: Scene, **chosen: Any) -> dict[str, str]:
    settings = RenderSettings(**{"photons": 500, "spp": 4, **chosen})
    prepared = prepare(scene, settings, 1, Launcher("cpu", 1), SilentProgress())
    return idle_knobs(flatten(leave_out(scene, settings.without)), prepared.session.world, settings)


@pytest.mark.parametrize(
    ("scene", "chosen", "names"),
    [
        (cornell_box, {}, CAUSTIC | VOLUME),
        (cornell_box, {"without": ("indirect",)}, CAUSTIC | VOLUME | GLOBAL | {"passes", "band"}),
        (cornell_box, {"photons": 0}, CAUSTIC | VOLUME | {"k", "radius", "indirect", "passes", "band"}),
        (cornell_box, {"max_depth": 2}, CAUSTIC | VOLUME | GLOBAL | {"passes", "band"}),
        (cornell_box, {"max_depth": 1}, ALL - {"spp", "slaves"}),
        (cornell_box, {"integrator": Integrator.PATH}, ALL - {"spp", "slaves", "light_samples"}),
        (glass_box, {}, VOLUME),
        (glass_lamp, {}, VOLUME | CAUSTIC),
        (glass_box, {"caustic_photons": 0}, VOLUME | {"caustic_k", "caustic_radius"}),
        (glass_box, {"without": ("caustics",)}, VOLUME | CAUSTIC),
        (foggy_box, {}, CAUSTIC),
        (foggy_box, {"spp": 1}, CAUSTIC | {"volume_samples"}),
        (foggy_box, {"without": ("media",)}, CAUSTIC | VOLUME),
        (bulb_box, {}, CAUSTIC | VOLUME | {"light_samples"}),
    ],
)
def test_knobs_that_change_nothing(scene: Any, chosen: dict[str, Any], names: set[str]) -> None:
    assert set(idle(scene(), **chosen)) == names


def test_a_scene_without_light() -> None:
    scene = cornell_box()
    dark = replace(scene, meshes=tuple(replace(mesh, emission=None) for mesh in scene.meshes))
    assert set(idle(dark)) == ALL - {"spp", "slaves"}


@pytest.mark.parametrize(
    ("chosen", "changes"),
    [
        ({}, [{"caustic_k": 5}, {"caustic_photons": 900}, {"volume_photons": 900}, {"volume_samples": 1}]),
        ({"without": ("indirect",)}, [{"photons": 900}, {"k": 5}, {"radius": 0.1}]),
        ({"integrator": Integrator.PATH}, [{"photons": 900}, {"k": 5}, {"light_samples": None}]),
    ],
)
def test_their_images_are_the_same(chosen: dict[str, Any], changes: list[dict[str, Any]]) -> None:
    scene = cornell_box()
    base = RenderSettings(**{"photons": 500, "spp": 2, **chosen})
    idle_ones = idle(scene, **chosen)
    for change in changes:
        assert set(change) <= set(idle_ones) | {"light_samples"}
        other = replace(base, **change)
        same = [hashlib.sha256(api.render(scene, each).pixels.tobytes()).digest() for each in (base, other)]
        assert same[0] == same[1], change


def request(folder: Path, sweep: str, **chosen: Any) -> Request:
    settings = {"photons": 500, "spp": 2, **chosen}
    return Request("cornell-box", folder, size=SIZE, chosen=settings, sweeps=(parse_sweep(sweep),))


@pytest.mark.parametrize(
    ("sweep", "chosen", "complaint"),
    [
        (
            "caustic-k=10,20",
            {},
            "^--sweep caustic-k=10,20: caustic-k changes nothing in this render: the scene has no ",
        ),
        ("volume-samples=1,2", {}, "volume-samples changes nothing in this render: the scene has no media; leave"),
        ("photons=5k,10k", {"integrator": Integrator.PATH}, "--integrator path has no photons; leave this sweep out"),
        ("passes=1,2", {"integrator": Integrator.PATH}, "--integrator path has no photons"),
        ("k=5,9", {"without": ("indirect",)}, "--without indirect leaves it out"),
        ("k=5,9", {"photons": 0}, "the base has --photons 0"),
        ("caustic-radius=2x", {"caustic_photons": 0}, "the base has --caustic-photons 0"),
    ],
)
def test_they_are_refused_before_anything_is_rendered(
    sweep: str, chosen: dict[str, Any], complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(render.PointRenderer, "render", lambda *_: pytest.fail("rendered"))
    with pytest.raises(SettingsError, match=complaint) as refused:
        measure(request(tmp_path, sweep, **chosen), ONE_THREAD, SilentProgress())
    assert "\n" not in str(refused.value)


def test_what_needs_no_scene_is_told_without_one() -> None:
    assert set(idle_by_settings(RenderSettings(integrator=Integrator.PATH))) == ALL - {"spp", "slaves", "light_samples"}
    assert idle_by_settings(RenderSettings()) == {}
