"""The scenes of the paper's kind against path-traced references, small; the full numbers are the benchmark's."""

from __future__ import annotations

import json
import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from halving import halved

import wdpm
from wdpm.cluster.render_settings import RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.images.image import load as load_image
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene

pytestmark = pytest.mark.shared

SMALL = ("cbox", "bunny")
LARGE = ("sibenik", "sponza")


def named(*names: str, slow: tuple[str, ...] = ()) -> list[object]:
    """Parameters, those of large scenes marked slow."""
    return [pytest.param(name, marks=[pytest.mark.slow] if name in slow else []) for name in names]


def sized(scene: Scene, side: int) -> Scene:
    return replace(scene, camera=replace(scene.camera, width=side, height=side))


@pytest.mark.parametrize("name", named(*SMALL, *LARGE, slow=LARGE))
def test_mean_and_error_against_the_reference(name: str, scenes_dir: Path) -> None:
    reference = load_image(scenes_dir / name / "reference.exr").pixels
    while len(reference) > 128:
        reference = halved(reference)
    scene = sized(load(scenes_dir / name / "scene.xml"), 128)
    image = wdpm.render(scene, RenderSettings(photons=250_000, spp=16, max_depth=scene.max_depth))
    report = image.metadata["report"]
    assert report["nonfinite"] == {}
    assert report["gathers_left_band"] == 0
    pixels = image.pixels.astype(np.float64)
    # 250,000 photons, of which a view shows a good part, and 262,144 samples: noise of the mean is below 0.5 %; the
    # rest of the 3 % is the blur of gathers with a quarter of the benchmark's photons.
    np.testing.assert_allclose(pixels.mean(axis=(0, 1)), reference.mean(axis=(0, 1)), rtol=0.03)
    relative = ((pixels - reference) ** 2 / (reference**2 + 0.01)).mean()
    assert relative <= 0.03, relative


@pytest.mark.parametrize("name", named(*SMALL, *LARGE))
def test_bits_of_one_and_four_workers(name: str, scenes_dir: Path) -> None:
    scene = sized(load(scenes_dir / name / "scene.xml"), 64)
    chosen = RenderSettings(photons=20_000, spp=1, max_depth=scene.max_depth)
    one = render_in_process(scene, chosen, workers=1)
    four = render_in_process(
        scene, replace(chosen, routing=Routing.MERGE, bucket=17), workers=4, cells=8, shuffle=random.Random(4)
    )
    assert without_cells(one).digest() == without_cells(four).digest()
    slaves = four.metadata["report"]["slaves"]
    assert sum(slave["photons"] for slave in slaves) == one.metadata["report"]["photons"]["stored"]


def without_cells(image: Image) -> Image:
    return Image({name: layer for name, layer in image.layers.items() if name != "cell"})


@pytest.mark.parametrize("name", named(*SMALL, *LARGE))
def test_references_are_what_they_say(name: str, scenes_dir: Path) -> None:
    """Guards the comparison itself: a reference of another size or scale would make it say nothing."""
    reference = load_image(scenes_dir / name / "reference.exr").pixels
    facts = json.loads((scenes_dir / name / "reference.json").read_text())
    assert reference.shape == (*facts["size"], 3) == (256, 256, 3)
    np.testing.assert_allclose(reference.mean(axis=(0, 1), dtype=np.float64), facts["mean"], rtol=1e-3)
