"""Diffuse parts under gloss by irradiance records: as bright as by path tracing, and hardly noisier than bare ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import Array, quad, rendered

from wdpm.cluster.render_settings import Indirect, Integrator
from wdpm.images.image import Image
from wdpm.scenes import cornell_box
from wdpm.scenes.model.bsdfs import Bsdf, Diffuse, Plastic, Principled
from wdpm.scenes.model.lights import SpotLight
from wdpm.scenes.model.scene import Camera, Material, Scene
from wdpm.scenes.model.transforms import look_at

SIDE, BLOCK = 40, 8
BY_RECORDS = {
    "integrator": Integrator.PHOTONS,
    "indirect": Indirect.CACHE,
    "all_effects": True,
    "photons": 100_000,
    "spp": 16,
}
BY_PATHS = {"integrator": Integrator.PATH, "all_effects": True, "spp": 1024}

GREY = (0.6, 0.6, 0.6)
GLOSS = Principled(GREY, roughness=0.4, layered=True)
COATED = Plastic(GREY, alpha=0.2)


def box_of(bsdf: Bsdf) -> Scene:
    """The Cornell box, all of one material."""
    scene = cornell_box((SIDE, SIDE))
    return replace(scene, materials=tuple(replace(each, bsdf=bsdf) for each in scene.materials))


def blocks(image: Image) -> Array:
    """Mean radiance of parts of a picture, all channels together; what shows the lamp is left out of it."""
    light = np.minimum(image.pixels.astype(np.float64).mean(axis=2), 1.0)
    return np.asarray(light.reshape(SIDE // BLOCK, BLOCK, SIDE // BLOCK, BLOCK).mean(axis=(1, 3)))


@pytest.mark.parametrize("bsdf", [GLOSS, COATED], ids=["gltf", "plastic"])
def test_records_show_what_path_tracing_does(bsdf: Bsdf) -> None:
    """In a room that is lit from all sides. Corners are 2 to 3 % too bright, as they are without gloss."""
    scene = box_of(bsdf)
    by_records = rendered(scene, **BY_RECORDS)
    by_paths = np.mean([blocks(rendered(scene, seed=seed, **BY_PATHS)) for seed in (5, 6)], axis=0)
    ratio = blocks(by_records) / by_paths
    assert by_records.report is not None
    assert by_records.report.final_gather.interpolated > 0.8 * SIDE * SIDE * 16
    assert ratio.mean() == pytest.approx(1.0, abs=0.012)
    np.testing.assert_allclose(ratio, 1.0, atol=0.045)


def hall(bsdf: Bsdf) -> Scene:
    """A floor that only a low wall lights, on which a lamp shines: all light on it comes from low down."""
    floor = quad((-5, 0, 5), (10, 0, 0), (0, 0, -10))
    wall = replace(quad((-3, 0, -3), (6, 0, 0), (0, 0.8, 0)), material=1)
    lamp = SpotLight("spot", look_at((0, 0.5, 4.5), (0, 0.5, -3), (0, 1, 0)), (5000.0, 5000.0, 5000.0), 2.9, 2.0)
    camera = Camera(look_at((-3, 2.5, 4), (0, 0, 0), (0, 1, 0)), 50.0, SIDE, SIDE)
    materials = (Material("floor", bsdf), Material("wall", Diffuse((0.8, 0.8, 0.8))))
    return Scene("hall", (floor, wall), materials, (lamp,), camera)


def test_a_coat_lets_less_light_through_that_comes_from_low_down() -> None:
    """As if it came alike from all sides the floor would be half as bright again.

    Against a floor without a coat, so that what records blur at such few pixels counts on both sides.
    """
    coated, bare = hall(COATED), hall(Diffuse(GREY))
    shown, shown_bare = (blocks(rendered(scene, **{**BY_RECORDS, "spp": 64})) for scene in (coated, bare))
    expected, expected_bare = (blocks(rendered(scene, **{**BY_PATHS, "spp": 4096})) for scene in (coated, bare))
    lit = expected_bare > 0.02
    assert lit.sum() >= 6
    np.testing.assert_allclose(shown[lit] / shown_bare[lit], expected[lit] / expected_bare[lit], rtol=0.08)
    assert (expected[lit] / expected_bare[lit]).min() < 0.7


def test_the_report_says_what_is_approximated() -> None:
    words = "indirect light on diffuse parts under gloss: told by its amount and how much of it grazes them"
    few = {**BY_RECORDS, "photons": 1000, "spp": 1}
    for bsdf, is_said in ((GLOSS, True), (COATED, True), (Diffuse(GREY), False)):
        report = rendered(box_of(bsdf), **{**few, "all_effects": False}).report
        assert report is not None
        assert (words in report.approximated) == is_said
