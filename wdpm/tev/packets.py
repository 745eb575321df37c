"""What tev is told over TCP: packets as its source has them (https://github.com/Tom94/tev, include/tev/Ipc.h).

A packet is its own length (u32, these 4 bytes included), a type (1 byte), and fields one after another, little endian:
a bool is a byte, a string ends with a zero byte, numbers of pixels are i32, offsets and strides i64, pixels float32.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


class Kind(IntEnum):
    """Types of packets, of those that are sent here."""

    CREATE_IMAGE = 4
    UPDATE_IMAGE = 6  # its third version, with offsets and strides of channels
    OPEN_IMAGE = 7  # its second, with a selector of channels


def create_image(name: str, width: int, height: int, channels: Sequence[str]) -> bytes:
    """Have an image of zeros shown, in front of others.

    Args:
        channels: "R", "G", "B", and "layer.R" and so on for further layers.
    """
    body = struct.pack("<?", True) + _text(name) + struct.pack("<iii", width, height, len(channels))
    return _packet(Kind.CREATE_IMAGE, body + b"".join(map(_text, channels)))


def update_image(name: str, x: int, y: int, channels: Sequence[str], pixels: NDArray[np.float32]) -> bytes:
    """Replace some pixels.

    Args:
        x, y: where their upper left corner goes.
        pixels: shape [height, width, channels].
    """
    height, width, count = pixels.shape
    if count != len(channels):
        raise ValueError(f"pixels have {count} channels, but {len(channels)} are named")
    body = struct.pack("<?", False) + _text(name) + struct.pack("<i", count) + b"".join(map(_text, channels))
    body += struct.pack("<iiii", x, y, width, height)
    body += struct.pack(f"<{count}q", *range(count)) + struct.pack(f"<{count}q", *[count] * count)
    return _packet(Kind.UPDATE_IMAGE, body + np.ascontiguousarray(pixels, "<f4").tobytes())


def open_image(path: Path) -> bytes:
    """Have tev open a file, with all channels; it is tev that reads it, so the path must mean something there."""
    return _packet(Kind.OPEN_IMAGE, struct.pack("<?", True) + _text(str(path)) + _text(""))


def _packet(kind: Kind, body: bytes) -> bytes:
    return struct.pack("<IB", 5 + len(body), kind) + body


def _text(text: str) -> bytes:
    return text.replace("\0", "").encode() + b"\0"
