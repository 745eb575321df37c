"""A rendered image: its layers, and what was known when it was made."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import ImageError

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
}


@dataclass(frozen=True, eq=False)
class Image:
    """An image with its layers. Row 0 is the top.

    Attributes:
        layers: float32 arrays of one size, by name: shape [height, width, 3], or [height, width] for `depth` and
            `cell`. `beauty`, linear RGB radiance [W/(m² sr)], is always there.
        metadata: what goes into the header of an EXR file, such as `settings` and `report`, as JSON has it.

    Raises:
        ImageError: a layer is missing, unknown, or of the wrong type or shape.
    """

    layers: dict[str, NDArray[np.float32]]
    metadata: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if "beauty" not in self.layers:
            raise ImageError(f"an image needs a layer 'beauty' (got {', '.join(self.layers) or 'no layer'})")
        height, width = self.layers["beauty"].shape[:2]
        for name, layer in self.layers.items():
            if name not in LAYER_CHANNELS:
                raise ImageError(f"unknown layer '{name}': must be one of {', '.join(LAYER_CHANNELS)}")
            expected = (height, width, 3) if len(LAYER_CHANNELS[name]) == 3 else (height, width)
            if layer.shape != expected or layer.dtype != np.float32:
                raise ImageError(
                    f"layer '{name}' must be float32 of shape {expected} (got {layer.dtype} of shape {layer.shape})"
                )
        if height == 0 or width == 0:
            raise ImageError(f"an image needs at least one pixel (got {width}x{height})")

    @property
    def pixels(self) -> NDArray[np.float32]:
        """The beauty layer: linear RGB, shape [height, width, 3]."""
        return self.layers["beauty"]

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width)."""
        height, width = self.pixels.shape[:2]
        return height, width

    def to_srgb8(self) -> NDArray[np.uint8]:
        """The beauty layer as a screen shows it: sRGB, 8 bits, clipped to [0, 1], shape [height, width, 3].

        Raises:
            ImageError: a pixel is NaN.
        """
        bad = int(np.isnan(self.pixels).any(axis=2).sum())
        if bad:
            raise ImageError(f"{bad} pixels are NaN and have no colour: save as .exr to find them")
        return encode_srgb8(self.pixels)

    def digest(self) -> str:
        """SHA-256 of names, shapes and bytes of all layers but `cell`, in hexadecimal: equal iff every bit of them is.

        `cell` shows which part of a cluster shaded a pixel: it is the one layer that depends on who computed the image.
        """
        sha = hashlib.sha256()
        for name in sorted(self.layers.keys() - {PARTITION_LAYER}):
            layer = np.ascontiguousarray(self.layers[name], dtype="<f4")
            sha.update(f"{name} {layer.shape}\n".encode())
            sha.update(layer.data)
        return sha.hexdigest()

    def save(self, path: str | Path) -> None:
        """Write a file of the format that the extension names: .exr (all layers), or .png, .hdr, .pfm, .npy (beauty).

        The file appears whole or not at all.

        Raises:
            ImageError: unknown extension, a folder that cannot be written, or pixels that the format cannot hold.
        """
        from wdpm import image_files

        image_files.write(self, Path(path))

    def _repr_png_(self) -> bytes:
        """What a notebook shows."""
        from wdpm import image_files

        return image_files.png_bytes(self.to_srgb8())


def load(path: str | Path) -> Image:
    """Read an image file: .exr, .png, .hdr, .pfm or .npy, by this or another program.

    Raises:
        ImageError: unknown extension, missing or broken file.
    """
    from wdpm import image_files

    return image_files.read(Path(path))


def encode_srgb8(linear: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """Linear light in [0, 1], clipped, to 8-bit sRGB (IEC 61966-2-1), rounded to nearest."""
    value = np.clip(linear, 0.0, 1.0).astype(np.float64)
    encoded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return np.round(encoded * 255.0).astype(np.uint8)


def decode_srgb(encoded: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """sRGB in [0, 1] to linear light (IEC 61966-2-1)."""
    value = np.asarray(encoded, dtype=np.float64)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)
