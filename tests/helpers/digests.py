"""What equality of images means to the tests: every bit of every layer but the one that names the partition."""

from __future__ import annotations

from dataclasses import replace

from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.model.scene import Scene


def alone(scene: Scene, chosen: RenderSettings) -> Image:
    """The image of one cell on one thread, in one bucket: what all others are compared with."""
    return render_in_process(scene, replace(chosen, bucket=1024), workers=1, cells=1, threads=1)


def same_bits(one: Image, other: Image) -> bool:
    """Whether two images agree in all layers but `cell`."""
    return without_cells(one).digest() == without_cells(other).digest()


def without_cells(image: Image) -> Image:
    """The image without the layer that tells which cell shaded a pixel."""
    return Image({name: layer for name, layer in image.layers.items() if name != "cell"})
