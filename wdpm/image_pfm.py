"""Writes portable float maps: RGB or grey, 32-bit float, rows from the bottom to the top (Debevec's format)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def encode_pfm(pixels: NDArray[np.float32]) -> bytes:
    """RGB, shape [height, width, 3], to a file's bytes. A scale below zero says little-endian."""
    height, width = pixels.shape[:2]
    return f"PF\n{width} {height}\n-1.0\n".encode() + pixels[::-1].astype("<f4").tobytes()
