"""What equality of images means to the tests: every bit of every layer but the one that names the partition."""

from __future__ import annotations

from wdpm.image import Image


def same_bits(one: Image, other: Image) -> bool:
    """Whether two images agree in all layers but `cell`."""
    return without_cells(one).digest() == without_cells(other).digest()


def without_cells(image: Image) -> Image:
    """The image without the layer that tells which cell shaded a pixel."""
    return Image({name: layer for name, layer in image.layers.items() if name != "cell"})
