"""How large an image may be: as its layers have room in memory, and as kernels can number its pixels."""

from __future__ import annotations

from wdpm.cluster.host_memory import machine_memory
from wdpm.cluster.layers import LAYERS
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.model.scene import Camera

MOST_PIXELS = 2**31 - 1
"""Kernels number pixels in 32 bits with a sign."""

BYTES_A_PIXEL = 4 * 2 * sum(LAYERS.values())
"""All layers in 32 bits, and once more channel by channel while they are written."""


def check_pixels(camera: Camera) -> None:
    """Raise SettingsError if an image has more pixels than can be numbered."""
    pixels = camera.width * camera.height
    if pixels > MOST_PIXELS:
        raise SettingsError(
            f"an image of {camera.width}x{camera.height} has {pixels:,} pixels, more than can be numbered; "
            f"expected at most {MOST_PIXELS:,}: render it in parts, by the crop of a Mitsuba film"
        )


def check_memory(camera: Camera) -> None:
    """Raise SettingsError if an image takes more memory than this machine has in all: it would end without an image."""
    needed, there = BYTES_A_PIXEL * camera.width * camera.height, machine_memory()
    if needed > there:
        raise SettingsError(
            f"an image of {camera.width}x{camera.height} takes {needed / 2**30:,.1f} GiB of memory with its layers, "
            f"and this machine has {there / 2**30:,.1f} GiB; give a smaller --size"
        )
