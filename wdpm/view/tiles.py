"""Pixels on their way to the page: one binary message a tile.

    u32 length of the header | header, JSON, padded with spaces to a multiple of 4 bytes | float32 pixels

All little endian, rows from the top, channels interleaved. The norm is docs/view.md.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from wdpm.view.picture import Rectangle

TILE = 256
"""Side of a tile of a whole layer [pixels]: 768 KiB in colour, so that a page shows something of a large image soon."""


def pack_tile(source: str, image: int, layer: str, place: Rectangle, pixels: NDArray[np.float32]) -> bytes:
    """A message.

    Args:
        source: which picture: "a" or "b".
        image: its number (Picture.now).
        pixels: from the upper left corner of `place`, shape [height, width] or [height, width, 3].
    """
    header = {
        "source": source,
        "image": image,
        "layer": layer,
        "x": place.x0,
        "y": place.y0,
        "width": int(pixels.shape[1]),
        "height": int(pixels.shape[0]),
        "channels": 1 if pixels.ndim == 2 else int(pixels.shape[2]),
    }
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<I", len(text)) + text + np.ascontiguousarray(pixels, "<f4").tobytes()


def tiles_of(width: int, height: int) -> Iterator[Rectangle]:
    """The tiles of a whole layer, row by row."""
    for y in range(0, height, TILE):
        for x in range(0, width, TILE):
            yield Rectangle(x, y, min(x + TILE, width), min(y + TILE, height))
