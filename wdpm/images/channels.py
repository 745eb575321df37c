"""The layers of an image file, their channels, and sRGB."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Layers = dict[str, NDArray[np.float32]]
"""Layers of an image by name (LAYER_CHANNELS): shape [height, width, 3], or [height, width] for a single channel."""

PARTITION_LAYER = "cell"
"""The layer that shows the partition itself, and so is meant to differ from cluster to cluster."""


# Every layer that an image may have, with the names of its channels in an EXR file. "RGB" is light or reflectance,
# "XYZ" a direction in world space, "Z" a distance and "Y" a single value: the names that compositing programs expect.
LAYER_CHANNELS: Mapping[str, str] = {
    "beauty": "RGB",
    "direct": "RGB",
    "indirect": "RGB",
    "caustic": "RGB",
    "volume": "RGB",
    "depth": "Z",
    "normal": "XYZ",
    "albedo": "RGB",
    "cell": "Y",
    "noise": "RGB",
    "bias": "RGB",
    "samples": "Y",
}


def encode_srgb8(linear: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """Linear light in [0, 1], clipped, to 8-bit sRGB (IEC 61966-2-1), rounded to nearest."""
    value = np.clip(linear, 0.0, 1.0).astype(np.float64)
    encoded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return np.round(encoded * 255.0).astype(np.uint8)


def decode_srgb(encoded: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """sRGB in [0, 1] to linear light (IEC 61966-2-1)."""
    value = np.asarray(encoded, dtype=np.float64)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)
