"""Blender's images as linear pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.blender.export.notes import Notes
from wdpm.images.channels import decode_srgb

Pixels = NDArray[np.float32]

RAW = frozenset({"Non-Color", "Linear Rec.709", "Linear", "Raw", "scene_linear"})
"""Colour spaces whose numbers are taken as they are: ours is linear Rec. 709, too."""


class Images:
    """Reads images, each once."""

    def __init__(self, notes: Notes) -> None:
        self._notes = notes
        self._known: dict[str, tuple[Pixels, Pixels] | None] = {}

    def read(self, image: Any) -> tuple[Pixels, Pixels] | None:
        """Linear RGB, float32, shape [height, width, 3] with the top row first, and opacity, shape [height, width, 1];
        None for an image that has no pixels."""
        name = image.name_full
        if name not in self._known:
            self._known[name] = self._read(image)
        return self._known[name]

    def _read(self, image: Any) -> tuple[Pixels, Pixels] | None:
        owner = f'image "{image.name}"'
        if image.source == "TILED":
            self._notes.add(owner, "only the first tile (UDIM 1001) is used")
        width, height = image.size
        if width == 0 or height == 0 or image.channels not in (1, 3, 4):
            self._notes.add(owner, f"it cannot be read ({image.filepath or 'it has no file'}): magenta stands for it")
            return None
        values = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(values)
        # Blender's first row is the lowest.
        values = values.reshape(height, width, image.channels)[::-1]
        colours = values[:, :, :3] if image.channels > 1 else np.repeat(values, 3, axis=2)
        opacity = values[:, :, 3:] if image.channels == 4 else np.ones((height, width, 1), np.float32)
        return self._linear(image, colours), np.ascontiguousarray(opacity)

    def _linear(self, image: Any, colours: Pixels) -> Pixels:
        space = image.colorspace_settings.name
        if image.is_float or space in RAW:  # Blender holds what it reads from float files in linear light already
            return np.ascontiguousarray(colours)
        if space != "sRGB":
            self._notes.add(f'image "{image.name}"', f'colour space "{space}" is not supported: it is read as sRGB')
        return decode_srgb(colours)
