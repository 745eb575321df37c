"""Final gathering and the irradiance cache against path-traced references, small."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from halving import halved
from numpy.typing import NDArray

import wdpm
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.images.image import load as load_image
from wdpm.scenes.load import load

pytestmark = pytest.mark.shared

SIDE = 128
SETTINGS = {"photons": 100_000, "caustic_photons": 100_000, "spp": 16}

LARGE = ("bunny", "sibenik", "sponza")
SCENES = ["cbox", "glass-cbox", *(pytest.param(name, marks=pytest.mark.slow) for name in LARGE)]


def smooth(pixels: NDArray[Any]) -> NDArray[np.float64]:
    """Means of 8 x 8 pixels: what noise of direct light hides in single ones."""
    return halved(halved(halved(pixels)))


@pytest.mark.parametrize("name", SCENES)
def test_mean_and_error_against_the_reference(name: str, scenes_dir: Path) -> None:
    """The mean is as exact as the photons are; indirect light is nearer to the reference than the photon map's."""
    reference = load_image(scenes_dir / name / "reference.exr").pixels
    while len(reference) > SIDE:
        reference = halved(reference)
    scene = load(scenes_dir / name / "scene.xml", size=(SIDE, SIDE))
    error = {}
    for way in (Indirect.MAP, Indirect.GATHER, Indirect.CACHE):
        image = wdpm.render(scene, RenderSettings(indirect=way, max_depth=scene.max_depth, **SETTINGS))
        assert image.metadata["report"]["nonfinite"] == {}
        pixels = image.pixels.astype(np.float64)
        if way is not Indirect.MAP:
            np.testing.assert_allclose(pixels.mean(axis=(0, 1)), reference.mean(axis=(0, 1)), rtol=0.015)
        error[way] = ((smooth(pixels) - smooth(reference)) ** 2 / (smooth(reference) ** 2 + 0.01)).mean()
    assert error[Indirect.GATHER] <= error[Indirect.MAP]
    assert error[Indirect.CACHE] <= error[Indirect.MAP]
