"""Scenes of others, rendered here and by Mitsuba 3: means of both images, channel by channel.

As a program, `python tests/foreign/against_mitsuba.py FILE...` prints a row for each. Both trace paths, with the file's
filter and as deep as wdpm has read, so that what differs is how the file was read. Mitsuba runs in a process of its
own. What stops it alone is taken out of the file first: integrators, which are replaced, 0.6's spelling of <lookat>,
and its media by sigma_a and sigma_s, which become those by sigma_t and albedo; parameters it does not know it ignores.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wdpm
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene

SIZE = 64
"""Of the longer side, in pixels."""

_MITSUBA = """
import json, sys, os
import xml.etree.ElementTree as tree
import numpy as np
import mitsuba as mi
asked = json.load(sys.stdin)
mi.set_variant(asked["variant"])
mi.set_log_level(mi.LogLevel.Error)
root = tree.parse(asked["file"]).getroot()
for integrator in root.findall("integrator"):
    root.remove(integrator)
for element in root.iter("lookAt"):
    element.tag = "lookat"
def numbers(element):
    values = [] if element is None else [float(v) for v in element.get("value").replace(",", " ").split()]
    return np.array(values * 3 if len(values) == 1 else values or [0.0] * 3)
for medium in root.iter("medium"):
    named = {child.get("name"): child for child in medium}
    found = [named.get("sigmaA", named.get("sigma_a")), named.get("sigmaS", named.get("sigma_s"))]
    if any(element is not None for element in found):
        absorbed, scattered = (numbers(element) for element in found)
        total, scale = absorbed + scattered, named.get("scale")
        for element in (*found, scale):
            if element is not None:
                medium.remove(element)
        factor = (1.0 if scale is None else float(scale.get("value"))) * total.max()
        tree.SubElement(medium, "float", name="scale", value=repr(float(factor)))
        for name, value in (("sigma_t", total / total.max()), ("albedo", scattered / np.maximum(total, 1e-30))):
            tree.SubElement(medium, "rgb", name=name, value=" ".join(repr(float(v)) for v in value))
config = mi.parser.ParserConfig(asked["variant"])
config.unused_properties = config.unused_parameters = mi.LogLevel.Debug
mi.file_resolver().prepend(os.path.dirname(asked["file"]))
state = mi.parser.parse_string(config, tree.tostring(root, "unicode"))
mi.parser.transform_all(config, state)
scene = mi.parser.instantiate(config, state)
scene = scene[0] if isinstance(scene, list) else scene
sensor = scene.sensors()[0]
parameters = mi.traverse(sensor)
for key, value in (("size", asked["size"]), ("crop_size", asked["size"]), ("crop_offset", [0, 0])):
    if "film." + key in parameters:
        parameters["film." + key] = value
parameters.update()
integrator = mi.load_dict({"type": asked["integrator"], "max_depth": asked["max_depth"]})
images = [
    np.array(mi.render(scene, sensor=sensor, spp=asked["spp"], integrator=integrator, seed=seed))[..., :3]
    for seed in (1, 2, 3, 4)
]
json.dump([image.mean(axis=(0, 1)).tolist() for image in images], sys.stdout)
"""


class NotReadError(Exception):
    """Mitsuba does not read a file, or not without more than it has; says why."""


@dataclass(frozen=True)
class Compared:
    """What came of a scene.

    Attributes:
        ours, theirs: means of the images, shape [3].
        noise: standard deviation of `theirs` as a share of it, shape [3].
        warnings: what wdpm says of the file.
    """

    ours: NDArray[np.float64]
    theirs: NDArray[np.float64]
    noise: NDArray[np.float64]
    warnings: tuple[str, ...]

    @property
    def off(self) -> NDArray[np.float64]:
        """By how much of theirs our means are off, shape [3]."""
        return self.ours / self.theirs - 1.0


def compare(file: Path, *, spp: int = 64, variant: str = "llvm_ad_rgb") -> Compared:
    """Render a file on both sides.

    Args:
        spp: samples of a pixel here, and in each of Mitsuba's four images.
        variant: Mitsuba's; those with llvm want LLVM's library (DRJIT_LIBLLVM_PATH).

    Raises:
        SceneError: wdpm does not read it.
        NotReadError: Mitsuba does not.
    """
    scene = _small(load(file, lenient=True), file)
    theirs = _by_mitsuba(file, scene, 2 * spp, variant)
    settings = RenderSettings(spp=spp, integrator=Integrator.PATH, max_depth=scene.max_depth)
    ours = wdpm.render(scene, settings).pixels.astype(np.float64).mean(axis=(0, 1))
    means = theirs.mean(axis=0)
    noise = theirs.std(axis=0, ddof=1) / np.sqrt(len(theirs)) / means
    return Compared(ours, means, noise, scene.warnings)


def _small(scene: Scene, file: Path) -> Scene:
    """The scene in a small image, without the crop window of its film."""
    camera = scene.camera
    width, height = camera.full_size or (camera.width, camera.height)
    shrink = SIZE / max(width, height)
    size = max(1, round(width * shrink)), max(1, round(height * shrink))
    camera = replace(camera, width=size[0], height=size[1], crop=None, full_size=None)
    return replace(scene, camera=camera, name=file.stem)


def _by_mitsuba(file: Path, scene: Scene, spp: int, variant: str) -> NDArray[np.float64]:
    """The means of four images, shape [4, 3]."""
    asked = {
        "file": str(file.resolve()),
        "variant": variant,
        "size": [scene.camera.width, scene.camera.height],
        "spp": spp,
        "integrator": "volpathmis" if scene.media else "path",
        "max_depth": scene.max_depth if scene.max_depth is not None else -1,
    }
    done = subprocess.run(
        [sys.executable, "-c", _MITSUBA], input=json.dumps(asked), capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise NotReadError((done.stderr.strip().splitlines() or ["it ended without a word"])[-1][:300])
    return np.array(json.loads(done.stdout), dtype=np.float64)


def row(file: Path, **how: Any) -> str:
    """A scene as a row of the table in docs/scenes.md."""
    try:
        compared = compare(file, **how)
    except NotReadError as error:
        return f"| {file} | Mitsuba: {error} | |"
    except wdpm.scenes.SceneError as error:
        return f"| {file} | {error} | |"
    off = ", ".join(f"{100.0 * each:+.2f}" for each in compared.off)
    lenient = sum("--lenient" in warning for warning in compared.warnings)
    return f"| {file} | {off} % | noise {100.0 * compared.noise.max():.2f} %, {lenient} lenient |"


if __name__ == "__main__":
    for each in sys.argv[1:]:
        print(row(Path(each)), flush=True)
