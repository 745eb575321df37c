"""Path tracing where its light is known: furnaces, the photon maps' expectation, any number of shadow rays.

All are rendered with the kernels that have all effects: nothing is compiled for one test.
"""

from __future__ import annotations

import numpy as np
import pytest
from furnace_cases import CASES, SKY
from furnaces import quad, rendered, view
from path_traced import PATH, assert_alike, furnace, mean_and_deviation, over_seeds, shiny_box

from wdpm.scenes.meshes.primitives import cube, sphere
from wdpm.scenes.model.bsdfs import WHITE, Diffuse, Mask, TwoSided
from wdpm.scenes.model.scene import Material, Mesh, Scene


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
