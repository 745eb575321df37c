"""Image textures as the wire has them: those read from files of 8 bits as numbers of 8 bits, with what these stand for.

A file of 8 bits has 256 values, whichever way they are decoded, and every slave has all textures: a fourth of the bytes
is sent. The receiver looks the values up, so it has the same bits.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.model.textures import Bitmap, Interpolation, Wrap

MOST_COLOURS = 256
"""That 8 bits tell apart."""

WORTH_IT = 1 << 12
"""Values of an image; smaller ones travel as they are."""

AT_ONCE = 1 << 16
"""Values that are looked at together, so that what is made of them on the way stays in a cache."""

SOME = 16
"""Every so many-th value is looked at first."""

HALF = 16
"""Bits of half a float32. Values of 8 bits, decoded or not, differ in the high half of theirs."""


@dataclass(frozen=True, eq=False)
class ShortBitmap:
    """What stands for a Bitmap in a message.

    Attributes:
        palette: what the numbers of `pixels` stand for, float32, shape [N], N <= 256; none if these are no numbers.
        pixels: of the bitmap: its values, or the number of each in the palette, uint8, shape [height, width, 3].
        name, wrap, interpolation, to_uv, tinted: the bitmap's.
    """

    name: str
    palette: NDArray[np.float32]
    pixels: NDArray[Any]
    wrap: Wrap
    interpolation: Interpolation
    to_uv: NDArray[np.float64]
    tinted: bool


_shortened: weakref.WeakKeyDictionary[Bitmap, ShortBitmap] = weakref.WeakKeyDictionary()


def shorten(bitmap: Bitmap) -> ShortBitmap:
    """A bitmap for the wire. It is worked out once for all receivers, and kept as long as the bitmap is."""
    found = _shortened.get(bitmap)
    if found is None:
        palette, pixels = _numbered(bitmap.pixels) or (np.empty(0, np.float32), bitmap.pixels)
        found = ShortBitmap(
            bitmap.name, palette, pixels, bitmap.wrap, bitmap.interpolation, bitmap.to_uv, bitmap.tinted
        )
        if len(palette):  # otherwise the bitmap would be kept by itself
            _shortened[bitmap] = found
    return found


def lengthen(short: ShortBitmap, where: str) -> Bitmap:
    """The bitmap, with the same bits; ProtocolError if there is no such bitmap."""
    numbers, pixels = short.pixels.dtype == np.uint8, short.pixels
    if numbers != (len(short.palette) > 0) or not (numbers or pixels.dtype == np.float32):
        raise ProtocolError(f"{where} has pixels of {pixels.dtype} and a palette of {len(short.palette)}")
    if numbers:
        if len(short.palette) > MOST_COLOURS or (pixels.size and int(pixels.max()) >= len(short.palette)):
            raise ProtocolError(f"{where} has pixels that its palette of {len(short.palette)} does not")
        pixels = _looked_up(short.palette, pixels)
    return Bitmap(short.name, pixels, short.wrap, short.interpolation, short.to_uv, short.tinted)


def _numbered(pixels: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.uint8]] | None:
    """The values that pixels have, and the number of each pixel's; None if there are too many of them."""
    values = np.ascontiguousarray(pixels).reshape(-1).view(np.uint32)
    if len(values) < WORTH_IT:
        return None
    for some in (values[::SOME], values):  # mostly some have all values that there are
        palette = _palette(some)
        if palette is None:
            return None
        numbers = _numbers(values, palette)
        if numbers is not None:
            return palette.view(np.float32), numbers.reshape(pixels.shape)
    return None


def _palette(values: NDArray[np.uint32]) -> NDArray[np.uint32] | None:
    """Values of which no two have the same high half, and all high halves; None if these are too many."""
    first = np.zeros(1 << HALF, np.uint32)
    there = np.zeros(1 << HALF, np.bool_)
    for start in range(0, len(values), AT_ONCE):
        block = values[start : start + AT_ONCE]
        half = block >> HALF
        there[half], first[half] = True, block
        if np.count_nonzero(there) > MOST_COLOURS:
            return None
    return first[there]


def _numbers(values: NDArray[np.uint32], palette: NDArray[np.uint32]) -> NDArray[np.uint8] | None:
    """The number of each value in a palette; None if one is not there."""
    number = np.zeros(1 << HALF, np.uint8)
    number[palette >> HALF] = np.arange(len(palette))
    numbers = np.empty(len(values), np.uint8)
    for start in range(0, len(values), AT_ONCE):
        block = slice(start, start + AT_ONCE)
        number.take(values[block] >> HALF, out=numbers[block])
        if not np.array_equal(palette.take(numbers[block]), values[block]):
            return None
    return numbers


def _looked_up(palette: NDArray[np.float32], numbers: NDArray[np.uint8]) -> NDArray[np.float32]:
    found = np.empty(numbers.shape, np.float32)
    of_pixel, values = np.ascontiguousarray(numbers).reshape(-1), found.reshape(-1)
    for start in range(0, len(values), AT_ONCE):
        block = slice(start, start + AT_ONCE)
        palette.take(of_pixel[block], out=values[block], mode="clip")  # none is beyond the palette
    return found
