"""Heterogeneous media against Mitsuba's volpathmis on the same file, where Mitsuba is installed."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.load import load

pytestmark = pytest.mark.slow

SEEDS = 6
SIDE = 24

SCENE = """<scene version="3.0.0">
<integrator type="volpathmis"><integer name="max_depth" value="12"/></integrator>
<sensor type="perspective">
  <float name="fov" value="40"/>
  <transform name="to_world"><lookat origin="0.4, 1.2, -4" target="0, 0.4, 0" up="0, 1, 0"/></transform>
  <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="24"/><rfilter type="box"/></film>
</sensor>
<shape type="rectangle"><bsdf type="diffuse"><rgb name="reflectance" value="0.7 0.5 0.3"/></bsdf>
  <transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/><translate y="-0.7"/></transform></shape>
<shape type="rectangle"><emitter type="area"><rgb name="radiance" value="6 6 6"/></emitter>
  <transform name="to_world"><rotate x="1" angle="90"/><translate x="0.8" y="2.5"/></transform></shape>
<emitter type="constant"><rgb name="radiance" value="0.2 0.3 0.5"/></emitter>
<shape type="cube"><bsdf type="null"/>
  <transform name="to_world">PLACE</transform>
  <medium type="heterogeneous" name="interior">
    <volume type="gridvolume" name="sigma_t"><string name="filename" value="smoke.vol"/>FILTER
      <transform name="to_world"><translate x="-0.5" y="-0.5" z="-0.5"/><scale value="2"/>PLACE</transform></volume>
    <volume type="gridvolume" name="albedo"><string name="filename" value="tint.vol"/>
      <transform name="to_world"><translate x="-0.5" y="-0.5" z="-0.5"/><scale value="2"/>PLACE</transform></volume>
    <float name="scale" value="6"/>
    <phase type="hg"><float name="g" value="0.4"/></phase>
  </medium>
</shape>
</scene>
"""


def write_vol(file: Path, values: NDArray[np.float64]) -> None:
    z, y, x, channels = values.shape
    header = b"VOL\x03" + struct.pack("<5i6f", 1, x, y, z, channels, 0, 0, 0, 1, 1, 1)
    file.write_bytes(header + values.astype("<f4").tobytes())


def scene_in(folder: Path, filter_type: str) -> Path:
    rng = np.random.default_rng(1)
    smoke = rng.uniform(-0.5, 1.0, (7, 6, 5, 1)).clip(0.0)
    write_vol(folder / "smoke.vol", smoke)
    write_vol(folder / "tint.vol", rng.uniform(0.3, 1.0, (3, 4, 3, 3)))
    chosen = f'<string name="filter_type" value="{filter_type}"/>'
    # Only moved along the axes: what Mitsuba shows beyond a turned grid's box depends on its axis-aligned bounds.
    text = SCENE.replace("FILTER", chosen).replace("PLACE", '<scale x="0.9" y="0.6" z="0.7"/><translate x="-0.1"/>')
    file = folder / "scene.xml"
    file.write_text(text)
    return file


def mean_and_deviation(images: list[NDArray[np.float64]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of the blocks of 8 x 8 pixels of independent images, shape [blocks, 3]."""
    blocks = np.stack(
        [image.reshape(SIDE // 8, 8, SIDE // 8, 8, 3).mean(axis=(1, 3)).reshape(-1, 3) for image in images]
    )
    return blocks.mean(axis=0), blocks.std(axis=0, ddof=1) / np.sqrt(len(images))


@pytest.mark.parametrize("filter_type", ["trilinear", "nearest"])
def test_smoke_is_that_of_volpathmis(filter_type: str, tmp_path: Path) -> None:
    """Means over blocks: their differences are normal deviates of what the spread over seeds says."""
    mi = pytest.importorskip("mitsuba")
    file = scene_in(tmp_path, filter_type)
    settings = [
        RenderSettings(integrator=Integrator.PATH, spp=64, max_depth=12, seed=seed, all_effects=True)
        for seed in range(SEEDS)
    ]
    ours = [render_in_process(load(file), chosen, workers=1).pixels.astype(np.float64) for chosen in settings]
    mi.set_variant("scalar_rgb")
    scene = mi.load_file(str(file))
    theirs = [np.array(mi.render(scene, spp=64, seed=seed), np.float64) for seed in range(SEEDS)]
    mean, deviation = mean_and_deviation(ours)
    reference, spread = mean_and_deviation(theirs)
    z = (mean - reference) / np.maximum(np.hypot(deviation, spread), 1e-6)  # where only sky is seen there is no noise
    assert np.abs(z).max() < 6.0, z  # Student's t of 10 degrees of freedom, 27 of them
    np.testing.assert_allclose(mean.mean(axis=0), reference.mean(axis=0), rtol=0.02)
