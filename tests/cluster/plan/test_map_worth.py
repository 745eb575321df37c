"""Photon maps by what they are worth: none where the pilot finds no photon, fewer paths for light that nobody sees."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from tests.helpers.effect_scenes import Builder, camera
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.map_plans import POINTS_IN_DISC, MapPlans, map_plans
from wdpm.cluster.plan.map_worth import LEAST_K, LEAST_PATHS, PATHS_A_PHOTON, PLAIN_SHARE, MapWorth, fewer_neighbours
from wdpm.cluster.plan.photon_pilot import PILOT_PATHS, fly_pilot
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.inspection.inspect import inspect
from wdpm.kernels.launch import Launcher
from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.meshes.primitives import cube, rectangle
from wdpm.scenes.model.bsdfs import Diffuse, Plastic
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Scene

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


@cache
def plans_of(size: float | None) -> MapPlans:
    scene = alone() if size is None else on_a_floor(size)
    flat = flatten(scene)
    return map_plans(fly_pilot(flat, features_of(flat, SETTINGS), SETTINGS, Launcher("cpu")), SETTINGS, flat)


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
    assert area / caustic.point_area == pytest.approx(POINTS_IN_DISC * discs, rel=1e-3)


def test_inspect_tells_of_a_map_that_is_not_worth_it() -> None:
    inspection = inspect(alone(), slaves=1, all_effects=True)
    caustics = next(effect for effect in inspection.effects if effect.name == "caustic photon map")
    assert (caustics.called, caustics.on, caustics.spared, caustics.left_out) == (True, False, True, False)
    assert any(line.startswith("caustics: no map") for line in inspection.chose)
