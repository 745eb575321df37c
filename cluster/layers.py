"""The layers of a rendered image, and which of them a world has."""

from __future__ import annotations

from collections.abc import Mapping

from wdpm.cluster.world import View, World
from wdpm.kernels.camera.diffuse_light import DiffuseLight

LAYERS: Mapping[str, int] = {
    "beauty": 3,
    "direct": 3,
    "indirect": 3,
    "caustic": 3,
    "volume": 3,
    "depth": 1,
    "normal": 3,
    "albedo": 3,
    "cell": 1,
}
"""Layers of a rendered image -> channels; a layer of one channel has no third axis."""


def layers_of(world: World, view: View) -> dict[str, int]:
    """The layers that images of a world have: those of light that nothing brings are left out."""
    traced = view.diffuse_light is DiffuseLight.PATHS and len(world.media.g) > 0
    absent = {"caustic": world.caustic_map.paths == 0, "volume": world.volume_map.paths == 0 and not traced}
    return {name: channels for name, channels in LAYERS.items() if not absent.get(name, False)}
