"""`--integrator auto`: each decision falls one way in one scene and the other way in another, and always alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import window_room
from two_rooms import corridor, rooms

import wdpm
from tests.helpers.effect_scenes import fogs
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.integrator_trial import (
    LEFT_BY_CACHE,
    LEFT_BY_MAP,
    _best_by_photons,
    _left_by_map,
    _with_photons_of_worth,
)
from wdpm.cluster.plan.map_plans import MapPlans, irradiance_share
from wdpm.cluster.plan.map_worth import FEWEST, MapError, irradiance_by, map_error
from wdpm.cluster.plan.path_caustics import NO_CAUSTICS, PathCaustics
from wdpm.cluster.plan.record_worth import TRIAL_PIXELS
from wdpm.cluster.plan.render_plan import make_render_plan
from wdpm.cluster.plan.small_view import Figures, small_camera
from wdpm.cluster.plan.trial.figures import Trial
from wdpm.cluster.plan.trial.prices import COAT_SHARE, GATHER, Prices
from wdpm.cluster.plan.trial.ways import Way, words_for
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.cluster.world import MapPlan
from wdpm.inspection.inspect import inspect
from wdpm.kernels.compile import compile_kernels
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import CAUSTIC_MAP
from wdpm.rendering.automatic_settings import ChosenSettings, choose_settings
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.bsdfs import Bsdf, Conductor, Plastic, Principled, ThinDielectric
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import FilterKind, Material, PixelFilter, Scene

LARGE = cornell_box((512, 512))
SMALL = cornell_box((16, 12))


def settled(scene: Scene, threads: int = 1, **chosen: Any) -> ChosenSettings:
    settings = RenderSettings(**{"integrator": Integrator.AUTO} | chosen)
    launcher = Launcher("cpu", threads)
    return choose_settings(flatten(scene), settings, launcher, lambda features: compile_kernels("cpu", features))


def mirrored(scene: Scene, shiny: Bsdf = Conductor()) -> Scene:  # noqa: B008 - it is immutable
    """The same with mirrors, or what else shines, for all materials but the first one."""
    others = tuple(Material(each.name, shiny) for each in scene.materials[1:])
    return replace(scene, materials=(scene.materials[0], *others))


def dark(scene: Scene) -> Scene:
    return replace(scene, meshes=tuple(replace(mesh, emission=None) for mesh in scene.meshes))


def with_lamp(scene: Scene, side: float) -> Scene:
    """The same with a lamp of another side, in shares of its own, and as much power."""
    (lamp,) = (mesh for mesh in scene.meshes if mesh.emission is not None)
    middle = lamp.vertices.mean(axis=0)
    radiance = tuple(value / side**2 for value in lamp.emission)
    smaller = replace(lamp, vertices=middle + (lamp.vertices - middle) * side, emission=radiance)
    return replace(scene, meshes=tuple(smaller if mesh is lamp else mesh for mesh in scene.meshes))


def test_a_sample_asks_the_caustic_map_for_others_where_what_these_see_of_it_is_much_alike() -> None:
    scene = cornell_box((64, 64))
    faint, bright = mirrored(scene, Plastic()), mirrored(scene)
    assert settled(faint, spp=16).caustic_share == 4
    assert "caustics: 1 of 4 samples of a pixel asks their map for all" in "; ".join(settled(faint, spp=16).chose)
    assert settled(faint, spp=4).caustic_share == 1, "edges want several"
    assert settled(bright, spp=16).caustic_share == 1, "sharp beside a mirror"
    assert not any("samples of a pixel asks" in line for line in settled(bright, spp=16).chose)
    signed = replace(faint, camera=replace(faint.camera, filter=PixelFilter(FilterKind.LANCZOS, 4.0)))
    assert settled(signed, spp=16).caustic_share == 1, "weights are balanced over all samples"


def with_bulb(scene: Scene) -> Scene:
    """The same with a point for its lamp."""
    return replace(dark(scene), lights=(PointLight("bulb", (278.0, 400.0, 279.5), (1e5, 1e5, 1e5)),))


def test_more_shadow_rays_where_samples_are_few_beside_what_is_done_once() -> None:
    few, many = (window_room.room(size=(64, 64)), 4), (window_room.room(size=(512, 512)), 64)
    assert [settled(scene, spp=spp).settings.light_samples for scene, spp in (few, many)] == [8, 4]
    assert any(line.startswith("shadow rays: 8 of each camera sample") for line in settled(few[0], spp=4).chose)
    assert not any(line.startswith("shadow rays: ") for line in settled(many[0], spp=64).chose)
    assert settled(few[0], spp=4, light_samples=4).settings.light_samples == 4, "asked for"
    assert settled(with_bulb(LARGE), spp=4).settings.light_samples == 1, "all would be alike"


def test_light_that_is_mostly_indirect_is_for_photons_and_few_samples_are_not_worth_them() -> None:
    many, few = settled(LARGE), settled(SMALL, spp=2)
    assert many.settings.integrator is Integrator.PHOTONS
    assert few.settings.integrator is Integrator.PATH
    for each in (many, few):
        assert ", since error times price of path tracing is expected to be " in each.chose[0]
    assert any(line.startswith("indirect light: ") for line in many.chose)
    assert len(few.chose) == 1


@pytest.mark.parametrize(
    ("scene", "chosen", "words"),
    [
        pytest.param(SMALL, {"photons": 2000}, "they were asked for: photons", id="photons asked for"),
        pytest.param(SMALL, {"without": ("indirect",)}, "they were asked for: without indirect", id="left out"),
        pytest.param(fogs(), {}, "the scene has media", id="media"),
        pytest.param(dark(SMALL), {}, "nothing shines", id="dark"),
        pytest.param(mirrored(with_bulb(SMALL)), {"spp": 2, "all_effects": True}, "no path finds", id="no path finds"),
        pytest.param(
            mirrored(with_bulb(SMALL), ThinDielectric()),
            {"spp": 2, "all_effects": True},
            "no path finds",
            id="panes mirror, too",
        ),
    ],
)
def test_what_paths_cannot_do_is_for_photons(scene: Scene, chosen: dict[str, Any], words: str) -> None:
    found = settled(scene, **chosen)
    assert found.settings.integrator is Integrator.PHOTONS
    assert found.chose[0].startswith(f"integrator: photons, since {words}")


def test_caustics_of_small_bright_lamps_are_for_photons_and_those_of_wide_ones_are_not() -> None:
    """By the noise that they make in paths, which a trial of few samples does not see."""
    scenes = (mirrored(with_lamp(cornell_box((8, 6)), side)) for side in (1.0, 0.02))
    wide, small = (settled(scene, spp=2, all_effects=True) for scene in scenes)
    assert wide.settings.integrator is Integrator.PATH
    assert small.settings.integrator is Integrator.PHOTONS
    assert all(" of it by caustics" in each.chose[0] for each in (wide, small))


@pytest.mark.parametrize(("near", "far"), [(2.0**30, 2.0**70), (2.0**-30, 2.0**-90)])
def test_caustics_of_lamps_of_any_unit_count_alike(near: float, far: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of lamps so bright, or so faint, that their photons' flux times their radiance is beyond float32."""
    monkeypatch.setattr("wdpm.cluster.plan.integrator_trial._by_paths_at_best", lambda *_: Way(0.0, 0.0))
    found = [settled(with_lamps(mirrored(SMALL), strength), spp=64).chose for strength in (near, far)]
    assert " of it by caustics" in found[0][0]
    assert found[0] == found[1]


def with_lamps(scene: Scene, strength: float) -> Scene:
    """The same with lamps so many times as strong."""
    meshes = [
        mesh if mesh.emission is None else replace(mesh, emission=tuple(strength * each for each in mesh.emission))
        for mesh in scene.meshes
    ]
    return replace(scene, meshes=tuple(meshes))


@pytest.mark.parametrize(("shine", "integrator"), [(0.3, Integrator.PATH), (1.0, Integrator.PHOTONS)])
def test_faint_caustics_that_hardly_a_pixel_meets_are_no_reason_for_photons(
    shine: float, integrator: Integrator
) -> None:
    """A tiny bright lamp on coats, of which one pixel in millions would be a million times too bright."""
    tiny = with_lamp(SMALL, 0.0005)
    coat = Material(tiny.materials[0].name, Plastic(specular_reflectance=(shine,) * 3))
    found = settled(replace(tiny, materials=(coat, *tiny.materials[1:])), spp=2, all_effects=True)
    assert found.settings.integrator is integrator
    assert " of it by caustics" in found.chose[0]


@pytest.mark.parametrize(
    ("chance", "share", "square", "told"),
    [(1e-7, 1e-3, 1e-5, 1e-5), (1e-4, 1e-3, 1e-5, 50.0), (1e-7, 1e-2, 1e-5, 50.0), (1e-7, 1e-3, 1e-2, 50.0)],
    ids=["met by hardly any", "met by many", "much light", "light in one place"],
)
def test_caustics_count_by_what_is_lacked_only_where_that_is_not_seen(
    chance: float, share: float, square: float, told: float
) -> None:
    assert PathCaustics(800.0, 0.0, np.full(100, chance), share, square).left(16, 0.03) == told


def beside_others(lamp: float) -> Scene:
    """Behind a wall six lamps so strong, before it a weak one, and a bulb whose light a mirror throws about."""
    scene = rooms((PointLight("bulb", (0.5, 0.0, 1.0), (0.02, 0.02, 0.02)),), (64, 64))
    strength = {40.0: (lamp,) * 3, 4.0: (0.02,) * 3}
    lamps = [
        mesh if mesh.emission is None else replace(mesh, emission=strength[mesh.emission[0]]) for mesh in scene.meshes
    ]
    lamps[3] = replace(lamps[3], material=len(scene.materials))
    return replace(scene, meshes=tuple(lamps), materials=(*scene.materials, Material("mirror", Conductor())))


@pytest.mark.parametrize(("lamp", "rays"), [(40.0, True), (0.0, False)], ids=["over-wide", "as wide as it must be"])
def test_gathers_that_are_over_wide_give_way_to_rays(lamp: float, rays: bool) -> None:
    """Nearly all photons fall behind the wall, and those before it lie as far apart as the room is wide."""
    found = settled(beside_others(lamp), spp=16, all_effects=True)
    assert found.settings.integrator is Integrator.PHOTONS
    (line,) = (line for line in found.chose if line.startswith("indirect light: "))
    assert found.settings.indirect is Indirect.CACHE
    assert ("since gathers of the map reach beyond what they are to show" in line) == rays


def test_few_samples_have_fewer_photons_and_many_have_all() -> None:
    """Beside one sample's noise a map that is more blurred serves as well; beside that of many it does not."""
    scene = with_bulb(cornell_box((64, 64)))
    few, many = (settled(scene, spp=spp) for spp in (1, 128))
    assert few.settings.integrator is many.settings.integrator is Integrator.PHOTONS
    assert few.settings.photons <= RenderSettings.photons // FEWEST
    assert f"; {few.settings.photons:,} photons, as more would bring little" in few.chose[0]
    assert many.settings.photons == RenderSettings.photons
    assert "as more would bring little" not in many.chose[0]
    assert settled(scene, spp=1, photons=200_000).settings.photons == 200_000


def test_light_that_few_photons_bring_is_for_paths() -> None:
    """A strong lamp outside, of whose photons hardly one in a thousand comes in, beside a weak one inside."""
    room = with_bulb(cornell_box((64, 64)))
    (bulb,) = room.lights
    outside = PointLight("outside", (-4000.0, 278.0, -800.0), (1.6e7,) * 3)
    weak = replace(bulb, intensity=(1e3,) * 3)
    alone, beside = (settled(replace(room, lights=lights), spp=31) for lights in ((bulb,), (weak, outside)))
    assert alone.settings.integrator is Integrator.PHOTONS
    assert beside.settings.integrator is Integrator.PATH


def test_errors_of_caustics_are_held_against_light_with_caustics(monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths find next to none of them: beside the dark that they see there, a caustic is wrong by many times its light.

    Among mirrors about a bulb they were thought to be 1.66 times as wrong.
    """
    found: dict[int, MapError | None] = {}

    def noted(pilot: Any, number: int, *others: Any) -> MapError | None:
        found[number] = map_error(pilot, number, *others)
        return found[number]

    monkeypatch.setattr("wdpm.cluster.plan.integrator_trial.map_error", noted)
    scene, squares = mirrored(with_bulb(SMALL)), []
    for light in (irradiance_by, lambda *_: 0.0):
        monkeypatch.setattr("wdpm.cluster.plan.integrator_trial.irradiance_by", light)
        settled(scene, spp=2, all_effects=True)
        error = found[CAUSTIC_MAP]
        assert error is not None
        squares.append(float(error.squares.mean()))
    assert squares[0] < 0.75 * squares[1]


def test_few_samples_have_fewer_caustic_photons() -> None:
    found = settled(mirrored(with_bulb(cornell_box((32, 24)))), spp=1, all_effects=True)
    assert found.settings.caustic_photons <= RenderSettings.caustic_photons // FEWEST
    assert f"{found.settings.caustic_photons:,} caustic photons" in found.chose[0]


def price(indirect: Indirect, even: float, caustic_k: int, photons: float) -> float:
    """What a small image of 8 samples would cost, with and without caustics to gather."""
    settings = RenderSettings(integrator=Integrator.PHOTONS, indirect=indirect)
    figures = Figures(settings, noise=0.01, of_indirect=0.0, vertices=0.0, light_samples=1, indirect=1.0)
    noises = (np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)))
    trial = Trial(figures, figures, NO_CAUSTICS, even, 0.0, (None, None), 0.0, 0.0, noises, np.full((1, 1), 1.0 - even))
    plans = MapPlans((MapPlan(1000), MapPlan(1000), MapPlan()), caustic_k, (), (photons, 0.0, 0.0))
    return Prices(flatten(SMALL), plans, 8).of_photons(trial, settings)


@pytest.mark.parametrize("indirect", [Indirect.CACHE, Indirect.GATHER])
def test_gather_rays_pay_for_caustics_at_photons_and_not_where_they_arrive(indirect: Indirect) -> None:
    """Camera paths gather them whichever way; what rays read has them in it, but for coats."""
    at_samples = price(Indirect.MAP, 1.0, 50, 4000.0) - price(Indirect.MAP, 1.0, 0, 4000.0)
    whole = price(indirect, 1.0, 50, 4000.0) - price(indirect, 1.0, 0, 4000.0)
    assert at_samples == pytest.approx(SMALL.camera.width * SMALL.camera.height * 8 * GATHER * 50)
    assert whole == pytest.approx(at_samples + irradiance_share(RenderSettings()) * 4000 * GATHER * 50)


def test_gather_rays_from_coats_ask_fewer_caustic_photons() -> None:
    coated = price(Indirect.CACHE, 0.0, 50, 0.0) - price(Indirect.CACHE, 0.0, 0, 0.0)
    at_samples = price(Indirect.MAP, 0.0, 50, 0.0) - price(Indirect.MAP, 0.0, 0, 0.0)
    assert coated == pytest.approx((1.0 + COAT_SHARE) * at_samples)


@pytest.mark.parametrize(("alpha", "told"), [(0.0, True), (0.3, False)], ids=["smooth", "rough"])
def test_caustics_of_rough_metals_are_left_to_the_trial(alpha: float, told: bool) -> None:
    """Shadow rays find lamps by way of a rough metal, so trials see that noise; of a mirror photons have to tell."""
    metal = Conductor(alpha_u=alpha, alpha_v=alpha)
    found = settled(mirrored(with_lamp(SMALL, 0.02), metal), spp=2, all_effects=True)
    assert (" of it by caustics" in found.chose[0]) == told
    assert found.settings.integrator is (Integrator.PHOTONS if told else Integrator.PATH)


def test_bulbs_are_for_paths_where_nothing_mirrors_them() -> None:
    assert settled(with_bulb(SMALL), spp=2, all_effects=True).settings.integrator is Integrator.PATH


@pytest.mark.parametrize("indirect", [Indirect.MAP, Indirect.CACHE])
def test_one_pilot_serves_the_trial_and_the_render(indirect: Indirect) -> None:
    """Its photons are as good for other ways to look at them: neither they nor the trees of the scene are made anew."""
    scene, launcher = cornell_box((64, 64)), Launcher("cpu", 1)
    scene = of_disneys(scene) if indirect is Indirect.MAP else scene
    found = settled(scene, spp=4 if indirect is Indirect.MAP else 16)
    assert found.settings.integrator is Integrator.PHOTONS
    assert found.settings.indirect is indirect
    flat = flatten(scene)
    plan = make_render_plan(flat, found.settings, 1, launcher, None, found.pilot)
    assert found.pilot is not None
    assert plan.pilot is found.pilot.worker
    assert plan.world.features == features_of(flat, found.settings) == plan.pilot.replica.world.features
    anew = make_render_plan(flat, found.settings, 1, launcher)
    assert plan.world.photon_plan == anew.world.photon_plan


def test_what_shadow_rays_learn_serves_the_trial_and_the_render() -> None:
    """Noise of direct light is that of guided rays: without them a room behind a window seems as noisy as by paths."""
    scene, launcher = window_room.room(), Launcher("cpu", 1)
    flat = flatten(replace(scene, camera=replace(scene.camera, width=48, height=36)))
    settings = RenderSettings(spp=4, all_effects=True)
    found = choose_settings(flat, settings, launcher, lambda features: compile_kernels("cpu", features))
    assert found.learnt is not None
    assert len(found.learnt.guide)
    plan = make_render_plan(flat, found.settings, 1, launcher, None, found.pilot, found.learnt)
    anew = make_render_plan(flat, found.settings, 1, launcher)
    assert plan.learnt is found.learnt
    for name, table in vars(anew.learnt.guide).items():
        np.testing.assert_array_equal(getattr(plan.learnt.guide, name), table, err_msg=name)


def test_a_trial_finds_the_same_on_any_number_of_threads() -> None:
    assert settled(LARGE, 1).chose == settled(LARGE, 2).chose


def trial_of(figures: Figures, noise: float) -> Trial:
    """One of an image of which photons leave so much noise, and have some indirect light to show."""
    settings = RenderSettings(integrator=Integrator.PHOTONS, light_samples=4)
    by_photons = Figures(settings, noise=noise, of_indirect=0.0, vertices=0.0, light_samples=4, indirect=0.0)
    noises = (np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)))
    return Trial(by_photons, figures, NO_CAUSTICS, 1.0, 0.0, (None, None), 0.0, 0.0, noises, np.zeros((1, 1)))


def by_paths(noise: float) -> Figures:
    settings = RenderSettings(integrator=Integrator.PATH, light_samples=1)
    return Figures(settings, noise=noise, of_indirect=0.0, vertices=0.5, light_samples=1, indirect=0.1)


def test_whole_paths_are_the_better_use_of_time_where_noise_is_indirect() -> None:
    found = settled(replace(SMALL, camera=replace(SMALL.camera, width=16, height=12)), spp=2, all_effects=True)
    assert found.settings.integrator is Integrator.PATH
    assert found.settings.light_samples == 1


@pytest.mark.parametrize(("noise", "indirect"), [(0.001, Indirect.CACHE), (10.0, Indirect.MAP)])
def test_records_are_made_where_samples_do_not_hide_what_maps_get_wrong(noise: float, indirect: Indirect) -> None:
    """Their gather rays are dear, and beside much grain nobody sees what they are better at."""
    flat = flatten(cornell_box((128, 128)))
    plans = MapPlans((MapPlan(1 << 16), MapPlan(), MapPlan()), 0, (), (250_000.0, 0.0, 0.0))
    trial = trial_of(by_paths(0.5), noise)
    best, words = _best_by_photons(flat, plans, trial, replace(trial.by_photons.settings, spp=4, indirect=Indirect.MAP))
    assert best.settings.indirect is indirect
    assert words.startswith(f"indirect light: {indirect.value}, since error times price, what is seen as patches ")


def photons_of_worth(spp: int, indirect: Indirect, blur: float, of_caustics: float) -> tuple[int, int]:
    """Photons, and caustic photons, of a small image: of a map of such blur, as relMSE, and caustics of such noise."""
    asked = RenderSettings.photons
    plans = MapPlans((MapPlan(asked), MapPlan(asked), MapPlan()), 50, (), (float(asked), float(asked), 0.0))
    of_global = MapError(50, np.full(1, 0.1), np.zeros(1), np.zeros(1), blur * asked, np.full(1, 1e9))
    caustics = replace(of_global, noise=np.full(1, of_caustics), blur=0.0)
    trial = replace(trial_of(by_paths(0.5), 0.001 * spp), map_errors=(of_global, caustics))
    settings = replace(trial.by_photons.settings, spp=spp, indirect=indirect)
    chosen, _, _ = _with_photons_of_worth(flatten(cornell_box((128, 128))), plans, trial, settings)
    return chosen.photons, chosen.caustic_photons


def test_fewer_photons_do_where_gather_rays_average_over_their_patches() -> None:
    assert photons_of_worth(4, Indirect.MAP, 7e-4, 1e-5)[0] == RenderSettings.photons
    assert photons_of_worth(4, Indirect.CACHE, 7e-4, 1e-5)[0] <= RenderSettings.photons // FEWEST


@pytest.mark.parametrize(("of_caustics", "fewer"), [(0.5e-4, True), (3e-4, False)], ids=["faint", "seen"])
def test_caustics_that_are_faint_beside_the_samples_have_fewer_photons_for_little_gain(
    of_caustics: float, fewer: bool
) -> None:
    """Samples leave relMSE 0.001 here."""
    assert (photons_of_worth(32, Indirect.CACHE, 0.1, of_caustics)[1] < RenderSettings.caustic_photons) == fewer


def of_disneys(scene: Scene) -> Scene:
    """The same, all of Disney's material."""
    material = Principled((0.6, 0.6, 0.6), clearcoat=1.0, clearcoat_gloss=1.0)
    return replace(scene, materials=tuple(Material(each.name, material) for each in scene.materials))


def test_records_do_not_serve_disneys_base() -> None:
    found = settled(of_disneys(cornell_box((64, 64))), spp=4)
    assert found.settings.indirect is Indirect.MAP
    assert "indirect light: map, since 100% of what is seen has bumps, sheen or Disney's base" in found.chose


def test_records_are_made_where_hardly_a_photon_comes_to_what_is_seen() -> None:
    """Most gather rays find none and go on; the map that was read there instead was all round spots."""
    found = settled(corridor(), spp=16)
    assert found.settings.integrator is Integrator.PHOTONS
    assert found.settings.indirect is Indirect.CACHE
    assert unread_in(corridor()) > 0.5


def unread_in(scene: Scene) -> float:
    """The share of gather rays that find no irradiance, in a render."""
    done = wdpm.render(scene, spp=16, threads=1).report.final_gather
    assert done is not None
    return done.unread / done.rays


@pytest.mark.parametrize(
    ("unread", "vertices", "chosen"),
    [(0.9, 0.5, Indirect.CACHE), (0.9, 20.0, Indirect.MAP), (0.0, 20.0, Indirect.CACHE)],
    ids=["end soon", "go on for long", "need not go on"],
)
def test_records_are_made_as_rays_that_find_no_photons_are_cheap(
    unread: float, vertices: float, chosen: Indirect
) -> None:
    trial = replace(trial_of(replace(by_paths(0.5), vertices=vertices), 0.001), unread=unread)
    plans = MapPlans((MapPlan(1 << 16), MapPlan(), MapPlan()), 0, (), (250_000.0, 0.0, 0.0))
    flat, by_map = flatten(cornell_box((128, 128))), replace(trial.by_photons.settings, indirect=Indirect.MAP)
    assert _best_by_photons(flat, plans, trial, by_map)[0].settings.indirect is chosen


@pytest.mark.parametrize("bias", [0.0, 3.0])
def test_light_from_behind_walls_is_held_against_the_map_alone(bias: float) -> None:
    """Where a hole in a wall without thickness lights a room, most light of the map was that of the room behind."""
    trial = replace(trial_of(by_paths(0.5), 0.001), bias=bias)
    plans = MapPlans((MapPlan(1 << 16), MapPlan(), MapPlan()), 0, (), (250_000.0, 0.0, 0.0))
    by_map, by_rays = (
        _left_by_map(trial, plans, replace(trial.by_photons.settings, indirect=way), 16)
        for way in (Indirect.MAP, Indirect.CACHE)
    )
    assert by_map == max(bias, LEFT_BY_MAP * trial.by_paths.indirect)
    assert by_rays == LEFT_BY_CACHE * trial.by_paths.indirect


def test_shadow_rays_that_were_asked_for_are_kept() -> None:
    assert settled(SMALL, spp=2, light_samples=3).settings.light_samples == 3


@pytest.mark.parametrize("crop", [None, (100, 50, 300, 200)])
def test_a_trial_looks_at_the_same_picture_in_fewer_pixels(crop: tuple[int, int, int, int] | None) -> None:
    width, height = (512, 384) if crop is None else crop[2:]
    whole = replace(LARGE.camera, width=width, height=height, crop=crop, full_size=crop and (512, 384))
    looks = small_camera(whole, TRIAL_PIXELS)
    assert looks.width * looks.height == pytest.approx(TRIAL_PIXELS, rel=0.05)
    assert looks.width / looks.height == pytest.approx(width / height, rel=0.05)
    if crop is not None:
        assert looks.crop is not None
        assert looks.full_size is not None
        assert looks.crop[0] / looks.full_size[0] == pytest.approx(crop[0] / 512, abs=0.03)
    assert small_camera(replace(LARGE.camera, width=20, height=10), TRIAL_PIXELS).width == 20


@pytest.mark.parametrize("spp", [2, 64])
def test_the_image_is_that_of_the_integrator_that_was_chosen_on_any_cluster(spp: int) -> None:
    """And it says which, and why: in the header's settings, the report and the plan."""
    scene = cornell_box((24, 24))
    alone = wdpm.render(scene, integrator=Integrator.AUTO, spp=spp, threads=1)
    chosen = Integrator(alone.metadata["settings"]["integrator"])
    names = ("light_samples", "photons") if chosen is Integrator.PHOTONS else ("light_samples",)
    known = {name: alone.metadata["settings"][name] for name in names}
    if chosen is Integrator.PHOTONS:
        known["indirect"] = Indirect(alone.metadata["settings"]["indirect"])
    assert alone.digest() == wdpm.render(scene, integrator=chosen, spp=spp, **known).digest()
    shared = render_in_process(scene, RenderSettings(integrator=Integrator.AUTO, spp=spp), workers=2, cells=4)
    assert shared.digest() == alone.digest()
    line = next(line for line in alone.metadata["report"]["chose"] if line.startswith("integrator: "))
    assert line in inspect(scene, slaves=1, integrator=Integrator.AUTO, spp=spp).chose


@pytest.mark.parametrize(
    ("paths", "photons", "words"),
    [
        (Way(0.02, 10.0), Way(0.01, 10.0), "photons, since error times price of path tracing is expected to be 2 of"),
        (Way(0.02, 4.0), Way(0.01, 10.0), "path, since error times price of path tracing is expected to be 0.8 of"),
        (Way(0.02, 4.0, 0.01), Way(0.0, 10.0), "photons, since a trial saw no noise by photons, and by path tracing"),
        (Way(0.0, 4.0), Way(0.01, 10.0), "path, since error times price of path tracing is expected to be 0 of"),
        (Way(0.0, 4.0), Way(0.0, 10.0), "path, since trials saw no noise by either, and path tracing is expected"),
        (Way(0.0, 10.0), Way(0.0, 4.0), "photons, since trials saw no noise by either, and path tracing is expected"),
    ],
)
def test_what_is_chosen_is_said_with_figures_that_are_numbers(paths: Way, photons: Way, words: str) -> None:
    said = words_for(paths, photons)
    assert said.startswith(words)
    assert "inf" not in said
    assert said.startswith("path,") == paths.is_better_than(photons)


def test_where_a_trial_sees_nothing_the_cheaper_way_is_taken() -> None:
    """The camera looks away from all that there is."""
    away = replace(
        SMALL, camera=replace(SMALL.camera, to_world=SMALL.camera.to_world @ np.diag([-1.0, 1.0, -1.0, 1.0]))
    )
    for spp in (2, 64):
        chosen = settled(away, spp=spp)
        assert chosen.settings.integrator is Integrator.PATH
        assert chosen.chose[0].startswith("integrator: path, since trials saw no noise by either")
    assert not wdpm.render(away, spp=2, threads=1).layers["beauty"].any()
