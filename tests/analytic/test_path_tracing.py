"""Path tracing where its light is known: furnaces, the photon maps' expectation, any number of shadow rays.

All are rendered with the kernels that have all effects: nothing is compiled for one test.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import Array, box, quad, rendered, scene, view
from numpy.typing import NDArray
from test_effect_furnaces import CASES, SKY

from wdpm.cluster.settings import Integrator
from wdpm.scenes import cornell_box
from wdpm.scenes.meshes.primitives import cube, sphere
from wdpm.scenes.model.bsdfs import WHITE, Bsdf, Conductor, Diffuse, Mask, Plastic, TwoSided
from wdpm.scenes.model.scene import Material, Mesh, Scene

PATH = {"integrator": Integrator.PATH, "all_effects": True}

SEEDS = 6


def mean_and_deviation(pixels: NDArray[np.float32]) -> tuple[Array, Array]:
    """Of pixels that all have the same expectation: their mean, and its deviation, by channel."""
    flat = pixels.reshape(-1, 3).astype(np.float64)
    return flat.mean(axis=0), flat.std(axis=0, ddof=1) / np.sqrt(len(flat))


def over_seeds(what: Scene, layers: str, **chosen: object) -> tuple[Array, Array]:
    """The mean of the sum of some layers, and its deviation, by channel, from independent renders."""
    means = []
    for seed in range(SEEDS):
        image = rendered(what, seed=seed, **chosen)
        means.append(sum(image.layers[name].mean(axis=(0, 1), dtype=np.float64) for name in layers.split()))
    return np.mean(means, axis=0), np.std(means, axis=0, ddof=1) / np.sqrt(SEEDS)


def assert_alike(one: tuple[Array, Array], other: tuple[Array, Array], share: float = 0.0) -> None:
    """Two means agree within 4.5 of their deviations, and `share` of them.

    Of few seeds the deviation itself is uncertain by a third: 4.5 then stand for the 3 of a known one.
    """
    allowed = 4.5 * np.hypot(one[1], other[1]) + share * other[0]
    assert (np.abs(one[0] - other[0]) <= allowed).all(), (one, other)


def furnace(albedo: float, *things: tuple[Mesh, Bsdf]) -> Scene:
    """A closed box that glows with radiance 1, and things in it: all radiance is 1 / (1 - albedo) if they are white."""
    what = scene(
        [box((1, 1, 1), inside=True, emission=(1.0, 1.0, 1.0))], view((0, 0, -0.9), (0, 0, 1), 60), (albedo,) * 3
    )
    meshes = [replace(mesh, material=1 + i) for i, (mesh, _) in enumerate(things)]
    materials = [Material(f"thing {i}", bsdf) for i, (_, bsdf) in enumerate(things)]
    return replace(what, meshes=(*what.meshes, *meshes), materials=(*what.materials, *materials))


@pytest.mark.parametrize("max_depth", [1, 2, 3, 5])
def test_a_furnace_by_number_of_edges(max_depth: int) -> None:
    """Every further edge adds albedo times as much."""
    image = rendered(furnace(0.5), spp=64, max_depth=max_depth, **PATH)
    mean, deviation = mean_and_deviation(image.pixels)
    exact = sum(0.5**edge for edge in range(max_depth))
    assert (np.abs(mean - exact) <= 4 * deviation + 1e-6).all(), (mean, exact)
    if max_depth < 3:
        assert not image.layers["indirect"].any()


@pytest.mark.parametrize("albedo", [0.2, 0.8])
def test_a_closed_furnace(albedo: float) -> None:
    mean, deviation = mean_and_deviation(rendered(furnace(albedo), spp=256, **PATH).pixels)
    assert (np.abs(mean - 1 / (1 - albedo)) <= 4 * deviation).all(), (mean, deviation)
    assert (deviation < 0.02 / (1 - albedo)).all()


@pytest.mark.parametrize("name", list(CASES))
def test_a_white_ball_in_a_furnace_is_not_seen(name: str) -> None:
    """Light of every number of bounces, by every pair of wall and material."""
    data = sphere(48)
    ball = Mesh("ball", data.vertices * 0.45, data.faces, data.normals, data.uvs, 1)
    image = rendered(furnace(0.5, (ball, CASES[name])), spp=64, **PATH)
    mean, deviation = mean_and_deviation(image.pixels)
    # What microfacets hide from each other is lost, at these roughnesses 0.2 %; as is what ends between an
    # interpolated normal and the true one, at silhouettes.
    assert (np.abs(mean - 2.0) <= 4 * deviation + 0.01).all(), (mean, deviation)
    assert (deviation < 0.02).all()


@pytest.mark.parametrize("name", list(CASES))
def test_a_white_cube_under_a_sky_is_not_seen(name: str) -> None:
    data = cube()
    mesh = Mesh("cube", data.vertices, data.faces, data.normals, data.uvs, 0)
    camera = view((2.0, 2.5, -3.5), (0, 0, 0), 24)
    what = Scene("furnace", (mesh,), (Material("white", CASES[name]),), (SKY,), camera)
    mean, deviation = mean_and_deviation(rendered(what, spp=64, **PATH).pixels)
    assert (np.abs(mean - 1.0) <= 4 * deviation + 5e-3).all(), (mean, deviation)
    assert (deviation < 0.02).all()


@pytest.mark.parametrize("opacity", [0.3, 0.7])
def test_a_mask_in_a_furnace_is_not_seen(opacity: float) -> None:
    leaf = quad((-0.5, -0.5, 0), (0, 1, 0), (1, 0, 0))
    image = rendered(furnace(0.5, (leaf, Mask(TwoSided(Diffuse(WHITE)), opacity))), spp=64, **PATH)
    mean, deviation = mean_and_deviation(image.pixels)
    assert (np.abs(mean - 2.0) <= 4 * deviation + 1e-6).all(), (mean, deviation)


def shiny_box() -> Scene:
    """The Cornell box, one block of plastic and one of rough metal."""
    what = cornell_box((16, 16))
    first = len(what.materials)
    more = (
        Material("plastic", TwoSided(Plastic((0.3, 0.5, 0.7)))),
        Material("metal", Conductor(alpha_u=0.3, alpha_v=0.3)),
    )
    new = {"tall block": first, "short block": first + 1}
    meshes = tuple(replace(mesh, material=new.get(mesh.name, mesh.material)) for mesh in what.meshes)
    return replace(what, meshes=meshes, materials=(*what.materials, *more))


def test_light_is_that_of_photon_maps() -> None:
    """Direct light is the same expectation; what photons blur they keep in the mean, but for some of it at edges."""
    what = shiny_box()
    photons = {"all_effects": True, "photons": 40_000, "caustic_photons": 20_000}
    assert_alike(over_seeds(what, "direct", spp=16, **PATH), over_seeds(what, "direct", spp=16, **photons))
    by_map = over_seeds(what, "indirect caustic", spp=16, **photons)
    assert_alike(over_seeds(what, "indirect", spp=64, **PATH), by_map, share=0.03)


@pytest.mark.parametrize("light_samples", [2, 5])
def test_any_number_of_shadow_rays_has_the_same_expectation(light_samples: int) -> None:
    what = shiny_box()
    for layer in ("direct", "indirect"):
        one = over_seeds(what, layer, spp=32, **PATH)
        more = over_seeds(what, layer, spp=32, light_samples=light_samples, **PATH)
        assert_alike(more, one)
        assert (one[1] < 0.03 * one[0]).all()
