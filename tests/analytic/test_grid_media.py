"""Light in media whose density changes from place to place: formulas, homogeneous media, equilibrium, energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fog import WHITE, foggy, foggy_furnace, single_scattering
from furnaces import Array, box, quad, rendered, scene, view
from path_traced import PATH, mean_and_deviation

from wdpm.report.report import EnergyLedger
from wdpm.scenes.model.bsdfs import Dielectric, Null
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Material, Medium, Scene
from wdpm.scenes.model.transforms import scaling, translation
from wdpm.scenes.model.volumes import Volume

MAPS = {"photons": 0, "volume_photons": 200_000, "spp": 4, "max_depth": 2, "all_effects": True}


def volume(values: Array, low: tuple[float, float, float], size: tuple[float, float, float], **chosen: bool) -> Volume:
    return Volume("grid", values[..., None].astype(np.float32), translation(low) @ scaling(size), **chosen)


def about_all(values: Array) -> Volume:
    """Around the room of half length 1."""
    return volume(values, (-1.1,) * 3, (2.2,) * 3)


def noise(seed: int = 0) -> Array:
    return np.asarray(np.random.default_rng(seed).uniform(0.0, 2.0, (9, 8, 7)))


def smoke_before_a_lamp(smoke: Medium) -> tuple[Scene, Scene]:
    """A lamp of radiance 5 seen through a box of 0.4; and a floor that a point lights through it."""
    cloud = replace(box((0.3, 0.3, 0.2)), material=1, interior=0, bounds=True)
    lamp = quad((-0.3, -0.3, 0.6), (0, 0.6, 0), (0.6, 0, 0), 0, (5.0, 5.0, 5.0))  # faces -z
    what = scene([lamp, cloud], view((0, 0, -1.0), (0, 0, 1), 2, 6, up=(0, 1, 0)), (0.5,) * 3)
    what = replace(what, materials=(*what.materials, Material("nothing", Null())), media=(smoke,))
    floor = quad((-0.01, -0.01, -0.6), (0.02, 0, 0), (0, 0.02, 0))  # faces +z, towards the lamp
    point = PointLight("lamp", (0.0, 0.0, 0.6), (1.0, 1.0, 1.0))
    beside = view((0.5, 0, 0.0), (0, 0, -0.6), 0.5, 6, up=(0, 1, 0))
    return what, replace(what, meshes=(floor, cloud), lights=(point,), camera=beside)


@pytest.mark.parametrize("chosen", [{}, PATH], ids=["photons", "paths"])
def test_a_ramp_takes_what_its_integral_says(chosen: dict[str, object]) -> None:
    """Density from 0 to 4 along the way of 0.4: an optical length of 0.8."""
    ramp = volume(np.broadcast_to(np.linspace(0.0, 4.0, 5)[:, None, None], (5, 2, 2)), (-0.3, -0.3, -0.2), (0.6,) * 3)
    ramp = replace(ramp, to_world=translation((-0.3, -0.3, -0.2)) @ scaling((0.6, 0.6, 0.4)), at_corners=True)
    seen, lit = smoke_before_a_lamp(Medium("smoke", (1.0, 2.0, 3.0), (0.0,) * 3, density=ramp))
    through = np.exp(-0.8 * np.array([1.0, 2.0, 3.0]))
    of_maps = {"photons": 0} if not chosen else {}
    pixels = rendered(seen, spp=1, **{"all_effects": True, **of_maps, **chosen}).pixels.astype(np.float64)
    np.testing.assert_allclose(pixels.mean(axis=(0, 1)), 5.0 * through, rtol=1e-3)
    layers = rendered(lit, spp=1, **{"all_effects": True, **of_maps, **chosen}).layers
    np.testing.assert_allclose(
        layers["direct"].astype(np.float64).mean(axis=(0, 1)), 0.5 / np.pi / 1.2**2 * through, rtol=1e-3
    )


@pytest.mark.parametrize("chosen", [{"photons": 20_000, "volume_photons": 20_000}, PATH], ids=["photons", "paths"])
def test_a_grid_of_one_value_is_the_homogeneous_medium(chosen: dict[str, object]) -> None:
    """The same free paths: the same image, but for the roundings of half a density of twice the extinction."""
    sigma, albedo = np.array([0.2, 0.5, 1.0]), (0.9, 0.8, 0.6)
    half = about_all(np.full((4, 5, 6), 0.5))
    seen = [
        rendered(foggy(medium, 0.5), spp=4, **{"all_effects": True, **chosen})
        for medium in (
            Medium("haze", tuple(sigma), albedo, 0.3),
            Medium("haze", tuple(2 * sigma), albedo, 0.3, half),
        )
    ]
    for layer in ("direct", "indirect", "volume"):
        one, other = (image.layers[layer].astype(np.float64).mean(axis=(0, 1)) for image in seen)
        assert (one > 0).all()
        np.testing.assert_allclose(other, one, rtol=1e-3)


def test_single_scattering_in_a_grid_of_two_halves() -> None:
    """Dense where nothing is lit or seen, and else of density 1: the homogeneous medium's quadrature."""
    values = np.ones((44, 1, 1))
    values[:3] = values[-2:] = 50.0  # behind the camera, and behind the wall
    tinted = Volume("tint", np.broadcast_to(np.float32((0.9, 0.8, 0.6)), (2, 2, 2, 3)), about_all(noise()).to_world)
    medium = Medium("haze", (0.2, 0.5, 1.0), (0.9, 0.8, 0.6), 0.6, replace(about_all(values), nearest=True), tinted)
    image = rendered(foggy(medium, 0.0), **MAPS)
    exact = single_scattering(foggy(Medium("haze", (0.2, 0.5, 1.0), (0.9, 0.8, 0.6), 0.6), 0.0))
    np.testing.assert_allclose(image.layers["volume"].astype(np.float64).mean(axis=(0, 1)), exact, rtol=0.05)


@pytest.mark.parametrize("sigma", [(3.0,) * 3, (0.5, 1.0, 2.0)], ids=["grey", "coloured"])
def test_white_smoke_in_a_furnace_is_not_seen(sigma: tuple[float, float, float]) -> None:
    """Empty here and dense there: all radiance is 2 in equilibrium with the walls."""
    smoke = Medium("smoke", sigma, WHITE, 0.4, about_all(noise() ** 3))
    image = rendered(foggy_furnace(smoke), spp=48, **PATH)
    mean, deviation = mean_and_deviation(image.pixels)
    assert (np.abs(mean - 2.0) <= 4 * deviation).all(), (mean, deviation)
    assert (deviation < 0.1).all()
    assert image.layers["volume"].mean() > 0.2


def test_white_smoke_keeps_all_energy() -> None:
    """Nothing escapes and nothing is absorbed: every weight is 1. All is still under way at the depth limit."""
    smoke = Medium("smoke", (3.0,) * 3, WHITE, 0.5, about_all(noise()))
    image = rendered(foggy(smoke, 1.0), photons=20_000, volume_photons=20_000, spp=1, max_depth=8, all_effects=True)
    energy = EnergyLedger(**image.metadata["report"]["energy"])
    assert energy.imbalance < 1e-5
    assert energy.escaped == 0.0
    assert energy.travelling == pytest.approx(energy.emitted, rel=1e-4)


def test_smoke_absorbs_what_its_albedo_leaves_at_each_place() -> None:
    """A lamp in a dense medium whose albedo is 1/4 on one side and 3/4 on the other: half is absorbed at once."""
    halves = np.where(np.arange(2)[None, None, :] == 0, 0.25, 0.75) * np.ones((2, 2, 1))
    albedo = replace(about_all(halves), nearest=True)
    ink = Medium("ink", (500.0,) * 3, (0.75,) * 3, 0.0, about_all(np.ones((2, 2, 2))), albedo)
    what = foggy(ink, 0.0)
    what = replace(what, lights=(replace(what.lights[0], position=(0.0, 0.1, 0.0)),))
    image = rendered(what, photons=20_000, volume_photons=20_000, spp=1, max_depth=3, all_effects=True)
    energy = EnergyLedger(**image.metadata["report"]["energy"])
    assert energy.imbalance < 1e-5
    assert energy.travelling == pytest.approx(0.5 * energy.emitted, rel=0.02)


def test_huge_ranges_and_empty_space_within_glass() -> None:
    """Densities from 0 over 1e-6 to 1e6 in a ball of glass: finite everywhere, and no energy is lost."""
    rng = np.random.default_rng(3)
    values = 10.0 ** rng.uniform(-6.0, 6.0, (12, 12, 12)) * (rng.random((12, 12, 12)) > 0.5)
    smoke = Medium("soot", (1.0, 0.3, 0.1), (0.9, 0.5, 1.0), -0.3, volume(values, (-0.4,) * 3, (0.8,) * 3))
    glass = replace(box((0.4, 0.4, 0.4)), material=1, interior=0, bounds=True)
    room = box((1, 1, 1), inside=True)
    lamp = PointLight("lamp", (0.7, 0.7, -0.7), (1.0, 1.0, 1.0))
    what = scene([room, glass], view((0.1, 0.3, -0.95), (0, 0, 0), 70), (0.5,) * 3, (lamp,))
    what = replace(what, materials=(*what.materials, Material("glass", Dielectric(1.5))), media=(smoke,))
    for chosen in ({"photons": 20_000, "caustic_photons": 5_000, "volume_photons": 20_000, "all_effects": True}, PATH):
        image = rendered(what, spp=4, **chosen)
        assert image.pixels.mean() > 0.001
        assert EnergyLedger(**image.metadata["report"]["energy"]).imbalance < 1e-5
