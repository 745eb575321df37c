"""Diffuse parts under gloss by irradiance records: as bright as by path tracing, and hardly noisier than bare ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import Array, rendered

from wdpm.cluster.render_settings import Indirect, Integrator
from wdpm.images.image import Image
from wdpm.scenes import cornell_box
from wdpm.scenes.model.bsdfs import Bsdf, Diffuse, Principled
from wdpm.scenes.model.scene import Scene

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


def box_of(bsdf: Bsdf) -> Scene:
    """The Cornell box, all of one material."""
    scene = cornell_box((SIDE, SIDE))
    return replace(scene, materials=tuple(replace(each, bsdf=bsdf) for each in scene.materials))


def blocks(image: Image) -> Array:
    """Mean radiance of parts of a picture, all channels together; what shows the lamp is left out of it."""
    light = np.minimum(image.pixels.astype(np.float64).mean(axis=2), 1.0)
    return np.asarray(light.reshape(SIDE // BLOCK, BLOCK, SIDE // BLOCK, BLOCK).mean(axis=(1, 3)))


def test_records_show_what_path_tracing_does() -> None:
    """In a room that is lit from all sides. Corners are 2 to 3 % too bright, as they are without gloss."""
    scene = box_of(GLOSS)
    by_records = rendered(scene, **BY_RECORDS)
    by_paths = np.mean([blocks(rendered(scene, seed=seed, **BY_PATHS)) for seed in (5, 6)], axis=0)
    ratio = blocks(by_records) / by_paths
    assert by_records.report is not None
    assert by_records.report.final_gather.interpolated > 0.8 * SIDE * SIDE * 16
    assert ratio.mean() == pytest.approx(1.0, abs=0.012)
    np.testing.assert_allclose(ratio, 1.0, atol=0.045)


def test_the_report_says_what_is_approximated() -> None:
    words = "indirect light on diffuse parts under gloss: as if it came alike from all sides"
    few = {**BY_RECORDS, "photons": 1000, "spp": 1}
    for bsdf, is_said in ((GLOSS, True), (Diffuse(GREY), False)):
        report = rendered(box_of(bsdf), **{**few, "all_effects": False}).report
        assert report is not None
        assert (words in report.approximated) == is_said
