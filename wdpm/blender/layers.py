"""Our layers as Blender's passes."""

from __future__ import annotations

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


def pixels_of(each: Pass, layers: Layers, steepness: NDArray[np.float32]) -> NDArray[np.float32]:
    """A pass as Blender takes it: float32, lowest row first, flat.

    Args:
        layers: ours, of the whole picture or of a part.
        steepness: of the same pixels, see `steepness_of`.
    """
    layer = layers.get(each.layer)
    height, width = steepness.shape
    pixels = np.zeros((height, width, len(each.channels)), np.float32)
    if layer is None:  # light of a kind that the scene has none of
        return pixels.reshape(-1)
    if each.layer == "depth":
        pixels[:, :, 0] = np.where(layer > 0.0, layer * steepness, NOWHERE)
    elif each.channels == "RGBA":
        pixels[:, :, :3], pixels[:, :, 3] = layer, 1.0
    else:
        pixels[:] = layer if layer.ndim == 3 else layer[:, :, None]
    return np.ascontiguousarray(pixels[::-1]).reshape(-1)


def steepness_of(camera: Camera) -> NDArray[np.float32]:
    """Depth along the camera's axis, which Blender has, over distance, which we have: float32, [height, width]."""
    if camera.orthographic:
        return np.ones((camera.height, camera.width), np.float32)
    whole_width, whole_height = camera.full_size or (camera.width, camera.height)
    left, top = (0, 0) if camera.crop is None else camera.crop[:2]
    half = np.tan(np.radians(camera.fov_x) / 2.0)
    across = ((left + np.arange(camera.width) + 0.5) / whole_width - 0.5 - camera.principal_point[0]) * 2.0 * half
    down = ((top + np.arange(camera.height) + 0.5) / whole_height - 0.5 - camera.principal_point[1]) * 2.0 * half
    down *= whole_height / whole_width
    return (1.0 / np.sqrt(1.0 + across[None, :] ** 2 + down[:, None] ** 2)).astype(np.float32)
