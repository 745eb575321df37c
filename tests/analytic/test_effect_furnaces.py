"""White furnaces for each material: a convex thing that absorbs nothing, under a sky of radiance 1, cannot be seen.

All light comes straight from the sky or by glossy parts: photons have nothing to add. All are rendered with the kernels
that have all effects: nothing is compiled for one test.
"""

from __future__ import annotations

import numpy as np
import pytest
from furnace_cases import CASES, SKY
from furnaces import Array, quad, rendered, view

from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.meshes.primitives import cube, sphere
from wdpm.scenes.model.bsdfs import (
    WHITE,
    Bsdf,
    Conductor,
    Diffuse,
    Mask,
    TwoSided,
)
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Camera, Material, Mesh, Scene

MAPPED_SKY = Environment("sky", np.ones((4, 8, 3), np.float32))
METAL = {"eta": (0.0, 0.0, 0.0), "k": (1.0, 1.0, 1.0)}  # reflects everything


def seen(
    data: MeshData, bsdf: Bsdf, camera: Camera, sky: Environment = SKY, spp: int = 256, least_normal: float = 0.999
) -> Array:
    """Radiance of the pixels that show the thing and nothing else, shape [pixels, 3]."""
    mesh = Mesh("thing", data.vertices, data.faces, data.normals, data.uvs, 0)
    image = rendered(
        Scene("furnace", (mesh,), (Material("thing", bsdf),), (sky,), camera),
        photons=0,
        caustic_photons=0,
        spp=spp,
        all_effects=True,
    )
    # Normals of one face and of no sky add up to length 1. Pixels at edges have fewer samples of each, with more noise.
    inside = np.linalg.norm(image.layers["normal"], axis=2) > least_normal
    assert np.count_nonzero(inside) > 80
    return np.asarray(image.pixels[inside].astype(np.float64))


@pytest.mark.parametrize("name", list(CASES))
def test_a_white_cube_is_not_seen(name: str) -> None:
    radiance = seen(cube(), CASES[name], view((2.0, 2.5, -3.5), (0, 0, 0), 36, 14))
    # A sample of the diffuse ones is 4 cos above the horizon and 0 below: a deviation of 1.3. 256 independent ones
    # would leave 8 % in a pixel, stratified ones leave 0.5 % (measured), and next to nothing in the mean.
    # Those that choose by chance (blends, Russian roulette in glass) have 5 %, and 0.3 % in the mean of 280 pixels.
    # The rough ones lose what their microfacets hide from each other, at alpha 0.05 some 0.2 %.
    np.testing.assert_allclose(radiance.mean(axis=0), 1.0, atol=5e-3)
    np.testing.assert_allclose(radiance, 1.0, atol=0.3)


@pytest.mark.parametrize("name", ["diffuse", "mirror", "rough metal", "plastic"])
def test_importance_sampling_of_the_sky_changes_nothing(name: str) -> None:
    radiance = seen(cube(), CASES[name], view((2.0, 2.5, -3.5), (0, 0, 0), 36, 14), MAPPED_SKY)
    np.testing.assert_allclose(radiance.mean(axis=0), 1.0, atol=5e-3)


@pytest.mark.parametrize("name", ["glass", "mirror", "pane"])
def test_a_white_ball_is_not_seen(name: str) -> None:
    """Normals are interpolated: at the silhouette some paths end between the two normals, a share of 1e-3 or less."""
    radiance = seen(sphere(128), CASES[name], view((0.3, 0.4, -4.0), (0, 0, 0), 34, 14), spp=64, least_normal=0.9)
    np.testing.assert_allclose(radiance.mean(axis=0), 1.0, atol=5e-3)


@pytest.mark.parametrize("bsdf", [CASES["glass"], CASES["rough glass"], CASES["pane"]])
def test_a_coarse_ball_that_lets_light_through_is_not_seen(bsdf: Bsdf) -> None:
    """Normals far from those of the faces send light to the wrong side, where it goes on: 1 to 3 % of it all."""
    data, camera = sphere(6), view((0.3, 0.4, -4.0), (0, 0, 0), 34, 14)
    mesh = Mesh("thing", data.vertices, data.faces, data.normals, data.uvs, 0)
    furnace = Scene("furnace", (mesh,), (Material("thing", bsdf),), (SKY,), camera)
    image = rendered(furnace, photons=0, caustic_photons=0, spp=256, all_effects=True)
    assert image.pixels.mean() == pytest.approx(1.0, abs=6e-3)


@pytest.mark.parametrize("opacity", [0.3, 1.0])
@pytest.mark.parametrize("behind", [False, True])
def test_a_mask_of_white_is_not_seen(opacity: float, behind: bool) -> None:
    leaf = quad((-1, -1, 0), (0, 2, 0), (2, 0, 0))
    camera = view((0.1, 0.2, 3.0 if behind else -3.0), (0, 0, 0), 30, 12)
    for inside in (Diffuse(WHITE), Conductor()):
        data = MeshData(leaf.vertices, leaf.faces, None, None)
        # Which samples pass is chance: over seeds, the mean of 256 of them has a deviation of 0.3 %.
        radiance = seen(data, Mask(TwoSided(inside), opacity), camera, spp=1024)
        np.testing.assert_allclose(radiance.mean(axis=0), 1.0, atol=5e-3)
