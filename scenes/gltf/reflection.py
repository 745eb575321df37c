"""What dielectrics of glTF 2.0 reflect: KHR_materials_ior and KHR_materials_specular as mixtures of leaves.

Source: Khronos Group, "KHR_materials_specular", section Implementation. There a dielectric reflects, at a facet that
light meets at an angle a, s (c + (1 - c)(1 - cos a)^5), with a strength s and a colour c head-on, and scatters
diffusely what its brightest channel leaves.

A common dielectric does that for a grey c, a metal of a colour m does it without any diffuse part, and so does a
mixture of both, with a share w of the metal. Head-on a channel reflects (1 - w) g + w m; so c is asked for where

    w = (max(c) - g) / (1 - g),   m = (c - (1 - w) g) / w

and the diffuse part is the right one then, too: (1 - w)(1 - g) = 1 - max(c). m is a colour where (1 - w) g is not above
the least channel of c. A strength below 1 mixes with a surface that reflects next to nothing, which is all diffuse.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.gltf.textures import each as each_texel
from wdpm.scenes.model.bsdfs import HARDLY_ANY, WHITE, Blend, Bsdf
from wdpm.scenes.model.textures import RGB, Bitmap, Color, Number

_MOST_OF_DIELECTRICS: Final = 0.08
"""Head-on reflection up to which a coloured one is taken as grey: a few per cent of metal would be but noise."""

_OF_MOST_DIELECTRICS: Final = 0.04

_MOST: Final = 0.81
"""The largest head-on reflection that an index of refraction stands for: 1 has none."""


@dataclass(frozen=True, eq=False)
class Reflection:
    """How a dielectric reflects.

    Attributes:
        eta: index of refraction of what is not metal.
        share: of the metal in the mixture.
        color: of the metal.
        strengths: factors of all reflection.
        greyed: whether a colour was left out.
    """

    eta: float
    share: Number = 0.0
    color: Color = WHITE
    strengths: tuple[Number, ...] = ()
    greyed: bool = False

    def over(self, dielectric: Callable[[float], Bsdf], metal: Callable[[Color], Bsdf]) -> Bsdf:
        """This reflection over what else a dielectric does.

        Args:
            dielectric: the surface, by its index of refraction.
            metal: by its colour.
        """
        if 0.0 in self.strengths:
            return dielectric(HARDLY_ANY)
        surface = metal(self.color) if self.share == 1.0 else dielectric(self.eta)
        if self.share not in (0.0, 1.0):
            surface = Blend(surface, metal(self.color), self.share)
        for strength in self.strengths:
            surface = Blend(dielectric(HARDLY_ANY), surface, strength)
        return surface

    def weakened(self, strength: Number) -> Reflection:
        """With one more factor."""
        return self if strength == 1.0 else replace(self, strengths=(*self.strengths, strength))


def reflection_of(color: RGB) -> Reflection:
    """Of a colour head-on, in [0, 1]."""
    least, most = min(color), max(color)
    if least == most or most <= _MOST_OF_DIELECTRICS:
        mean = sum(color) / 3.0
        least, most = mean, mean
    grey = min(least / (1.0 - most + least), _MOST) if least > 0.0 else 0.0
    share = (most - grey) / (1.0 - grey)
    if share < 1e-9:
        return Reflection(index_of(grey), greyed=max(color) != min(color))
    red, green, blue = (min(max((channel - (1.0 - share) * grey) / share, 0.0), 1.0) for channel in color)
    return Reflection(index_of(grey), share, (red, green, blue))


def textured_reflection(colors: Bitmap, most: float) -> Reflection:
    """Of a texture of colours head-on.

    Up to what dielectrics have, it lessens a grey one, also towards grazing angles. Beyond, dark metals and dielectrics
    are told apart texel by texel; a dielectric there reflects no less than most do.

    Args:
        most: what the texture shows where it is white.
    """
    if most <= _MOST_OF_DIELECTRICS:
        shown = each_texel(colors, lambda pixels: grey_of(pixels) / np.float32(max(most, 1e-20)))
        return Reflection(index_of(most), strengths=(shown,), greyed=True)
    grey = np.float32(_OF_MOST_DIELECTRICS)

    def shares(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        brightest = np.minimum(pixels, np.float32(1.0)).max(axis=2, keepdims=True)
        return np.repeat(np.clip((brightest - grey) / (1 - grey), 0, 1), 3, axis=2).astype(np.float32)

    def metals(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        share = shares(pixels)
        rest = np.minimum(pixels, np.float32(1.0)) - (1 - share) * grey
        return np.clip(rest / np.maximum(share, np.float32(1e-6)), 0, 1).astype(np.float32)

    return Reflection(index_of(float(grey)), each_texel(colors, shares), each_texel(colors, metals))


def head_on(eta: float) -> float:
    """What an interface reflects of light that meets it head-on."""
    return ((eta - 1.0) / (eta + 1.0)) ** 2


def index_of(reflectance: float) -> float:
    """The index of refraction of an interface that reflects so much head-on."""
    root = math.sqrt(min(reflectance, _MOST))
    return (1.0 + root) / (1.0 - root)


def index_of_pane(eta: float) -> float:
    """The index of a pane that reflects as much head-on as one interface of an index eta.

    KHR_materials_transmission changes nothing of the reflection; a pane, with what its two sides throw to and fro,
    reflects 2 r / (1 + r).
    """
    reflectance = head_on(eta)
    return index_of(reflectance / (2.0 - reflectance))


def grey_of(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """The mean of the channels, in all of them."""
    return np.repeat(pixels.mean(axis=2, keepdims=True), 3, axis=2)
