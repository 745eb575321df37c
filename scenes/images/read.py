"""Reads image files as textures."""

from __future__ import annotations

import io
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import ImageError, SceneError
from wdpm.scenes.images.exr_header import MAGIC
from wdpm.scenes.images.hdr import decode_hdr
from wdpm.scenes.images.pfm import decode_pfm

_FLOAT_FORMATS = {".hdr": decode_hdr, ".rgbe": decode_hdr, ".pfm": decode_pfm}


def read_texture(file: Path, *, raw: bool) -> NDArray[np.float32]:
    """The pixels of an image file.

    Args:
        raw: leave the numbers as they are; otherwise 8 and 16-bit files are decoded from sRGB. EXR, HDR and PFM are
            linear.

    Returns:
        linear RGB, shape [height, width, 3]; alpha is dropped and grey is spread over three channels.
    """
    if not file.is_file():
        raise SceneError("image file not found", file)
    if file.suffix.lower() == ".exr":
        return _checked(_read_exr(file), file)
    if file.suffix.lower() in _FLOAT_FORMATS:
        return _checked(_read_float(file), file)
    return _decode(_read_any(file.read_bytes(), str(file), file.suffix), str(file), raw=raw)


def unpacked(data: bytes, name: str) -> NDArray[Any]:
    """What is in a PNG or JPEG file that lies in memory, as its numbers are; for `linear_pixels` and `alpha_of`."""
    return _read_any(data, name, None)


def linear_pixels(pixels: NDArray[Any], name: str, *, raw: bool = False) -> NDArray[np.float32]:
    """Like `read_texture`, for an image that is unpacked already: whole numbers are sRGB; shape [height, width, 3].

    Args:
        pixels: shape [height, width], or [height, width, channels].
    """
    return _decode(pixels, name, raw=raw)


def read_alpha(file: Path) -> NDArray[np.float32] | None:
    """The alpha channel of an image file as grey, shape [height, width, 3]; None without one, or for floats."""
    if not file.is_file():
        raise SceneError("image file not found", file)
    if file.suffix.lower() in (".exr", *_FLOAT_FORMATS):
        return None
    return alpha_of(_read_any(file.read_bytes(), str(file), file.suffix), str(file))


def alpha_of(pixels: NDArray[Any], name: str) -> NDArray[np.float32] | None:
    """Like `read_alpha`, for an image that is unpacked already."""
    if pixels.ndim != 3 or pixels.shape[2] not in (2, 4):
        return None
    return _decode(pixels[:, :, -1], name, raw=True)


def _read_any(data: bytes, name: str, suffix: str | None) -> NDArray[Any]:
    import imageio.v3 as imageio  # many scenes have no images

    try:
        return np.asarray(
            imageio.imread(io.BytesIO(data), index=0, **({} if suffix is None else {"extension": suffix}))
        )
    except Exception as error:  # imageio and its plugins promise no exception types
        raise SceneError(f"cannot be read as an image: {_reason(error)}", name) from error


def _reason(error: Exception) -> str:
    """What a library says of a file, if it is of the file and not of the library's own objects."""
    first = str(error).partition("\n")[0]
    of_a_file = isinstance(error, (OSError, SyntaxError, ValueError)) and "<_io." not in first
    return first if first and of_a_file else "it is broken, or of another kind than its name says"


def _decode(pixels: NDArray[Any], name: str, *, raw: bool) -> NDArray[np.float32]:
    if pixels.dtype == np.bool_:
        pixels = pixels.astype(np.uint8) * np.uint8(255)
    rgb = _rgb(pixels, name)
    if rgb.dtype in (np.uint8, np.uint16):
        return _looked_up(_table(rgb.dtype, raw=raw), rgb)
    if np.issubdtype(rgb.dtype, np.integer):
        return _decoded(rgb, raw=raw)
    return _checked(rgb.astype(np.float32), name)


_AT_ONCE = 1 << 16
"""Numbers that are looked up together: NumPy makes eight bytes of each first, which should stay in a cache."""


def _looked_up(table: NDArray[np.float32], rgb: NDArray[Any]) -> NDArray[np.float32]:
    found = np.empty(rgb.shape, np.float32)
    numbers, values = rgb.reshape(-1), found.reshape(-1)
    for first in range(0, len(numbers), _AT_ONCE):
        block = slice(first, first + _AT_ONCE)
        table.take(numbers[block], out=values[block], mode="clip")  # none is beyond the table
    return found


@cache
def _table(dtype: np.dtype[Any], *, raw: bool) -> NDArray[np.float32]:
    """What each whole number of a type becomes: far fewer than a picture has pixels, and powers are slow."""
    return _decoded(np.arange(np.iinfo(dtype).max + 1, dtype=dtype), raw=raw)


def _decoded(values: NDArray[Any], *, raw: bool) -> NDArray[np.float32]:
    shares = values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)
    return shares if raw else srgb_to_linear(shares)


def _rgb(values: NDArray[Any], name: str) -> NDArray[Any]:
    if values.ndim == 2:
        values = values[:, :, None]
    if values.ndim != 3 or values.shape[2] not in (1, 2, 3, 4):
        raise SceneError(f"expected an image of 1 to 4 channels, got an array of shape {values.shape}", name)
    if values.size == 0:
        raise SceneError("the image has no pixels", name)
    colour = values[:, :, :3] if values.shape[2] >= 3 else np.repeat(values[:, :, :1], 3, axis=2)
    return np.ascontiguousarray(colour)


def srgb_to_linear(values: NDArray[Any]) -> NDArray[Any]:
    """Decodes sRGB (IEC 61966-2-1), in the precision that it is given."""
    real = values.dtype.type
    low = values / real(12.92)
    high = ((values + real(0.055)) / real(1.055)) ** real(2.4)
    return np.where(values <= real(0.04045), low, high).astype(values.dtype)


def _checked(pixels: NDArray[np.float32], name: str | Path) -> NDArray[np.float32]:
    if pixels.shape[0] * pixels.shape[1] == 0:
        raise SceneError("the image has no pixels", name)
    if not np.isfinite(pixels).all():
        y, x = np.argwhere(~np.isfinite(pixels).all(axis=2))[0]
        raise SceneError(f"pixel ({x}, {y}) is not finite", name)
    return pixels


def _read_exr(file: Path) -> NDArray[np.float32]:
    import OpenEXR  # few scenes have such files

    with file.open("rb") as start:
        if start.read(len(MAGIC)) != MAGIC:
            raise SceneError("not an EXR file: it begins otherwise", file)
    try:
        with OpenEXR.File(str(file), separate_channels=True) as image:
            channels = {
                name: np.asarray(channel.pixels, dtype=np.float32) for name, channel in image.channels().items()
            }
    except UnicodeDecodeError as error:
        text = f"{error.object!r:.60}"
        raise SceneError(f"cannot be read: its header has {text}, which is no UTF-8; save it without", file) from None
    except Exception as error:  # OpenEXR raises RuntimeError and others, of files that are there and cannot be opened
        raise SceneError("cannot be read as EXR: the file is broken", file) from error
    for names in (("R", "G", "B"), ("Y", "Y", "Y")):
        if all(name in channels for name in names):
            return np.stack([channels[name] for name in names], axis=2)
    raise SceneError(f"EXR without channels R, G, B or Y (it has {', '.join(channels)})", file)


def _read_float(file: Path) -> NDArray[np.float32]:
    try:
        return _FLOAT_FORMATS[file.suffix.lower()](file.read_bytes(), file.name)
    except ImageError as error:
        raise SceneError(str(error).removeprefix(f"{file.name}: "), file) from error
