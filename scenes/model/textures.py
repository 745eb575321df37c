"""Textures: what a parameter of a material or a light may be in place of one value."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

RGB = tuple[float, float, float]


class Wrap(Enum):
    """What a texture shows outside the unit square."""

    REPEAT = "repeat"
    MIRROR = "mirror"
    CLAMP = "clamp"


class Interpolation(Enum):
    """How a texture is read between texels."""

    BILINEAR = "bilinear"
    NEAREST = "nearest"


def _identity() -> NDArray[np.float64]:
    return np.eye(3)


@dataclass(frozen=True, eq=False)
class Bitmap:
    """An image texture.

    Attributes:
        name: for messages: the file it came from.
        pixels: linear RGB, float32, shape [height, width, 3]; row 0 is the top of the image, which lies at v = 1.
        to_uv: affine map of texture coordinates applied before the lookup, shape [3, 3] (row vectors of a 2-D
            homogeneous matrix that multiplies the column (u, v, 1)).
        tinted: whether it is multiplied by the colours at the mesh's vertices (Mesh.colors).
    """

    name: str
    pixels: NDArray[np.float32]
    wrap: Wrap = Wrap.REPEAT
    interpolation: Interpolation = Interpolation.BILINEAR
    to_uv: NDArray[np.float64] = field(default_factory=_identity)
    tinted: bool = False

    def __post_init__(self) -> None:
        """Pixels of another type become float32: kernels and the wire take nothing else."""
        object.__setattr__(self, "pixels", np.ascontiguousarray(self.pixels, np.float32))


@dataclass(frozen=True, eq=False)
class Checkerboard:
    """Squares of side 1/2 of two colours, as Mitsuba's `checkerboard`: color0 where both halves are alike.

    Attributes:
        color0, color1: linear RGB.
        to_uv: as that of Bitmap, but for Mitsuba's own v: no turning upside down.
    """

    name: str
    color0: RGB = (0.4, 0.4, 0.4)
    color1: RGB = (0.2, 0.2, 0.2)
    to_uv: NDArray[np.float64] = field(default_factory=_identity)


@dataclass(frozen=True, eq=False)
class VertexColors:
    """The colours at a mesh's vertices (Mesh.colors), linear between them; also of faces that have their own vertices.

    Attributes:
        name: of the attribute in the file.
        scale: factor.
    """

    name: str
    scale: float = 1.0


Texture = Bitmap | Checkerboard | VertexColors

Color = RGB | Texture
"""A linear RGB value, or a texture of it."""

Number = float | Texture
"""A number, or a texture whose luminance is read."""
