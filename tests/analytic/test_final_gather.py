"""Final gathering where its light is known: furnaces, light in two rooms, the expectation of path tracing.

All are rendered with the kernels that have all effects: nothing is compiled for one test.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import Array, box, quad, rendered, scene, view
from test_effect_furnaces import CASES, SKY
from test_path_tracing import assert_alike, furnace, over_seeds, shiny_box
from test_path_tracing_media import furnace as foggy_furnace

from wdpm.kernels.settings import Indirect, Integrator
from wdpm.scenes import cornell_box
from wdpm.scenes.bsdfs import BumpMap, Diffuse, TwoSided
from wdpm.scenes.model import Material, Medium, Mesh, Scene
from wdpm.scenes.primitives import sphere
from wdpm.scenes.textures import Bitmap

WAYS = [Indirect.GATHER, Indirect.CACHE]

PHOTONS = {"all_effects": True, "photons": 30_000, "caustic_photons": 20_000, "volume_photons": 20_000}
PATH = {"all_effects": True, "integrator": Integrator.PATH}

PHOTON_NOISE = 0.012
"""Of the mean of a furnace: 30,000 photons, and the rays of 64 pixels; three deviations."""


def mean(pixels: object) -> Array:
    """By channel."""
    return np.asarray(pixels, np.float64).mean(axis=(0, 1))


@pytest.fixture(params=WAYS, ids=lambda way: way.value)
def way(request: pytest.FixtureRequest) -> Indirect:
    return Indirect(request.param)


# Furnaces


@pytest.mark.parametrize("albedo", [0.2, 0.8])
def test_a_closed_furnace(way: Indirect, albedo: float) -> None:
    """Radiance is emission / (1 - albedo) everywhere, and each layer has its share of the series."""
    image = rendered(furnace(albedo), indirect=way, spp=64, **PHOTONS)
    exact = 1.0 / (1.0 - albedo)
    np.testing.assert_allclose(mean(image.pixels), exact, rtol=PHOTON_NOISE)
    # Of the indirect light, albedo² and on, it is the photons alone that are not exact.
    np.testing.assert_allclose(mean(image.layers["indirect"]), albedo**2 * exact, rtol=2 * PHOTON_NOISE)


@pytest.mark.parametrize("max_depth", [1, 2, 3, 4, 6])
def test_a_furnace_by_number_of_edges(way: Indirect, max_depth: int) -> None:
    """Every further edge adds albedo times as much: no light is longer than it may be."""
    image = rendered(furnace(0.5), indirect=way, spp=64, max_depth=max_depth, **PHOTONS)
    exact = sum(0.5**edge for edge in range(max_depth))
    np.testing.assert_allclose(mean(image.pixels), exact, rtol=PHOTON_NOISE)
    assert image.layers["indirect"].any() == (max_depth > 2)


@pytest.mark.parametrize("name", ["mirror", "glass", "pane", "rough metal, GGX", "plastic", "blend", "white metal"])
def test_a_white_ball_in_a_furnace_is_not_seen(way: Indirect, name: str) -> None:
    """Light that lamps send through or off the ball onto the walls counts once: by the caustic map or by a ray."""
    data = sphere(48)
    ball = Mesh("ball", data.vertices * 0.45, data.faces, data.normals, data.uvs, 1)
    image = rendered(furnace(0.5, (ball, CASES[name])), indirect=way, spp=64, **PHOTONS)
    np.testing.assert_allclose(mean(image.pixels), 2.0, rtol=2 * PHOTON_NOISE)


@pytest.mark.parametrize("towards", [(1.0, 1.0, 1.0), (1.0, -1.0, 0.0), (-1.0, -1.0, -1.0)])
def test_edges_and_corners_are_as_bright_as_walls(way: Indirect, towards: tuple[float, float, float]) -> None:
    """Rays that are shorter than the radius of what they would read go on; none is lost on the way."""
    what = replace(furnace(0.5), camera=view(0.6 * np.array(towards), towards, 40))
    image = rendered(what, indirect=way, spp=64, **PHOTONS)
    np.testing.assert_allclose(mean(image.pixels), 2.0, rtol=2 * PHOTON_NOISE)


# Two rooms


def two_rooms(wall: float, camera_in: int) -> Scene:
    """Two closed rooms, their walls `wall` apart; one glows with 1, the other with 0.01."""
    meshes = [
        box((1.0, 1.0, 1.0), (-1.0 - wall / 2, 0, 0), inside=True, emission=(1.0,) * 3),
        box((1.0, 1.0, 1.0), (1.0 + wall / 2, 0, 0), inside=True, emission=(0.01,) * 3),
    ]
    side = (-1.0, 1.0)[camera_in]
    return scene(meshes, view((side * 1.8, 0.1, 0.2), (0.0, -0.3, 0.1), 60, 12), (0.5,) * 3)


@pytest.mark.parametrize("wall", [0.1, 1e-3, 0.0])
def test_nothing_leaks_from_room_to_room(way: Indirect, wall: float) -> None:
    """A hundredth of the bright room's light in the dark one would double its own."""
    for number, glow in enumerate((1.0, 0.01)):
        image = rendered(two_rooms(wall, number), indirect=way, spp=16, **{**PHOTONS, "photons": 60_000})
        np.testing.assert_allclose(mean(image.pixels), 2.0 * glow, rtol=0.05)
        assert image.pixels.max() < 2.5 * glow


# Against path tracing


@pytest.mark.parametrize("max_depth", [3, 4, None])
def test_light_of_a_cornell_box_is_that_of_path_tracing(way: Indirect, max_depth: int | None) -> None:
    what = cornell_box((16, 16))
    gathered = over_seeds(what, "indirect", spp=32, indirect=way, max_depth=max_depth, **PHOTONS)
    assert_alike(over_seeds(what, "indirect", spp=96, max_depth=max_depth, **PATH), gathered, share=0.01)


def test_plastic_and_metal_are_lit_as_by_path_tracing(way: Indirect) -> None:
    """What lamps send off metal onto walls is in the caustic layer."""
    gathered = over_seeds(shiny_box(), "indirect caustic", spp=32, indirect=way, **PHOTONS)
    assert_alike(over_seeds(shiny_box(), "indirect", spp=96, **PATH), gathered, share=0.01)


def bumpy_box() -> Scene:
    """The Cornell box without its ceiling under a sky, one block of bumps and one whose interpolated normals turn."""
    what = cornell_box((16, 16))
    slopes = Bitmap("slopes", np.random.default_rng(4).random((8, 8, 3)).astype(np.float32))
    bumps = Material("bumps", TwoSided(BumpMap(Diffuse((0.6, 0.5, 0.4)), slopes, 30.0)))
    new = {"tall block": len(what.materials)}
    meshes = [replace(mesh, material=new.get(mesh.name, mesh.material)) for mesh in what.meshes]
    open_above = tuple(mesh for mesh in meshes if mesh.name not in ("ceiling", "light"))
    return replace(what, meshes=open_above, materials=(*what.materials, bumps), lights=(SKY,))


def test_bumps_under_a_sky_are_lit_as_by_path_tracing(way: Indirect) -> None:
    gathered = over_seeds(bumpy_box(), "indirect", spp=32, indirect=way, **PHOTONS)
    assert_alike(over_seeds(bumpy_box(), "indirect", spp=64, **PATH), gathered, share=0.015)


# Media


def test_white_fog_in_a_furnace_is_not_seen(way: Indirect) -> None:
    """Gather rays find the light of media on their way, once; the walls reflect half of all."""
    what = foggy_furnace(Medium("fog", (0.5, 0.5, 0.5), (1.0, 1.0, 1.0), 0.2))
    image = rendered(what, indirect=way, spp=32, **PHOTONS)
    np.testing.assert_allclose(mean(image.pixels), 2.0, rtol=0.03)


# Nothing to gather


def test_the_lamp_is_seen_by_the_camera_and_by_no_gather_ray(way: Indirect) -> None:
    """A black room with a lamp has no indirect light at all."""
    lamp = quad((-0.3, 0.98, -0.3), (0.6, 0, 0), (0, 0, 0.6), emission=(8.0, 8.0, 8.0))
    room = scene([box((1, 1, 1), inside=True), lamp], view((0, 0, -0.9), (0, 0.3, 1), 80), (0.0,) * 3)
    image = rendered(room, indirect=way, spp=16, **PHOTONS)
    assert not image.layers["indirect"].any()
    assert image.pixels.max() == 8.0
