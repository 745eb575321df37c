"""A picture of where two images differ, with its scale written under it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wdpm.images.comparison import RELATIVE_FLOOR, check_same_size
from wdpm.images.image import Image
from wdpm.images.picture_legend import with_legend

# A diverging map on black: where nothing differs nothing shows. Blue and orange stay apart for colour-blind eyes.
_BELOW = np.array([[0, 0, 0], [30, 90, 220], [170, 225, 255]], dtype=np.float64)
_ABOVE = np.array([[0, 0, 0], [225, 95, 15], [255, 235, 140]], dtype=np.float64)
_NOT_FINITE = np.array([255, 0, 255], dtype=np.uint8)


def difference_picture(a: Image, b: Image, relative: bool = True) -> NDArray[np.uint8]:
    """Where `a` is darker (blue) or brighter (orange) than `b`, with the scale in a strip below.

    Args:
        relative: show (a - b) / sqrt(b² + 0.01), whose mean square is relMSE; otherwise a - b. Of the three channels
            the one that differs most is shown. A value that is not finite is magenta.

    Returns:
        8-bit sRGB, shape [height + 34, max(width, 256), 3].

    Raises:
        ImageError: the sizes differ.
    """
    values = signed_difference(a, b, relative)
    scale = round_scale(values)
    formula = f"(A-B)/sqrt(B*B+{RELATIVE_FLOOR:g})" if relative else "A-B"
    bar = heat(np.linspace(-1, 1, 511), 1.0)
    middle = formula if scale > 0 else "no difference"
    return with_legend(heat(values, scale), bar, f"-{scale:g}", middle, f"+{scale:g}")


def signed_difference(a: Image, b: Image, relative: bool) -> NDArray[np.float64]:
    """The difference of the channel that differs most, shape [height, width]; NaN where a channel is not finite."""
    check_same_size(a, b)
    reference = b.pixels.astype(np.float64)
    with np.errstate(invalid="ignore", over="ignore"):  # inf - inf: shown as not finite
        difference = a.pixels.astype(np.float64) - reference
        if relative:
            difference /= np.sqrt(reference**2 + RELATIVE_FLOOR)
    broken = np.logical_not(np.isfinite(difference).all(axis=2))
    channel = np.abs(np.nan_to_num(difference)).argmax(axis=2)
    strongest = np.take_along_axis(difference, channel[..., None], axis=2)[..., 0]
    return np.where(broken, np.nan, strongest)


def round_scale(values: NDArray[np.float64]) -> float:
    """The value shown at full colour: 1, 2 or 5 times a power of ten that 99.5 % of the differing pixels stay within.

    0 when nothing differs.
    """
    sizes = np.abs(values[np.isfinite(values) & (values != 0)])
    if sizes.size == 0:
        return 0.0
    limit = float(np.quantile(sizes, 0.995))
    power = 10.0 ** math.floor(math.log10(limit))
    return next(step * power for step in (1, 2, 5, 10) if limit <= step * power * (1 + 1e-9))


def heat(values: NDArray[np.float64], scale: float) -> NDArray[np.uint8]:
    """Signed values to colours, full at ±scale, shape [height, width, 3]."""
    share = np.clip(values / scale, -1.0, 1.0) if scale > 0 else np.zeros_like(values)
    magnitude = np.abs(np.nan_to_num(share))
    stops = np.array([0.0, 0.5, 1.0])
    below = np.stack([np.interp(magnitude, stops, _BELOW[:, c]) for c in range(3)], axis=-1)
    above = np.stack([np.interp(magnitude, stops, _ABOVE[:, c]) for c in range(3)], axis=-1)
    picture = np.where((share < 0)[..., None], below, above).round().astype(np.uint8)
    picture[~np.isfinite(values)] = _NOT_FINITE
    return picture
