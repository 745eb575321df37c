"""Renders the pictures of README.md with wdpm itself: `python docs/make_pictures.py`, some minutes on two cores."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
from numpy.typing import NDArray

import wdpm
from wdpm.image import encode_srgb8

FOLDER = Path(__file__).parent / "pictures"
EXPOSURE = {"cornell-box": 1.8, "atrium": 0.8}
CELL_COLOURS = np.array([[0.95, 0.35, 0.25], [0.25, 0.55, 0.95], [0.95, 0.80, 0.25], [0.35, 0.80, 0.45]])


def main(spp: int) -> None:
    """Render and write the pictures.

    Args:
        spp: samples a pixel.
    """
    FOLDER.mkdir(exist_ok=True)
    quality: dict[str, Any] = {"spp": spp, "light_samples": 4, "photons": 2_000_000, "k": 250}
    box = wdpm.render(wdpm.load("cornell-box", size=(400, 400)), **quality)
    save("cornell-box", encode_srgb8(box.pixels * EXPOSURE["cornell-box"]))
    hall = wdpm.render(wdpm.load("atrium:200k", size=(640, 400)), slaves=4, **quality)
    shown = hall.pixels * EXPOSURE["atrium"]
    save("atrium", encode_srgb8(shown))
    save("atrium-cells", encode_srgb8(tinted(shown, hall.layers["cell"])))


def tinted(shown: NDArray[np.float32], cell: NDArray[np.float32]) -> NDArray[np.float64]:
    """The picture in the colours of the cells that shaded it: each colour is another slave's part of the scene."""
    grey = shown.mean(axis=2, keepdims=True)
    colour = CELL_COLOURS[np.maximum(cell, 0).astype(int) % len(CELL_COLOURS)]
    return np.where(cell[..., None] < 0, 0.0, 1.5 * grey * colour)


def save(name: str, pixels: NDArray[np.uint8]) -> None:
    """Write a JPEG."""
    imageio.imwrite(FOLDER / f"{name}.jpg", pixels, quality=88)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 36)
