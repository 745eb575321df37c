"""Image files: which formats there are, and how they are written so that a file is there whole or not at all."""

from __future__ import annotations

import functools
import io
import json
import os
import platform
import struct
import uuid
import zlib
from collections.abc import Callable, Iterable, Mapping
from os import PathLike, fsdecode
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wdpm.images.channels import Layers, decode_srgb
from wdpm.images.exr import read_exr, read_exr_metadata, write_exr
from wdpm.images.npy import read_npy, write_npy
from wdpm.images.view_transform import LOOK, Look, look_in, shown_pixels
from wdpm.scenes.errors import ImageError, NotWrittenError
from wdpm.scenes.images.hdr import decode_hdr, encode_hdr
from wdpm.scenes.images.pfm import decode_pfm, encode_pfm

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_LEVEL = 3
"""Of zlib. A render's end waits for it on one core: half of the time of Pillow's own 6, for files 8 % larger."""

_PNG_HEADER = 33
"""Bytes of the signature and the first chunk, which says the size."""

_PNG_KEYWORD = "wdpm"
_PNG_TEXT_WITHIN = 1 << 16
"""Bytes of a file within which its texts lie."""

_IN_PNG = (LOOK, "camera", "left_out")
"""Of an image's metadata, what a PNG's header holds: what explains the picture, the same from any cluster."""


Metadata = Mapping[str, Any]


class _Format(NamedTuple):
    """How files of one extension are read and written; the writer may get a path without that extension."""

    read: Callable[[Path], tuple[Layers, dict[str, Any]]]
    write: Callable[[Layers, Metadata, Path], object]


def read(path: Path) -> tuple[Layers, dict[str, Any]]:
    """The layers and the metadata of an image file.

    Raises:
        ImageError: unknown extension, missing or broken file.
    """
    _check_extension(path, tuple(_FORMATS))
    if not path.is_file():
        raise ImageError(f"{path}: no such file" if not path.exists() else f"{path}: not a file")
    try:
        if path.stat().st_size == 0:
            raise ImageError(f"{path}: is empty")
        return _FORMATS[path.suffix.lower()].read(path)
    except OSError as error:
        raise ImageError(f"{path}: cannot be read: {_reason(error)}") from None


def look_in_file(path: Path) -> Look | None:
    """How a file that wdpm wrote is shown, from the header of an EXR or PNG file; None where it does not say."""
    if path.suffix.lower() == ".exr":
        metadata = read_exr_metadata(path)
    elif path.suffix.lower() == ".png":
        metadata = _png_metadata(path)
    else:
        return None
    return look_in(metadata) if LOOK in metadata else None


def _png_metadata(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        begin = stream.read(_PNG_TEXT_WITHIN)
    mark = b"tEXt" + _PNG_KEYWORD.encode() + b"\0"
    at = begin.find(mark)
    if at < 4:
        return {}
    (length,) = struct.unpack_from(">I", begin, at - 4)
    try:
        found = json.loads(begin[at + len(mark) : at + 4 + length])
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def write(layers: Layers, metadata: Metadata, path: Path, threads: int = 1) -> None:
    """Write an image file beside its place, then move it there. After an ImageError an older file is as it was.

    Args:
        threads: that compress an EXR file.
    """
    _check_extension(path, tuple(_FORMATS))
    ending = path.suffix.lower()
    write_to = functools.partial(write_exr, threads=threads) if ending == ".exr" else _FORMATS[ending].write
    try:
        write_whole(path, lambda temporary: write_to(layers, metadata, temporary))
    except OSError as error:
        raise NotWrittenError(f"{path}: cannot be written: {_reason(error)}") from None
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from None


def write_bytes(data: bytes, path: Path) -> None:
    """Write `data` to `path`, whole or not at all. Raises ImageError."""
    try:
        write_whole(path, lambda temporary: temporary.write_bytes(data))
    except OSError as error:
        raise ImageError(f"{path}: cannot be written: {_reason(error)}") from None


def check_output_path(path: str | PathLike[str], extensions: tuple[str, ...] | None = None) -> Path:
    """Find out before a render begins whether its result can be written, so that hours of work are not lost after it.

    Args:
        path: where the file is to go.
        extensions: the endings allowed, or None for every image format.

    Raises:
        ImageError: unknown extension, missing folder, something that is no file in its place, no right to write there.
    """
    path = path_of(path)
    _check_extension(path, tuple(_FORMATS) if extensions is None else extensions)
    check_place(path)
    return path


def path_of(given: str | PathLike[str]) -> Path:
    """The path that somebody has given; ImageError for what can be no name of a file."""
    if not isinstance(given, str | bytes | PathLike):
        raise ImageError(f"{given!r:.80} is no name of a file: expected one like 'image.exr'")
    path = Path(fsdecode(given))
    if "\0" in str(path):
        raise ImageError(f"{str(path)!r} is no name of a file: none has a zero byte")
    return path


def check_place(path: Path) -> None:
    """Find out whether a file of any name can be written; raises ImageError as `check_output_path` does."""
    try:
        _check_place(path)
    except OSError as error:
        raise ImageError(f"{path}: cannot be written: {_reason(error)}") from None


def _check_place(path: Path) -> None:
    if path.is_dir():
        raise ImageError(f"{path}: is a folder, not a file")
    path = _where(path)
    if not path.parent.is_dir():
        raise ImageError(f"{path}: there is no folder {path.parent}: make it first")
    if path.exists() and not path.is_file():
        raise ImageError(f"{path}: is no file but a device, a pipe or a socket, which no file may replace")
    if path.exists() and not os.access(path, os.W_OK):
        raise ImageError(f"{path}: is there already and write-protected")
    probe = _temporary(path)
    _remove_left_over(path)
    probe.touch(exist_ok=False)  # asking for rights is not enough: a full or read-only file system says yes
    probe.unlink()


def check_apart(uses: Iterable[tuple[str, Path | None]]) -> None:
    """Raise ImageError if one file is to hold two things.

    Args:
        uses: what is written or read, and where; None for nowhere. The same thing may be there twice.
    """
    seen: dict[str, str] = {}
    for what, path in uses:  # realpath, since resolve() raises where links lead in a circle (until Python 3.13)
        if path is not None and (other := seen.setdefault(os.path.realpath(path), what)) != what:
            raise ImageError(f"{path}: cannot hold both {other} and {what}; give another name for one of them")


def png_bytes(pixels: NDArray[np.uint8], texts: Mapping[str, str] | None = None) -> bytes:
    """8-bit sRGB, shape [height, width, 3], as the bytes of a PNG file.

    Args:
        texts: go into its header by keyword, both in ASCII.
    """
    from PIL import Image as Pillow  # imageio would load all its formats for this one

    buffer = io.BytesIO()
    Pillow.fromarray(pixels).save(buffer, format="PNG", compress_level=PNG_LEVEL)
    data = buffer.getvalue()
    chunks = [_png_chunk(b"sRGB", b"\0")]
    chunks += [_png_chunk(b"tEXt", f"{key}\0{text}".encode("ascii")) for key, text in (texts or {}).items()]
    return b"".join([data[:_PNG_HEADER], *chunks, data[_PNG_HEADER:]])


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def write_whole(path: Path, write_to: Callable[[Path], object]) -> None:
    """Have a file written beside its place, then move it there: it is there whole or not at all. Raises OSError."""
    path = _where(path)
    temporary = _temporary(path)
    try:
        write_to(temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _where(path: Path) -> Path:
    """Where links lead: a file is moved to what they stand for, which may lie on another disk, not into their place."""
    place = Path(os.path.realpath(path)) if path.is_symlink() else path
    return path if place.is_symlink() else place  # a link that leads back to itself is a name like any other


def _temporary(path: Path) -> Path:
    # Not tempfile: its files are readable by their owner only, and stay so after the move.
    return path.with_name(f"{_part_of(path)}{os.getpid()}.{uuid.uuid4().hex[:12]}.part")


def _part_of(path: Path) -> str:
    """How the names of files begin that this machine writes to become `path`."""
    return f".{path.name}.{platform.node() or 'unknown'}."


def _remove_left_over(path: Path) -> None:
    """Remove what processes of this machine that were killed have left half written beside `path`."""
    begin = _part_of(path)
    for part in path.parent.iterdir():
        if part.name.startswith(begin) and part.name.endswith(".part"):
            process = part.name.removeprefix(begin).partition(".")[0]
            if process.isdigit() and not _runs(int(process)):
                part.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    if os.name == "nt":
        return True  # nobody knows: signal 0, which asks elsewhere, is Ctrl-C there
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        return True
    return True


def _reason(error: OSError) -> str:
    return error.strerror.lower() if error.strerror else str(error).rstrip(".")


def _check_extension(path: Path, allowed: tuple[str, ...]) -> None:
    if path.suffix.lower() not in allowed:
        what = f"unknown extension '{path.suffix}'" if path.suffix else "has no extension"
        raise ImageError(f"{path}: {what}: must be one of {' '.join(allowed)}")


def _read_png(path: Path) -> NDArray[np.float32]:
    import imageio.v3 as imageio  # renders read none

    data = path.read_bytes()
    # The header is checked by hand, since Pillow turns 16-bit colour into 8-bit without a word.
    if data[:8] != _PNG_SIGNATURE or len(data) < 26:
        raise ImageError(f"{path}: not a PNG file")
    if data[24] == 16 and data[25] != 0:
        raise ImageError(f"{path}: has 16 bits a channel; only 8-bit colour is read")
    try:
        pixels = np.asarray(imageio.imread(data, extension=".png"))
    except (OSError, SyntaxError, ValueError, EOFError) as error:
        raise ImageError(f"{path}: broken PNG file: {error}") from None
    if pixels.ndim == 2:
        pixels = np.stack([pixels] * 3, axis=-1)
    elif pixels.shape[2] in (2, 4):
        if (pixels[..., -1] != np.iinfo(pixels.dtype).max).any():
            raise ImageError(f"{path}: is partly transparent; only opaque images are read")
        pixels = pixels[..., :-1] if pixels.shape[2] == 4 else np.repeat(pixels[..., :1], 3, axis=2)
    return decode_srgb(pixels / np.iinfo(pixels.dtype).max)


def _write_png(layers: Layers, metadata: Metadata, path: Path) -> None:
    """Write the beauty layer as its look wants it shown, and what was done to it."""
    look = look_in(metadata).resolved(layers["beauty"])
    said = {name: metadata[name] for name in _IN_PNG if name in metadata} | {LOOK: look.to_dict()}
    texts = {"Software": "wdpm", _PNG_KEYWORD: json.dumps(said)}
    path.write_bytes(png_bytes(shown_pixels(layers["beauty"], look), texts))


def _of_colors(
    read: Callable[[Path], NDArray[np.float32]], write: Callable[[NDArray[np.float32], Path], object]
) -> _Format:
    """A format that holds linear RGB, shape [height, width, 3], and nothing else."""
    return _Format(
        lambda path: ({"beauty": read(path)}, {}), lambda layers, _metadata, path: write(layers["beauty"], path)
    )


_FORMATS: Mapping[str, _Format] = {
    ".exr": _Format(read_exr, write_exr),
    ".png": _Format(lambda path: ({"beauty": _read_png(path)}, {}), _write_png),
    ".hdr": _of_colors(
        lambda path: decode_hdr(path.read_bytes(), str(path)),
        lambda pixels, path: path.write_bytes(encode_hdr(pixels)),
    ),
    ".pfm": _of_colors(
        lambda path: decode_pfm(path.read_bytes(), str(path)),
        lambda pixels, path: path.write_bytes(encode_pfm(pixels)),
    ),
    ".npy": _of_colors(read_npy, write_npy),
}
