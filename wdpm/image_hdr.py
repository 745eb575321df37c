"""Writes Radiance pictures (.hdr): RGB with a shared exponent, run-length encoded.

Ward, "Real Pixels", Graphics Gems II.

A value keeps 8 bits of the pixel's largest channel. Ward's own reader adds half a step to each mantissa because his
writer cuts off; nearly every reader of today (stb_image, for one) does not. So this writer rounds to nearest, and
scenes/hdr.py, which reads, adds nothing: the mean is kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import ImageError
from wdpm.scenes.hdr import EXPONENT_BIAS, RLE_WIDTHS

_RUN_LIMIT = 127  # a code byte above 128 is a run of (code - 128) equal values
_LITERAL_LIMIT = 128  # up to 128 it is that many values as they are
_SHORTEST_RUN = 3  # a run costs two bytes; a shorter one inside literals would not pay


def encode_hdr(pixels: NDArray[np.float32]) -> bytes:
    """RGB, shape [height, width, 3], to a file's bytes. Raises ImageError for values the format cannot hold."""
    bad = int((~np.isfinite(pixels) | (pixels < 0)).any(axis=2).sum())
    if bad:
        raise ImageError(f"{bad} pixels are negative or not finite, which .hdr cannot hold: save as .exr")
    height, width = pixels.shape[:2]
    rgbe = float_to_rgbe(pixels)
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode()
    if width not in RLE_WIDTHS:
        return head + rgbe.tobytes()
    marker = bytes((2, 2, width >> 8, width & 0xFF))
    rows = (marker + b"".join(_encode_run_length(row[:, c].tobytes()) for c in range(4)) for row in rgbe)
    return head + b"".join(rows)


def float_to_rgbe(pixels: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Finite, non-negative RGB, shape [..., 3], to mantissas and exponent, shape [..., 4], rounded to nearest.

    Pixels below the smallest exponent become black; above the largest (1.7e38) they are held at it.
    """
    largest = pixels.max(axis=-1).astype(np.float64)
    _, exponent = np.frexp(largest)  # largest in [2^(e-1), 2^e): its mantissa is in [128, 256)
    exponent += np.round(np.ldexp(largest, 8 - exponent)) > 255  # rounds up to 256: needs the next exponent
    exponent = np.minimum(exponent, 255 - EXPONENT_BIAS)
    mantissa = np.minimum(np.round(np.ldexp(pixels.astype(np.float64), (8 - exponent)[..., None])), 255)
    held = exponent + EXPONENT_BIAS >= 1  # a stored exponent of 0 means black
    rgbe = np.concatenate([mantissa, (exponent + EXPONENT_BIAS)[..., None]], axis=-1)
    return np.where((held & (largest > 0))[..., None], rgbe, 0).astype(np.uint8)


def _encode_run_length(plane: bytes) -> bytes:
    """One channel of one scanline: runs as (128 + length, value), literals as (length, values...)."""
    values = np.frombuffer(plane, dtype=np.uint8)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    lengths = np.diff(np.concatenate([starts, [len(values)]]))
    worth = lengths >= _SHORTEST_RUN
    out = bytearray()
    literal_start = 0
    for start, length in zip(starts[worth].tolist(), lengths[worth].tolist(), strict=True):
        _put_literals(out, plane[literal_start:start])
        for offset in range(0, length, _RUN_LIMIT):
            out += bytes((128 + min(_RUN_LIMIT, length - offset), plane[start]))
        literal_start = start + length
    _put_literals(out, plane[literal_start:])
    return bytes(out)


def _put_literals(out: bytearray, values: bytes) -> None:
    for offset in range(0, len(values), _LITERAL_LIMIT):
        piece = values[offset : offset + _LITERAL_LIMIT]
        out.append(len(piece))
        out += piece
