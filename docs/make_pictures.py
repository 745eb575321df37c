"""Renders the pictures of README.md and docs with wdpm: `python docs/make_pictures.py`, some minutes on two cores.

`python docs/make_pictures.py records` makes only that of the irradiance records.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
from numpy.typing import NDArray

import wdpm
from wdpm.cluster.records import ROUND_BITS
from wdpm.cluster.render_settings import Indirect
from wdpm.images.channels import encode_srgb8
from wdpm.scenes.flat.renderer_space import renderer_space
from wdpm.scenes.model.scene import Camera

FOLDER = Path(__file__).parent / "pictures"
CELL_COLOURS = np.array([[0.95, 0.35, 0.25], [0.25, 0.55, 0.95], [0.95, 0.80, 0.25], [0.35, 0.80, 0.45]])
RECORD_COLOURS = np.array([[255, 70, 50], [255, 150, 40], [250, 220, 70], [120, 230, 110], [90, 200, 255]], np.uint8)
"""Of the rounds, the last of them also of later ones."""

DIMMED = 0.35


def main(spp: int) -> None:
    """Render and write the pictures.

    Args:
        spp: samples a pixel.
    """
    FOLDER.mkdir(exist_ok=True)
    quality: dict[str, Any] = {"spp": spp, "light_samples": 4, "photons": 2_000_000, "k": 250}
    box = wdpm.render(wdpm.load("cornell-box", size=(400, 400)), **quality)
    save("cornell-box", box.to_srgb8())
    hall = wdpm.render(wdpm.load("atrium:200k", size=(640, 400)), slaves=4, **quality)
    save("atrium", hall.to_srgb8())
    exposed = hall.pixels * np.float32(2.0 ** (hall.look.exposure or 0.0))
    save("atrium-cells", encode_srgb8(tinted(exposed, hall.layers["cell"])))
    show_records()


def tinted(shown: NDArray[np.float32], cell: NDArray[np.float32]) -> NDArray[np.float64]:
    """The picture in the colours of the cells that shaded it: each colour is another slave's part of the scene."""
    grey = shown.mean(axis=2, keepdims=True)
    colour = CELL_COLOURS[np.maximum(cell, 0).astype(int) % len(CELL_COLOURS)]
    return np.where(cell[..., None] < 0, 0.0, 1.5 * grey * colour)


def show_records() -> None:
    """Where irradiance records of the Cornell box lie: dots in the colours of their rounds, over the dimmed picture."""
    scene = wdpm.load("cornell-box", size=(400, 400))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "box.records"
        image = wdpm.render(scene, spp=8, photons=250_000, indirect=Indirect.CACHE, save_cache=file)
        with np.load(file, allow_pickle=False) as records:
            camera = renderer_space(scene.meshes).camera(scene.camera)
            places, rounds = projected(camera, records["position"]), records["number"] >> ROUND_BITS
    shown = image.looking((image.look.exposure or 0.0) + np.log2(DIMMED)).to_srgb8()
    for (x, y), number in zip(places, rounds, strict=True):
        shown[y : y + 2, x : x + 2] = RECORD_COLOURS[min(number, len(RECORD_COLOURS) - 1)]
    imageio.imwrite(FOLDER / "irradiance-records.png", shown, optimize=True)


def projected(camera: Camera, positions: NDArray[np.float32]) -> NDArray[np.int64]:
    """Pixels at which a pinhole camera sees positions of its space, shape [N, 3]: column and row, shape [N, 2]."""
    homogeneous = np.concatenate([positions, np.ones((len(positions), 1))], axis=1)
    seen = homogeneous @ np.linalg.inv(camera.to_world).T
    # The camera's +x is to the left of the image and its +y is up.
    scale = camera.width / (2 * np.tan(np.radians(camera.fov_x) / 2) * seen[:, 2])
    middle = np.array([camera.width, camera.height]) / 2
    pixels = np.floor(middle - seen[:, :2] * scale[:, None]).astype(np.int64)
    return pixels.clip(0, [camera.width - 1, camera.height - 1])


def save(name: str, pixels: NDArray[np.uint8]) -> None:
    """Write a JPEG."""
    imageio.imwrite(FOLDER / f"{name}.jpg", pixels, quality=88)


if __name__ == "__main__":
    if sys.argv[1:] == ["records"]:
        show_records()
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 36)
