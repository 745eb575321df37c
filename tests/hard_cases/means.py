"""Means over the pixels of an image, per channel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.images.image import Image

Array = NDArray[np.float64]


def mean(image: Image, layer: str) -> Array:
    return np.asarray(image.layers[layer].mean(axis=(0, 1), dtype=np.float64))


def mean_of(pixels: NDArray[np.float32]) -> Array:
    return np.asarray(pixels.mean(axis=(0, 1), dtype=np.float64))
