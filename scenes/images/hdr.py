"""Reads and writes Radiance pictures (.hdr): RGB with a shared exponent, run-length encoded.

Ward, "Real Pixels", Graphics Gems II.

A value keeps 8 bits of the pixel's largest channel. Ward's own reader adds half a step to each mantissa because his
writer cuts off; nearly every reader of today (stb_image, for one) does not. So the writer rounds to nearest, and the
reader adds nothing: the mean is kept.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import ImageError

EXPONENT_BIAS = 128
RLE_WIDTHS = range(8, 0x8000)  # widths whose scanlines may be run-length encoded

_RUN_LIMIT = 127  # a code byte above 128 is a run of (code - 128) equal values
_LITERAL_LIMIT = 128  # up to 128 it is that many values as they are
_SMALL = 1 << 20  # pixels of a picture that is unpacked as far as it goes, to say in which row it is broken
_SHORTEST_RUN = 3  # a run costs two bytes; a shorter one inside literals would not pay

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
    if height * width > _SMALL and height * _least_bytes(width) > len(body):  # memory is not asked for in vain
        raise ImageError(f"{name}: ends before {height} rows of {width} pixels can be there: broken file")
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


def _least_bytes(width: int) -> int:
    """Bytes of a scanline that is nothing but runs, or of a plain one where there are none."""
    return 4 + 4 * 2 * -(-width // _RUN_LIMIT) if width in RLE_WIDTHS else 4 * width


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
