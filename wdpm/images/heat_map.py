"""A heat map: how far each pixel of an image is off, dark to bright, with its scale written under it.

Colours are those of magma (van der Walt & Smith 2015, CC0), which FLIP's authors use: as bright as they are large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from wdpm.images.comparison import RELATIVE_FLOOR, check_same_size
from wdpm.images.difference_picture import round_scale
from wdpm.images.image import Image
from wdpm.images.picture_legend import with_legend

_MAGMA = np.array(
    [
        [0x00, 0x00, 0x04],
        [0x14, 0x0E, 0x36],
        [0x3B, 0x0F, 0x70],
        [0x64, 0x1A, 0x80],
        [0x8C, 0x29, 0x81],
        [0xB7, 0x37, 0x79],
        [0xDE, 0x49, 0x68],
        [0xF7, 0x70, 0x5C],
        [0xFE, 0x9F, 0x6D],
        [0xFE, 0xCF, 0x92],
        [0xFC, 0xFD, 0xBF],
    ],
    dtype=np.float64,
)

# Green: magma has no green, but it has the magenta of the difference picture.
_NOT_FINITE = np.array([0, 255, 0], dtype=np.uint8)

_DECADES = 4
"""Shown of an error that is squared."""


class Heat(Enum):
    """What a heat map shows."""

    FLIP = "flip"
    """FLIP, from 0 to 1 always, so that two maps can be laid side by side."""
    REL_MSE = "rel_mse"
    """The pixel's part of relMSE, on a logarithmic scale of four decades."""
    ABS = "abs"
    """The largest |A - B| of the three channels."""


@dataclass(frozen=True)
class Scale:
    """From which value to which the colours go.

    Attributes:
        low, high: values of the first and the last colour; both 0 where nothing differs.
        logarithmic: whether equal steps of colour are equal factors; `low` is positive then.
    """

    low: float
    high: float
    logarithmic: bool = False

    def share(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where values lie between the ends, clipped to [0, 1]. NaN stays."""
        if self.high == 0:
            return np.where(np.isnan(values), np.nan, 0.0)
        if not self.logarithmic:
            return np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0)
        with np.errstate(divide="ignore"):  # no difference at all: the darkest colour
            return np.clip(np.log(values / self.low) / math.log(self.high / self.low), 0.0, 1.0)


def heat_map(values: NDArray[np.float64], scale: Scale, what: str) -> NDArray[np.uint8]:
    """Errors of pixels to colours, with the scale in a strip below.

    Args:
        values: 0 or more, shape [height, width]; NaN is green.
        what: the words in the middle of the strip.

    Returns:
        8-bit sRGB, shape [height + 34, max(width, 256), 3].
    """
    if scale.high == 0:
        what = f"{what}: no difference"
    if scale.logarithmic:
        what += ", log"
    bar = magma(np.linspace(0, 1, 256))
    return with_legend(magma(scale.share(values)), bar, f"{scale.low:g}", what, f"{scale.high:g}")


def magma(share: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Values in [0, 1] to colours, shape [..., 3]."""
    stops = np.linspace(0, 1, len(_MAGMA))
    channels = [np.interp(np.nan_to_num(share), stops, _MAGMA[:, c]) for c in range(3)]
    colours = np.stack(channels, axis=-1).round().astype(np.uint8)
    colours[np.isnan(share)] = _NOT_FINITE
    return colours


def error_map(a: Image, b: Image, heat: Heat) -> NDArray[np.uint8]:
    """The heat map of `a` against reference `b`, of all but FLIP (see flip_map). Raises ImageError: sizes differ."""
    values = pixel_errors(a, b, heat)
    if heat is Heat.ABS:
        return heat_map(values, Scale(0.0, round_scale(values)), "|A-B|")
    return heat_map(values, _decades(values), f"(A-B)^2/(B^2+{RELATIVE_FLOOR:g})")


def flip_map(errors: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The heat map of FLIP's errors, shape [height, width]."""
    return heat_map(errors, Scale(0.0, 1.0), "FLIP")


def pixel_errors(a: Image, b: Image, heat: Heat) -> NDArray[np.float64]:
    """What `error_map` shows, shape [height, width]; NaN where a channel is not finite.

    The mean of `Heat.REL_MSE` is relMSE, if all values are finite.
    """
    check_same_size(a, b)
    reference = b.pixels.astype(np.float64)
    with np.errstate(invalid="ignore", over="ignore"):  # inf - inf: shown as not finite
        difference = np.abs(a.pixels.astype(np.float64) - reference)
        errors = difference.max(axis=2)
        if heat is Heat.REL_MSE:
            errors = (difference**2 / (reference**2 + RELATIVE_FLOOR)).mean(axis=2)
        elif heat is not Heat.ABS:
            raise ValueError(f"{heat}: not an error of single pixels")
    return np.where(np.isfinite(errors), errors, np.nan)


def _decades(values: NDArray[np.float64]) -> Scale:
    """Down from the power of ten that 99.5 % of the differing pixels stay within."""
    sizes = values[np.isfinite(values) & (values > 0)]
    if sizes.size == 0:
        return Scale(0.0, 0.0)
    power = math.ceil(math.log10(float(np.quantile(sizes, 0.995))) - 1e-9)
    return Scale(10.0 ** (power - _DECADES), 10.0**power, logarithmic=True)
