"""NPY files: one array, as numpy writes it; colours are floats of shape [height, width, 3]."""

from __future__ import annotations

import math
import tokenize
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from wdpm.scenes.errors import ImageError

_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
"""Readers by version; the third is for names of fields, and colours have none."""


def read_npy(path: Path) -> NDArray[np.float32]:
    """Read linear RGB, shape [height, width, 3].

    Raises:
        ImageError: another kind of file, a broken one, or an array of another kind.
    """
    with path.open("rb") as stream:
        if stream.read(len(npy.MAGIC_PREFIX)) != npy.MAGIC_PREFIX:
            raise ImageError(f"{path}: not an NPY file")
        stream.seek(0)
        try:
            shape, dtype = _header(stream)
        except (ValueError, EOFError, SyntaxError, tokenize.TokenError) as error:  # numpy asks Python's own parser
            raise ImageError(f"{path}: broken NPY file: {error}") from None
        if len(shape) != 3 or shape[2] != 3 or dtype.kind != "f":
            raise ImageError(f"{path}: must hold floats of shape [height, width, 3] (got {dtype} of shape {shape})")
        expected, there = math.prod(shape) * dtype.itemsize, path.stat().st_size - stream.tell()
        if there < expected:
            raise ImageError(f"{path}: broken NPY file: has {there:,} bytes of pixels; expected {expected:,}")
        stream.seek(0)
        pixels: NDArray[np.floating] = npy.read_array(stream, allow_pickle=False)
    return pixels.astype(np.float32)


def write_npy(pixels: NDArray[np.float32], path: Path) -> None:
    """Write linear RGB, shape [height, width, 3]."""
    with path.open("wb") as file:  # a name without .npy would have it appended
        np.save(file, pixels, allow_pickle=False)


def _header(stream: BinaryIO) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and type of the array; the stream is then where its numbers begin."""
    version = npy.read_magic(stream)
    if version not in _HEADERS:
        raise ValueError(f"is of version {version[0]}.{version[1]}")
    shape, _, dtype = _HEADERS[version](stream)
    return shape, dtype
