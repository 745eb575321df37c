"""Photon maps by what they are worth: none where the pilot finds no photon, fewer paths for light that nobody sees."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.helpers.effect_scenes import Builder, camera
from wdpm.cluster.batch import take
from wdpm.cluster.plan import map_worth
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.map_plans import (
    CAUSTIC_POINTS_IN_DISC,
    POINTS_A_DISC,
    POINTS_FOR_DISCS,
    MapPlans,
    map_plans,
    point_area,
    volume_unit,
)
from wdpm.cluster.plan.map_worth import (
    BLUR_K,
    FAINTEST,
    FEWEST,
    GATHERED_BLUR,
    LEAST_K,
    LEAST_PATHS,
    ORDINARY_BLUR,
    PATHS_A_PHOTON,
    PLAIN_SHARE,
    MapError,
    MapWorth,
    best_shares,
    fewer_neighbours,
    fewer_shares,
    map_error,
)
from wdpm.cluster.plan.photon_pilot import PILOT_PATHS, fly_pilot
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.inspection.inspect import inspect
from wdpm.kernels.launch import Launcher
from wdpm.kernels.limits import POINTS_A_PHOTON, POINTS_MOST
from wdpm.kernels.photons.flight import BOUNCE_BITS
from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.meshes.primitives import cube, rectangle
from wdpm.scenes.model.bsdfs import Diffuse, Plastic
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Medium, Scene

LIGHT = PointLight("point", (0.3, 0.8, -0.6), (3.0, 3.0, 3.0))
SETTINGS = RenderSettings(indirect=Indirect.MAP, all_effects=True)  # kernels that other tests compile


def alone() -> Scene:
    """A cube with a coat and nothing else: no light can come off it to anything."""
    b = Builder()
    b.add("cube", Plastic((0.6, 0.6, 0.6)), cube(), (0.0, -0.4, 0.3), 0.3, 30.0, flat=True)
    return b.scene("alone", camera(), LIGHT)


def on_a_floor(size: float) -> Scene:
    """The same high above a floor of that half side, which it throws a faint gleam on."""
    b = Builder()
    b.add("cube", Plastic((0.6, 0.6, 0.6)), cube(), (0.0, -0.4, 0.3), 0.3, 30.0, flat=True)
    floor = rectangle()
    flat = replace(floor, vertices=floor.vertices[:, [0, 2, 1]] * (1, 1, -1), normals=None)  # faces +y
    b.add("floor", Diffuse((0.5, 0.5, 0.5)), flat, (0.0, -0.9, 0.3), size)
    return b.scene("on_a_floor", camera(), LIGHT)


def lit_beside(power: float) -> Scene:
    """The same with a second lamp, low over the floor and to the side of the cube."""
    scene = on_a_floor(3.0)
    return replace(scene, lights=(LIGHT, PointLight("beside", (1.5, -0.85, 0.3), (power,) * 3)))


@cache
def plans_of(size: float | None) -> MapPlans:
    scene = alone() if size is None else on_a_floor(size)
    flat = flatten(scene)
    return plans_for(flat, SETTINGS)


def plans_for(flat: FlatScene, settings: RenderSettings) -> MapPlans:
    return map_plans(fly_pilot(flat, features_of(flat, settings), settings, Launcher("cpu")), settings, flat)


def test_a_map_that_no_path_of_the_pilot_stores_in_is_not_made_and_the_plan_says_so() -> None:
    plans = plans_of(None)
    assert plans.maps[1].paths == 0
    assert plans.chose == (
        f"caustics: no map, since none of {PILOT_PATHS:,} paths aimed at glossy surfaces stored a photon "
        "(less than 0.01% of them do)",
    )


def test_a_map_whose_light_is_seen_has_all_its_paths() -> None:
    plans = plans_of(3.0)
    assert plans.maps[1].paths > SETTINGS.caustic_photons
    assert plans.caustic_k == SETTINGS.caustic_k


@pytest.mark.parametrize("stored", [1, 2, 5])
def test_gathers_reach_as_far_as_photons_lie_apart_however_few_the_pilot_stored(stored: int) -> None:
    """Narrower ones show each photon of a sparse caustic map as a bright disc by itself."""
    flat = flatten(on_a_floor(3.0))
    pilot = fly_pilot(flat, features_of(flat, SETTINGS), SETTINGS, Launcher("cpu"))

    def spread(photons: int) -> float:
        """Area of the widest gather by photon that it looks for, times photons: how far these lie apart."""
        chosen = np.linspace(0, len(pilot.photons[1]["id"]) - 1, photons + 2)[1:-1].astype(np.intp)
        few = replace(pilot, photons=[pilot.photons[0], take(pilot.photons[1], chosen), pilot.photons[2]])
        plans = map_plans(few, SETTINGS, flat)
        return plans.maps[1].radius ** 2 * plans.expected[1] / plans.caustic_k

    assert 0.1 < spread(stored) / spread(17) < 10.0


def test_a_faint_caustic_has_fewer_paths_and_the_plan_says_so_and_one_that_is_most_of_the_light_has_all() -> None:
    """The lamp beside the cube is weak, or makes a bright gleam on the floor."""
    faint, bright = (plans_for(flatten(lit_beside(power)), SETTINGS) for power in (0.3, 30.0))
    most = PATHS_A_PHOTON * SETTINGS.caustic_photons
    assert SETTINGS.caustic_photons <= faint.maps[1].paths < most / 4
    assert faint.chose[0].startswith(f"caustics: {faint.maps[1].paths:,} paths for some ")
    assert bright.maps[1].paths == most
    assert bright.chose == ()


@pytest.mark.parametrize(
    ("stored", "share", "most"),
    [(0, 0.0, 0.0), (20, 1.0, PATHS_A_PHOTON), (20, PLAIN_SHARE, PATHS_A_PHOTON), (20, 0.5 * PLAIN_SHARE, 2.5)],
)
def test_paths_go_by_the_square_of_the_share_of_light(stored: int, share: float, most: float) -> None:
    assert MapWorth(stored, share).paths_a_photon == most
    assert MapWorth(stored, share).paths(100_000, PILOT_PATHS) == 100_000 * most


def test_faint_light_has_a_path_for_each_photon_and_no_more_than_it_needs() -> None:
    assert MapWorth(20, 1e-4).paths(100_000, PILOT_PATHS) == 100_000
    assert MapWorth(20, 1e-4).paths(5000, PILOT_PATHS) == LEAST_PATHS
    assert MapWorth(20, 1e-4).paths(1000, PILOT_PATHS) == 1000 * PATHS_A_PHOTON
    assert MapWorth(2 * PILOT_PATHS, 1e-4).paths(1000, PILOT_PATHS) == 500


def test_gathers_of_few_photons_look_for_fewer() -> None:
    assert fewer_neighbours(50, 1e5) == 50
    assert fewer_neighbours(50, 400) == 25
    assert fewer_neighbours(50, 10) == LEAST_K
    assert fewer_neighbours(4, 10) == 4


def test_wide_gathers_of_few_photons_count_no_more_surface_than_they_need() -> None:
    flat = flatten(on_a_floor(3.0))
    settings = replace(SETTINGS, caustic_photons=200, caustic_radius=1.5)
    pilot = fly_pilot(flat, features_of(flat, settings), settings, Launcher("cpu"))
    caustic = map_plans(pilot, settings, flat).maps[1]
    area = float(triangle_areas(flat.triangles.positions).sum())
    discs = area / (3.14159 * caustic.radius**2)
    assert area / caustic.point_area == pytest.approx(CAUSTIC_POINTS_IN_DISC * discs, rel=1e-3)


def test_gathers_that_reach_beyond_the_scene_count_enough_of_it() -> None:
    flat = flatten(on_a_floor(3.0))
    settings = replace(SETTINGS, caustic_photons=1, caustic_radius=1e6)
    caustic = plans_for(flat, settings).maps[1]
    area = float(triangle_areas(flat.triangles.positions).sum())
    assert area / caustic.point_area == pytest.approx(CAUSTIC_POINTS_IN_DISC, rel=1e-3)


def test_gathers_of_a_few_bright_spots_do_not_fill_memory_with_points() -> None:
    area, photons = 24.0, 1e5
    discs = 0.5 * POINTS_FOR_DISCS / POINTS_A_DISC
    radius = np.sqrt(area / (np.pi * discs))
    assert area / point_area(area, radius, photons) == pytest.approx(POINTS_A_DISC * discs)
    assert area / point_area(area, radius / 10, photons) == pytest.approx(POINTS_FOR_DISCS)
    many = 0.75 * POINTS_FOR_DISCS  # of so many photons there are as many points as ever
    assert area / point_area(area, radius / 10, many) == pytest.approx(POINTS_A_PHOTON * many)
    assert area / point_area(area, radius / 10, 10 * POINTS_MOST) == pytest.approx(POINTS_MOST)


@pytest.mark.parametrize("photons", [1, 20, 1000])
def test_a_map_of_as_many_photons_as_were_asked_for_is_gathered_by_the_k_that_was_asked_for(
    monkeypatch: pytest.MonkeyPatch, photons: int
) -> None:
    monkeypatch.setattr(map_worth, "PATHS_A_PHOTON", 1000)
    settings = replace(SETTINGS, caustic_photons=photons, caustic_k=500)
    assert plans_for(flatten(on_a_floor(3.0)), settings).caustic_k == 500


def test_a_map_of_fewer_photons_than_were_asked_for_is_gathered_by_a_smaller_k() -> None:
    settings = replace(SETTINGS, caustic_photons=1000, caustic_k=500)
    flat = flatten(on_a_floor(3.0))
    pilot = fly_pilot(flat, features_of(flat, settings), settings, Launcher("cpu"))
    plans = map_plans(pilot, settings, flat)
    expected = len(pilot.photons[1]["id"]) * plans.maps[1].paths / pilot.paths
    assert expected < 1000
    assert plans.caustic_k == fewer_neighbours(500, expected) < 500


@pytest.mark.parametrize(
    ("albedo", "photons", "made"), [(1.0, 2000, True), (0.0, 2000, False), (1.0, 0, False)], ids=str
)
def test_what_no_path_of_the_pilot_scattered_in_is_stored_from_if_it_may_scatter(
    albedo: float, photons: int, made: bool
) -> None:
    thin = Medium("thin", (1e-9,) * 3, (albedo,) * 3)  # what left the room would scatter in it sooner or later
    b = Builder()
    b.room(Diffuse((0.5, 0.5, 0.5)))
    b.add("cube", Plastic((0.6, 0.6, 0.6)), cube(), (0.0, -0.4, 0.3), 0.3, 30.0, flat=True)
    scene = b.scene("closed", camera(medium=0), LIGHT, media=(thin,))
    flat, settings = flatten(scene), replace(SETTINGS, volume_photons=photons)
    pilot = fly_pilot(flat, features_of(flat, settings), settings, Launcher("cpu"))
    assert not len(pilot.photons[2]["id"])
    maps = map_plans(pilot, settings, flat).maps
    assert maps[0].paths > 0
    assert maps[2].paths == (maps[0].paths if made else 0)
    assert volume_unit(pilot.photons, maps[2], flat) < 1e-6  # what one of them brings is far above it


def test_beams_in_fog_without_bounds_are_as_narrow_as_photons_lie_dense_where_the_scene_is() -> None:
    """Most photons of the lamp scatter far from it, ten times as far apart as those between it and the floor."""
    scene = on_a_floor(3.0)
    scene = replace(scene, media=(Medium("thin", (0.01,) * 3, (0.8,) * 3),), camera=replace(scene.camera, medium=0))
    flat, settings = flatten(scene), replace(SETTINGS, volume_photons=200_000)
    pilot = fly_pilot(flat, features_of(flat, settings), settings, Launcher("cpu"))
    far = np.abs(pilot.photons[2]["position"]).max(axis=1) > 10.0 * flat.extent
    assert far.mean() > 0.5
    plan = map_plans(pilot, settings, flat).maps[2]
    near = np.abs(pilot.photons[2]["position"]).max(axis=1) <= flat.extent
    in_ball = near.sum() * plan.paths / pilot.paths * plan.radius**3 * np.pi / 6.0  # were they even in the scene's cube
    assert 10 < in_ball < 400


def test_inspect_tells_of_a_map_that_is_not_worth_it() -> None:
    inspection = inspect(alone(), slaves=1, all_effects=True, integrator=Integrator.PHOTONS)
    caustics = next(effect for effect in inspection.effects if effect.name == "caustic photon map")
    assert (caustics.called, caustics.on, caustics.spared, caustics.left_out) == (True, False, True, False)
    assert any(line.startswith("caustics: no map") for line in inspection.chose)


def test_noise_of_a_map_falls_with_its_photons_where_a_pixel_s_samples_ask_different_ones() -> None:
    """In a pixel smaller than a gather all samples have the same noise, however many photons there are."""
    small, large = (
        MapError(50, np.ones(3), np.full(3, 0.02), np.full(3, discs), 0.0, np.full(3, 99.0)) for discs in (0.0, 1e-3)
    )
    assert small.of(1000, 16) == small.of(100_000, 16) == pytest.approx(1 / 50)
    assert large.of(1000, 16) == pytest.approx(1 / 50 / 2)
    assert large.of(1_000_000, 16) == pytest.approx(1 / 50 / 16)
    assert large.of(1_000_000, 1) == pytest.approx(1 / 50)
    blurred = replace(small, blur=10.0)
    blur = blurred.of(1000, 4) - small.of(1000, 4)
    assert blur == pytest.approx(0.01) == pytest.approx(2 * (blurred.of(2000, 4) - small.of(2000, 4)))
    assert blurred.of(1000, 4, gathered=True) - small.of(1000, 4, gathered=True) == pytest.approx(GATHERED_BLUR * blur)
    assert small.of(1000, 4, gathered=True) == pytest.approx(1 / 1000)  # all of its photons, by way of many gathers


def test_light_that_wide_gathers_miss_counts_all_the_same() -> None:
    error = MapError(50, np.full(3, 0.5), np.full(3, 0.01), np.zeros(3), 10.0, np.full(3, 99.0))
    more, same = error.of_light(2.0), error.of_light(0.1)
    assert more.of(1000, 4) == pytest.approx(4 * error.of(1000, 4))
    assert same.of(1000, 4) == error.of(1000, 4)


def error_on_a_floor(edge: float, count: int = 32_000, strong: int = 1) -> MapError | None:
    """At places about the middle of a unit square of which photons fall on the part up to x = edge, evenly.

    Args:
        strong: one in so many brings all the light.
    """
    random = np.random.default_rng(3)
    position = np.zeros((count, 3), np.float32)
    position[:, :2] = random.random((count, 2)) * (edge, 1.0)
    up = np.tile(np.float32([0.0, 0.0, 1.0]), (count, 1))
    photons = {"id": np.arange(count) << BOUNCE_BITS, "position": position, "normal": up, "flux": np.zeros_like(up)}
    photons["flux"][::strong] = strong
    pilot: Any = SimpleNamespace(
        photons=[photons],
        world=SimpleNamespace(maps=[SimpleNamespace(paths=count)], extent=2.0),
        cell=SimpleNamespace(replica=SimpleNamespace(launcher=Launcher("cpu", 1))),
    )
    places = np.zeros((1024, 3), np.float32)
    places[:, :2] = 0.3 + 0.4 * random.random((1024, 2))
    facing = np.tile(up[:1], (len(places), 1))
    return map_error(pilot, 0, 50, places, facing, np.ones(1024), np.full(1024, 1e-4), 2.0)


def test_blur_is_told_from_noise() -> None:
    """Where light is even, gathers by many and by few differ by noise alone; where it has an edge, by blur as well."""
    even, edged = error_on_a_floor(1.0), error_on_a_floor(0.5)
    assert even is not None
    assert edged is not None
    assert np.sqrt(even.squares.mean()) == pytest.approx(1.0, rel=0.1)  # each photon has a unit of flux, of a path
    assert even.blur / 32_000 < 0.002 * even.squares.mean() / even.k
    assert edged.blur / 32_000 > 0.005 * edged.squares.mean() / edged.k
    assert even.noise.mean() == pytest.approx(even.squares.mean() / even.k, rel=0.1)
    assert even.held.mean() == pytest.approx(np.pi * 2.0**2 * 32_000, rel=0.2)
    gather = 50 / 32_000
    assert even.discs.mean() * 32_000 == pytest.approx(1e-4 / gather, rel=0.2)


@pytest.mark.parametrize("strong", [7, 49])
def test_few_photons_that_bring_all_the_light_are_noisier_than_many(strong: int) -> None:
    """As those of a strong lamp outside are, that come through a window, among those of a weak one in the room."""
    uneven = error_on_a_floor(1.0, strong=strong)
    assert uneven is not None
    assert uneven.noise.mean() == pytest.approx(strong / uneven.k, rel=0.2)
    gathered = uneven.of(1000, 4, gathered=True) - GATHERED_BLUR * min(uneven.blur / 1000, uneven.squares.mean())
    assert gathered == pytest.approx(strong / 1000, rel=0.2)


def test_where_the_widest_gather_holds_few_photons_noise_is_theirs() -> None:
    """And blur is less, as it reaches less far."""
    full = MapError(50, np.ones(3), np.full(3, 0.02), np.zeros(3), 0.0, np.full(3, 99.0))
    sparse = replace(full, held=np.full(3, 5.0))
    assert sparse.of(1000, 4) == pytest.approx(10 * full.of(1000, 4))
    assert sparse.of(1000, 4, gathered=True) == pytest.approx(10 * full.of(1000, 4, gathered=True))
    blur = replace(full, blur=10.0).of(1000, 4) - full.of(1000, 4)
    assert replace(sparse, blur=10.0).of(1000, 4) - sparse.of(1000, 4) == pytest.approx(blur / 10)


@pytest.mark.parametrize("count", [2 * BLUR_K, 2 * BLUR_K * LEAST_K, 2 * BLUR_K * 50 - 1])
def test_of_few_photons_blur_is_thought_to_be_that_of_an_ordinary_room(count: int) -> None:
    even = error_on_a_floor(1.0, count)
    assert even is not None
    assert np.sqrt(even.squares.mean()) == pytest.approx(1.0, rel=0.7)
    assert even.discs.mean() == pytest.approx(1e-4 / 50, rel=0.7)
    assert even.blur >= ORDINARY_BLUR * even.k * even.squares.mean()
    assert even.of(even.k, 1) == pytest.approx(even.squares.mean() * (1.0 + 1.0 / even.k), rel=0.05)


def test_of_hardly_any_photons_nothing_is_told() -> None:
    assert error_on_a_floor(1.0, 2 * BLUR_K - 1) is None


def test_light_that_is_faint_beside_the_noise_of_samples_may_have_the_fewest_photons() -> None:
    """And never so few that some gathers would be all that there is."""
    error, many = MapError(50, np.ones(3), np.full(3, 0.02), np.zeros(3), 0.0, np.full(3, 99.0)), 250_000.0
    usual = tuple(share for share in (1, 2, 4, 8) if share <= FEWEST)
    assert fewer_shares(error, many, 16, 0.1, gathered=False) == usual
    assert error.is_faint(many, 16, 1.0)
    assert not error.is_faint(many, 16, 0.1)
    assert fewer_shares(error, many, 16, 1.0, gathered=False)[-1] == FAINTEST
    assert fewer_shares(error, 3200.0, 16, 1.0, gathered=False)[-1] == 16
    assert fewer_shares(replace(error, blur=1e4), many, 16, 1.0, gathered=False) == usual
    assert fewer_shares(replace(error, blur=1e4), many, 16, 2.0, gathered=True)[-1] == FAINTEST


@pytest.mark.parametrize(
    ("worths", "seen", "best"),
    [
        ({(1,): 1.0, (2,): 0.85, (4,): 0.8}, [], (4,)),
        ({(1,): 1.0, (2,): 0.85, (4,): 0.8}, [(2,), (4,)], (1,)),
        ({(1,): 1.0, (2,): 0.85, (4,): 0.8}, [(4,)], (2,)),
        ({(1,): 1.0, (2,): 0.65, (4,): 0.6}, [(2,), (4,)], (4,)),
        ({(1,): 1.0, (2,): 0.61, (4,): 0.6}, [(2,), (4,)], (2,)),
        ({(1,): 1.0, (2,): 0.95, (4,): 0.92}, [], (1,)),
        ({(1, 1): 1.0, (1, 4): 0.75, (4, 1): 0.8, (4, 4): 0.71}, [(1, 4), (4, 4)], (4, 1)),
    ],
)
def test_maps_whose_patches_nobody_sees_have_fewer_photons_for_less_gain(
    worths: dict[tuple[int, ...], float], seen: list[tuple[int, ...]], best: tuple[int, ...]
) -> None:
    """And more are taken where they bring about as much."""
    assert best_shares(worths, seen.__contains__) == best
