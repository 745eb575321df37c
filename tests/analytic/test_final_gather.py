"""Final gathering where its light is known: furnaces, light in two rooms, the expectation of path tracing.

All are rendered with the kernels that have all effects: nothing is compiled for one test.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from fog import foggy_furnace
from furnace_cases import CASES, SKY
from furnaces import Array, box, quad, rendered, scene, view
from path_traced import assert_alike, furnace, over_seeds, shiny_box

from wdpm.cluster.render_settings import Indirect, Integrator
from wdpm.scenes import cornell_box
from wdpm.scenes.meshes.primitives import cube, sphere
from wdpm.scenes.model.bsdfs import BumpMap, Diffuse, TwoSided
from wdpm.scenes.model.scene import Material, Medium, Mesh, Scene
from wdpm.scenes.model.textures import Bitmap

WAYS = [Indirect.GATHER, Indirect.CACHE]

PHOTONS = {"all_effects": True, "photons": 20_000, "caustic_photons": 10_000, "volume_photons": 10_000}
PATH = {"all_effects": True, "integrator": Integrator.PATH}


def assert_indirect(what: Scene, exact: float, **chosen: object) -> None:
    """The mean of indirect light agrees within the deviation of seeds, and 2 %.

    Many samples: next to a wall that glows the light of one shadow ray has no bounded variance, and means of few lie
    below what is expected. Direct light is the same bits as with the map, whose tests it is left to.
    """
    found = over_seeds(what, "indirect", **{"spp": 128, "light_samples": 1, **PHOTONS, **chosen})
    assert_alike((np.full(3, exact), np.zeros(3)), found, share=0.02)
    assert (found[1] <= 0.05 * exact).all()


@pytest.fixture(params=WAYS, ids=lambda way: way.value)
def way(request: pytest.FixtureRequest) -> Indirect:
    return Indirect(request.param)


# Furnaces


def test_a_closed_furnace(way: Indirect) -> None:
    """Radiance is emission / (1 - albedo) everywhere; what is emitted and reflected once is not indirect."""
    assert_indirect(furnace(0.8), 0.8**2 / (1.0 - 0.8), indirect=way)


@pytest.mark.parametrize("max_depth", [2, 3, 6])
def test_a_furnace_by_number_of_edges(way: Indirect, max_depth: int) -> None:
    """Every further edge adds albedo times as much: no light is longer than it may be."""
    exact = sum(0.5**edge for edge in range(2, max_depth))
    assert_indirect(furnace(0.5), exact, indirect=way, max_depth=max_depth)


@pytest.mark.parametrize("name", ["mirror", "glass", "pane", "rough metal, GGX", "plastic", "blend", "white metal"])
def test_a_white_ball_in_a_furnace_is_not_seen(way: Indirect, name: str) -> None:
    """Light that lamps send through or off the ball onto the walls counts once: by the caustic map or by a ray."""
    data = sphere(48)
    ball = Mesh("ball", data.vertices * 0.45, data.faces, data.normals, data.uvs, 1)
    image = rendered(furnace(0.5, (ball, CASES[name])), indirect=way, spp=64, **PHOTONS)
    np.testing.assert_allclose(image.pixels.mean(axis=(0, 1), dtype=np.float64), 2.0, rtol=0.03)


@pytest.mark.parametrize("towards", [(1.0, 1.0, 1.0), (1.0, -1.0, 0.0)])
def test_edges_and_corners_are_as_bright_as_walls(way: Indirect, towards: tuple[float, float, float]) -> None:
    """Rays that are shorter than the radius of what they would read go on; none is lost on the way."""
    what = replace(furnace(0.5), camera=view(0.6 * np.array(towards), towards, 40))
    assert_indirect(what, 0.5, indirect=way)


# Two rooms


def two_rooms(wall: float, camera_in: int) -> Scene:
    """Two closed rooms, their walls `wall` apart; one glows with 1, the other, lower and narrower, with 0.01.

    No floor of the one goes on in the other.
    """
    meshes = [
        box((1.0, 1.0, 1.0), (-1.0 - wall / 2, 0, 0), inside=True, emission=(1.0,) * 3),
        box((0.7, 0.6, 0.5), (0.7 + wall / 2, -0.1, 0.1), inside=True, emission=(0.01,) * 3),
    ]
    eye, target = (((-1.8, 0.1, 0.2), (0.0, -0.3, 0.1)), ((1.2, 0.1, 0.2), (0.0, -0.3, 0.1)))[camera_in]
    return scene(meshes, view(eye, target, 60), (0.5,) * 3)


def test_nothing_leaks_from_room_to_room(way: Indirect) -> None:
    """Half a thousandth of the bright room's light would be seen in the dark one."""
    for number, glow in enumerate((1.0, 0.01)):
        assert_indirect(two_rooms(1e-3, number), 0.5 * glow, indirect=way, photons=60_000, spp=64)


def beside_a_lit_room(camera_x: float) -> Scene:
    """A closed box that a sheet without thickness divides, and a lamp in its left half."""
    meshes = [
        box((1.0, 0.5, 0.5), inside=True),
        quad((0, -0.5, -0.5), (0, 1, 0), (0, 0, 1)),
        quad((-0.6, 0.49, -0.1), (0.2, 0, 0), (0, 0, 0.2), emission=(9.0,) * 3),
    ]
    return scene(meshes, view((camera_x, 0.1, 0.2), (0.0, -0.4, -0.2), 70, size=16), (0.5,) * 3)


def test_a_sheet_lets_no_light_through_to_what_goes_on_beneath_it(way: Indirect) -> None:
    """Floor, ceiling and walls of the lit half go on in the other one, where a sixtieth of its light was seen."""
    lit, dark = (
        rendered(beside_a_lit_room(x), indirect=way, spp=16, **PHOTONS).layers["indirect"].mean(dtype=np.float64)
        for x in (-0.8, 0.8)
    )
    assert lit > 0.005
    assert dark == 0.0


# Against path tracing


@functools.cache
def by_paths(make: Callable[[], Scene], max_depth: int | None = None) -> tuple[Array, Array]:
    """The indirect light of a scene and its deviation: rendered once for all ways that are held against it."""
    return over_seeds(make(), "indirect", spp=64, max_depth=max_depth, **PATH)


def small_box() -> Scene:
    return cornell_box((16, 16))


@pytest.mark.parametrize("max_depth", [3, 4, None])
def test_light_of_a_cornell_box_is_that_of_path_tracing(way: Indirect, max_depth: int | None) -> None:
    gathered = over_seeds(small_box(), "indirect", spp=16, indirect=way, max_depth=max_depth, **PHOTONS)
    assert_alike(by_paths(small_box, max_depth), gathered, share=0.01)


def test_plastic_and_metal_are_lit_as_by_path_tracing(way: Indirect) -> None:
    """What lamps send off metal onto walls is in the caustic layer."""
    gathered = over_seeds(shiny_box(), "indirect caustic", spp=16, indirect=way, **PHOTONS)
    assert_alike(by_paths(shiny_box), gathered, share=0.01)


def bumpy_box() -> Scene:
    """The Cornell box without its ceiling and lamp under a sky, one block of bumps."""
    what = small_box()
    slopes = Bitmap("slopes", np.random.default_rng(4).random((8, 8, 3)).astype(np.float32))
    bumps = Material("bumps", TwoSided(BumpMap(Diffuse((0.6, 0.5, 0.4)), slopes, 30.0)))
    new = {"tall block": len(what.materials)}
    meshes = [replace(mesh, material=new.get(mesh.name, mesh.material)) for mesh in what.meshes]
    open_above = tuple(mesh for mesh in meshes if mesh.name not in ("ceiling", "lamp"))
    return replace(what, meshes=open_above, materials=(*what.materials, bumps), lights=(SKY,))


def test_bumps_under_a_sky_are_lit_as_by_path_tracing(way: Indirect) -> None:
    gathered = over_seeds(bumpy_box(), "indirect", spp=16, indirect=way, **PHOTONS)
    assert_alike(by_paths(bumpy_box), gathered, share=0.015)


def bumpy_walls() -> Scene:
    """A closed box of strong bumps, which shadow themselves also where gather rays come to."""
    side = np.arange(8) / 8.0 * 2.0 * np.pi
    waves = np.repeat((0.5 + 0.5 * np.sin(side)[:, None] * np.sin(side)[None, :])[..., None], 3, axis=2)
    heights = Bitmap("waves", waves.astype(np.float32))
    bumps = Material("bumps", TwoSided(BumpMap(Diffuse((0.7, 0.7, 0.7)), heights, 0.6)))
    lamp = quad((-0.15, 0.98, -0.15), (0.3, 0, 0), (0, 0, 0.3), 1, (20.0, 20.0, 20.0))
    walls = replace(box((1, 1, 1), inside=True), uvs=cube().uvs)
    what = scene([walls, lamp], view((0, 0, -0.9), (0, 0, 1), 60), (0.0, 0.0, 0.0))
    return replace(what, materials=(bumps, *what.materials))


def test_bumpy_walls_are_lit_as_by_path_tracing(way: Indirect) -> None:
    """Where irradiance of the flat wall was read for what its bumps reflect, it was 11 % too bright."""
    gathered = over_seeds(bumpy_walls(), "indirect", spp=16, indirect=way, **PHOTONS)
    assert_alike(by_paths(bumpy_walls), gathered, share=0.015)


# Media


@functools.cache
def of_fog(way: Indirect) -> tuple[Array, Array]:
    """The light of fog in a furnace that is not direct, and its deviation."""
    what = foggy_furnace(Medium("fog", (0.5, 0.5, 0.5), (1.0, 1.0, 1.0), 0.2))
    return over_seeds(what, "indirect volume", spp=8, indirect=way, **PHOTONS)


def test_fog_is_lit_and_lights_as_by_the_map(way: Indirect) -> None:
    """Gather rays find the light of media on their way, once; it is in the layer of media then, not of surfaces."""
    assert_alike(of_fog(way), of_fog(Indirect.MAP), share=0.01)


# Nothing to gather


def test_the_lamp_is_seen_by_the_camera_and_by_no_gather_ray(way: Indirect) -> None:
    """A black room with a lamp has no indirect light at all."""
    lamp = quad((-0.3, 0.98, -0.3), (0.6, 0, 0), (0, 0, 0.6), emission=(8.0, 8.0, 8.0))
    room = scene([box((1, 1, 1), inside=True), lamp], view((0, 0, -0.9), (0, 0.3, 1), 80), (0.0,) * 3)
    image = rendered(room, indirect=way, spp=16, **PHOTONS)
    assert not image.layers["indirect"].any()
    assert image.pixels.max() == 8.0
