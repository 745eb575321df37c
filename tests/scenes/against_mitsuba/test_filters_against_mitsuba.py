"""Edges under every pixel filter against Mitsuba's image of the same file, which splats and divides by weights."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from furnaces import rendered

from wdpm.scenes import load

pytestmark = pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba is not installed")

MITSUBA = """
import json, sys
import numpy as np
import mitsuba as mi
mi.set_variant("scalar_rgb")
images = {file: np.array(mi.render(mi.load_file(file), seed=1)).tolist() for file in sys.argv[2:]}
json.dump(images, open(sys.argv[1], "w"))
"""
SIZE, MARGIN = 18, 4
FILTERS = {
    "box": "",
    "gaussian": '<float name="stddev" value="0.4"/>',
    "tent": '<float name="radius" value="1.5"/>',
    "mitchell": "",
    "catmullrom": "",
    "lanczos": '<integer name="lobes" value="2"/>',
}


def document(name: str) -> str:
    """A glowing quarter of the plane on black, by parallel rays."""
    film = f'<integer name="width" value="{SIZE}"/><integer name="height" value="{SIZE}"/>'
    return (
        '<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="1"/></integrator>'
        '<sensor type="orthographic"><transform name="to_world"><lookat origin="0 0 5" target="0 0 0" up="0 1 0"/>'
        '</transform><sampler type="independent"><integer name="sample_count" value="1024"/></sampler>'
        f'<film type="hdrfilm">{film}<rfilter type="{name}">{FILTERS[name]}</rfilter></film></sensor>'
        '<shape type="rectangle">'
        '<transform name="to_world"><scale value="3"/><translate x="3.13" y="2.79"/></transform>'
        '<emitter type="area"><rgb name="radiance" value="1"/></emitter></shape></scene>'
    )


def test_edges_are_mitsubas(tmp_path: Path) -> None:
    """1,024 samples, independent ones in Mitsuba: within 4 x 0.5 / 32 at each edge pixel, and 0.2 % on the mean."""
    files = {name: tmp_path / f"{name}.xml" for name in FILTERS}
    for name, file in files.items():
        file.write_text(document(name))
    answer = tmp_path / "answer.json"
    command = [sys.executable, "-c", MITSUBA, str(answer), *map(str, files.values())]
    subprocess.run(command, check=True, capture_output=True)
    theirs = json.loads(answer.read_text())
    inner = slice(MARGIN, SIZE - MARGIN)  # no filter reaches beyond the image, where Mitsuba has no samples
    for name, file in files.items():
        image = rendered(load(file), spp=1024, photons=0, max_depth=1)
        difference = image.layers["beauty"][inner, inner] - np.array(theirs[str(file)])[inner, inner, :3]
        assert np.abs(difference).max() < 0.06, name
        assert abs(float(difference.mean())) < 0.002, name
        edge = SIZE // 2 + 1  # the column of x = 0.13, above the quarter's lower side
        column = difference[: SIZE // 2 - MARGIN - 2, edge - MARGIN, 0]
        assert abs(float(column.mean())) < 0.03, name
