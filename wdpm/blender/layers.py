"""Our layers as Blender's passes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.model.scene import Camera

Layers = Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class Pass:
    """A pass of Blender's.

    Attributes:
        name: Blender's, as Cycles has it where that has it, too.
        layer: ours.
        channels: their letters.
        kind: what Blender's compositor takes it for: COLOR, VECTOR or VALUE.
        flag: of the view layer, that switches it on; None where our settings do.
    """

    name: str
    layer: str
    channels: str
    kind: str
    flag: str | None = None


COMBINED = Pass("Combined", "beauty", "RGBA", "COLOR")

PASSES = (
    Pass("Depth", "depth", "Z", "VALUE", "use_pass_z"),
    Pass("Normal", "normal", "XYZ", "VECTOR", "use_pass_normal"),
    Pass("DiffCol", "albedo", "RGB", "COLOR", "use_pass_diffuse_color"),
    Pass("Direct", "direct", "RGB", "COLOR"),
    Pass("Indirect", "indirect", "RGB", "COLOR"),
    Pass("Caustic", "caustic", "RGB", "COLOR"),
    Pass("Volume", "volume", "RGB", "COLOR"),
)
"""Besides Combined."""

NOWHERE = 1e10
"""Depth where nothing is: Blender's."""


def passes_of(view_layer: Any, light_layers: bool) -> Iterator[Pass]:
    """The passes that a view layer has besides Combined.

    Args:
        light_layers: whether those of kinds of light are wanted.
    """
    for each in PASSES:
        if light_layers if each.flag is None else getattr(view_layer, each.flag):
            yield each


def pixels_of(each: Pass, layers: Layers, depth: Depth) -> NDArray[np.float32]:
    """A pass as Blender takes it: float32, lowest row first, flat.

    Args:
        layers: ours, of the whole picture or of a part.
        depth: of the same pixels.
    """
    layer = layers.get(each.layer)
    height, width = depth.steepness.shape
    pixels = np.zeros((height, width, len(each.channels)), np.float32)
    if layer is None:  # light of a kind that the scene has none of
        return pixels.reshape(-1)
    if each.layer == "depth":
        pixels[:, :, 0] = depth.along_axis(layer)
    elif each.channels == "RGBA":
        pixels[:, :, :3], pixels[:, :, 3] = layer, 1.0
    else:
        pixels[:] = layer if layer.ndim == 3 else layer[:, :, None]
    return np.ascontiguousarray(pixels[::-1]).reshape(-1)


@dataclass(frozen=True, eq=False)
class Depth:
    """What makes Blender's depth, along the camera's axis, of ours, which is the distance from the camera.

    Attributes:
        steepness: cosine between a pixel's ray and the axis, float32, shape [height, width].
        aside: distance of its ray from the axis, where rays are parallel; the same shape.
    """

    steepness: NDArray[np.float32]
    aside: NDArray[np.float32]

    def part(self, x0: int, y0: int, width: int, height: int) -> Depth:
        """Of some of the pixels."""
        rows, columns = slice(y0, y0 + height), slice(x0, x0 + width)
        return Depth(self.steepness[rows, columns], self.aside[rows, columns])

    def along_axis(self, distance: NDArray[np.float32]) -> NDArray[np.float32]:
        """Depth; NOWHERE where nothing was hit."""
        squares = (distance * self.steepness) ** 2 - self.aside**2
        return np.where(distance > 0.0, np.sqrt(np.maximum(squares, 0.0)), np.float32(NOWHERE)).astype(np.float32)


def depth_of(camera: Camera) -> Depth:
    """Of all pixels of a camera, at their middles."""
    whole_width, whole_height = camera.full_size or (camera.width, camera.height)
    left, top = (0, 0) if camera.crop is None else camera.crop[:2]
    half = 1.0 if camera.orthographic else math.tan(math.radians(camera.fov_x) / 2.0)
    across = ((left + np.arange(camera.width) + 0.5) / whole_width - 0.5 - camera.principal_point[0]) * 2.0 * half
    down = ((top + np.arange(camera.height) + 0.5) / whole_height - 0.5 - camera.principal_point[1]) * 2.0 * half
    down *= whole_height / whole_width
    squares = across[None, :] ** 2 + down[:, None] ** 2
    if camera.orthographic:
        aside = np.sqrt(squares) * np.linalg.norm(camera.to_world[:3, 0])
        return Depth(np.ones_like(aside, np.float32), aside.astype(np.float32))
    steepness = 1.0 / np.sqrt(1.0 + squares)
    return Depth(steepness.astype(np.float32), np.zeros_like(steepness, np.float32))
