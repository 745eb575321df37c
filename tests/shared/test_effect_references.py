"""The shared scenes with effects against path-traced references, small; those without one for their sanity."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from halving import halved

import wdpm
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.image import load as load_image
from wdpm.scenes.load import load

pytestmark = pytest.mark.shared

SETTINGS = RenderSettings(photons=100_000, caustic_photons=100_000, volume_photons=150_000, spp=16)

WITH_REFERENCE = {  # name -> size of the render, largest relMSE there (of halved references; measured: about half)
    "glass-cbox": ((128, 128), 0.03),
    "lens-cbox": ((128, 128), 0.02),
    "veach-mis": ((160, 90), 0.04),
    "envmap": ((128, 128), 0.04),
    "materials": ((128, 128), 0.05),
}
SLOW = {"envmap", "materials", "veach-mis"}

WITHOUT_REFERENCE = ("water-caustic", "box-caustic")


def parameters() -> list[Any]:
    return [pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else []) for name in WITH_REFERENCE]


@pytest.mark.parametrize("name", parameters())
def test_mean_and_error_against_the_reference(name: str, scenes_dir: Path) -> None:
    size, largest = WITH_REFERENCE[name]
    reference = halved(load_image(scenes_dir / name / "reference.exr").pixels)
    scene = load(scenes_dir / name / "scene.xml", size=size)
    image = wdpm.render(scene, replace(SETTINGS, max_depth=scene.max_depth))
    pixels = image.pixels.astype(np.float64)
    np.testing.assert_allclose(pixels.mean(axis=(0, 1)), reference.mean(axis=(0, 1)), rtol=0.03)
    assert ((pixels - reference) ** 2 / (reference**2 + 0.01)).mean() <= largest


@pytest.mark.slow
def test_fog_around_the_lamp(scenes_dir: Path, tmp_path: Path) -> None:
    """Against Mitsuba itself, with the fog raised by 32 mm so that the lamp hangs in it.

    In the scene as it is the lamp hangs 15 mm above the boundary of the fog, and volpath and volpathmis of Mitsuba 3.9
    lose up to nine tenths of its light at points of the fog near it: a quadrature of the single scattering says so
    (docs/measured.md). Where lamp and point are in the same medium they do not, so the reference is off by a quarter.
    """
    mi = pytest.importorskip("mitsuba")
    text = (scenes_dir / "fog-cbox" / "scene.xml").read_text()
    raised = text.replace('<scale x="0.999" y="0.98" z="0.999"/>', '<scale x="0.999" y="0.99675" z="0.999"/>')
    raised = raised.replace('<translate x="0" y="0.985" z="0"/>', '<translate x="0" y="1.00175" z="0"/>')
    assert raised.count("0.99675") == raised.count("1.00175") == 1
    file = tmp_path / "fog.xml"
    file.write_text(raised)
    ours = wdpm.render(load(file, size=(48, 48)), SETTINGS).pixels.mean(axis=(0, 1), dtype=np.float64)
    mi.set_variant("scalar_rgb")
    scene = mi.load_file(str(file), resx=48, resy=48)
    theirs = np.array(mi.render(scene, spp=96), np.float64).mean(axis=(0, 1))
    np.testing.assert_allclose(ours, theirs, rtol=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("name", WITHOUT_REFERENCE)
def test_scenes_out_of_a_path_tracers_reach(name: str, scenes_dir: Path) -> None:
    image = wdpm.render(load(scenes_dir / name / "scene.xml", size=(64, 64)), replace(SETTINGS, spp=4))
    assert np.isfinite(image.pixels).all()
    assert image.layers["caustic"].mean() > 0.01
    assert (image.pixels.max(axis=2) > 0).mean() > 0.9


@pytest.mark.slow
def test_the_mcguire_boxes(scenes_dir: Path) -> None:
    files = sorted((scenes_dir / "mcguire-cornell").glob("CornellBox-*.obj"))
    assert len(files) == 12
    for file in files:
        image = wdpm.render(load(file, size=(48, 48)), replace(SETTINGS, photons=20_000, caustic_photons=20_000, spp=2))
        assert np.isfinite(image.pixels).all()
        assert image.pixels.mean() > 0.003, file.name
