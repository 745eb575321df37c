"""Mitsuba's grid volumes, version 3 of the format: https://mitsuba.readthedocs.io, plugin `gridvolume`."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_HEADER: Final = struct.Struct("<3sB i 3i i 6f")
_VERSION: Final = 3
_ENCODINGS: Final[dict[int, np.dtype[Any]]] = {1: np.dtype("<f4"), 2: np.dtype("<f2"), 3: np.dtype("|u1")}


@dataclass(frozen=True, eq=False)
class Voxels:
    """What a file of voxels has.

    Attributes:
        values: shape [z, y, x, channels], float32.
        low, high: opposite corners of the box that they fill, as the file says.
    """

    values: NDArray[np.float32]
    low: tuple[float, float, float] = (0.0, 0.0, 0.0)
    high: tuple[float, float, float] = (1.0, 1.0, 1.0)


def decode_vol(data: bytes) -> Voxels:
    """The voxels of a file; bytes become numbers from 0 to 1.

    Raises:
        ValueError: it is broken, or of another kind.
    """
    if len(data) < _HEADER.size:
        raise ValueError(f"{len(data)} bytes; a grid volume has a header of {_HEADER.size}")
    magic, version, encoding, x, y, z, channels, *box = _HEADER.unpack_from(data)
    if magic != b"VOL" or version != _VERSION:
        raise ValueError(f'it does not begin with "VOL" and version {_VERSION}, so it is no grid volume of Mitsuba')
    if encoding not in _ENCODINGS:
        raise ValueError(f"encoding {encoding}; expected 1 (float32), 2 (float16) or 3 (uint8)")
    if min(x, y, z) < 1 or channels not in (1, 3):
        raise ValueError(f"{x} x {y} x {z} voxels of {channels} channels; expected at least 1 of 1 or 3 channels")
    if not all(map(math.isfinite, box)):
        raise ValueError("its bounding box is not finite")
    dtype = _ENCODINGS[encoding]
    expected = x * y * z * channels * dtype.itemsize
    there = len(data) - _HEADER.size
    if there != expected:
        raise ValueError(f"{there:,} bytes of voxels; {x} x {y} x {z} of {channels} channels are {expected:,}")
    values = np.frombuffer(data, dtype, offset=_HEADER.size).reshape(z, y, x, channels).astype(np.float32)
    if dtype.itemsize == 1:
        values *= np.float32(1.0 / 255.0)
    return Voxels(values, (box[0], box[1], box[2]), (box[3], box[4], box[5]))
