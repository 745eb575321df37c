"""Reads and writes portable float maps: RGB or grey, 32-bit float, rows from bottom to top (Debevec's format)."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import ImageError

_HEADER = re.compile(rb"(PF|Pf)\s+(\d+)\s+(\d+)\s+([-+]?[0-9.]+(?:[eE][-+]?\d+)?)\s")


def decode_pfm(data: bytes, name: str) -> NDArray[np.float32]:
    """A file's bytes to RGB, shape [height, width, 3]; grey is repeated. Raises ImageError naming `name`."""
    header = _HEADER.match(data)
    if header is None:
        raise ImageError(f"{name}: not a PFM file: expected 'PF', width, height and scale")
    channels = 3 if header[1] == b"PF" else 1
    width, height, scale = int(header[2]), int(header[3]), float(header[4])
    expected = width * height * channels * 4
    body = data[header.end() :]
    if len(body) != expected:
        raise ImageError(f"{name}: {len(body)} bytes of pixels, expected {expected} for {width}x{height}: broken file")
    values = np.frombuffer(body, dtype="<f4" if scale < 0 else ">f4").reshape(height, width, channels)
    return np.broadcast_to(values[::-1], (height, width, 3)).astype(np.float32)


def encode_pfm(pixels: NDArray[np.float32]) -> bytes:
    """RGB, shape [height, width, 3], to a file's bytes. A scale below zero says little-endian."""
    height, width = pixels.shape[:2]
    return f"PF\n{width} {height}\n-1.0\n".encode() + pixels[::-1].astype("<f4").tobytes()
