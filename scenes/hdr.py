"""Reads Radiance pictures (.hdr): RGB with a shared exponent, run-length encoded.

Ward, "Real Pixels", Graphics Gems II. His own reader adds half a step to each mantissa because his writer cuts off;
nearly every reader of today (stb_image, for one) does not, and neither does this one.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import ImageError

EXPONENT_BIAS = 128
RLE_WIDTHS = range(8, 0x8000)  # widths whose scanlines may be run-length encoded

_HEADER = re.compile(rb"#\?(?:RADIANCE|RGBE)[^\n]*\n(.*?\n)?\n-Y (\d+) \+X (\d+)\n", re.DOTALL)


def decode_hdr(data: bytes, name: str) -> NDArray[np.float32]:
    """A file's bytes to RGB, shape [height, width, 3]. Raises ImageError naming `name`."""
    header = _HEADER.match(data)
    if header is None:
        raise ImageError(f"{name}: not a Radiance picture with rows from top to bottom ('-Y height +X width')")
    variables = (header[1] or b"").decode("latin-1")
    if "FORMAT=32-bit_rle_xyze" in variables:
        raise ImageError(f"{name}: is in XYZ colours; only RGB is read: convert it with Radiance's ra_xyze -r")
    height, width = int(header[2]), int(header[3])
    body = memoryview(data)[header.end() :]
    rgbe = _decode_rows(body, height, width, name)
    exposure = float(np.prod([float(e) for e in re.findall(r"^EXPOSURE=\s*([0-9.eE+-]+)", variables, re.MULTILINE)]))
    return rgbe_to_float(rgbe) / np.float32(exposure)


def rgbe_to_float(rgbe: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Mantissas and exponent, shape [..., 4], to RGB, shape [..., 3]."""
    exponent = rgbe[..., 3:].astype(np.int32)
    value = np.ldexp(rgbe[..., :3].astype(np.float32), exponent - EXPONENT_BIAS - 8)
    return np.where(exponent > 0, value, np.float32(0))


def _decode_rows(body: memoryview, height: int, width: int, name: str) -> NDArray[np.uint8]:
    """All scanlines, shape [height, width, 4]. A file mixes encoded and plain ones at will."""
    rows = np.empty((height, width, 4), dtype=np.uint8)
    marker = bytes((2, 2, width >> 8 & 0xFF, width & 0xFF))
    at = 0
    for y in range(height):
        if width in RLE_WIDTHS and bytes(body[at : at + 4]) == marker:
            at += 4
            for channel in range(4):
                at = _decode_run_length(body, at, rows[y, :, channel], f"{name}: row {y}")
            continue
        plain = body[at : at + 4 * width]
        if len(plain) < 4 * width:
            raise ImageError(f"{name}: ends in row {y} of {height}: broken file")
        rows[y] = np.frombuffer(plain, dtype=np.uint8).reshape(width, 4)
        if (rows[y, :, :3] == 1).all(axis=1).any():
            raise ImageError(f"{name}: row {y} uses the run lengths of before 1991, which are not read: save it anew")
        at += 4 * width
    return rows


def _decode_run_length(body: memoryview, at: int, plane: NDArray[np.uint8], where: str) -> int:
    """Fill one channel of one scanline from `body` at `at`; returns where the next begins."""
    filled = 0
    while filled < len(plane):
        if at + 1 >= len(body):
            raise ImageError(f"{where}: ends within a run: broken file")
        code = body[at]
        is_run = code > 128
        length = code - 128 if is_run else code
        values = np.frombuffer(body[at + 1 : at + 2 if is_run else at + 1 + length], dtype=np.uint8)
        if length == 0 or filled + length > len(plane) or (not is_run and len(values) < length):
            raise ImageError(f"{where}: a run does not fit: broken file")
        plane[filled : filled + length] = values
        filled += length
        at += 1 + len(values)
    return at
