"""OpenEXR files: every layer as channels, 32-bit float, lossless; settings and report in the header.

The header's text attribute `wdpm` holds Image.metadata as JSON.
"""

from __future__ import annotations

import json
import os
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import Imath  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from wdpm.images.channels import LAYER_CHANNELS, Layers
from wdpm.scenes.errors import ImageError
from wdpm.scenes.images.exr_header import MAGIC, ExrHeader, read_exr_header

_METADATA_ATTRIBUTE = "wdpm"

_ROWS_A_BLOCK = 16
"""Of a file with ZIP compression: what one thread compresses."""

_pool = threading.Lock()
"""OpenEXR has one pool of threads for all that it writes."""


def write_exr(layers: Layers, metadata: Mapping[str, Any], path: Path, threads: int = 1) -> None:
    """Write all layers; `path` need not end in .exr. Raises ImageError when the metadata is not JSON.

    Args:
        threads: that compress them; the file has the same bytes with any number.
    """
    import OpenEXR  # here and below: many renders have no such file

    try:
        text = json.dumps(metadata, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ImageError(f"the image's metadata cannot be written as JSON: {error}") from None
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        _METADATA_ATTRIBUTE: text,
    }
    channels: dict[str, NDArray[np.float32]] = {}
    for layer, pixels in layers.items():
        names = _channel_names(layer)
        planes = [pixels] if pixels.ndim == 2 else [pixels[..., i] for i in range(len(names))]
        channels.update({name: np.ascontiguousarray(plane) for name, plane in zip(names, planes, strict=True)})
    rows = len(next(iter(channels.values()), ()))
    try:
        with OpenEXR.File(header, channels) as file, _threads(min(threads, -(-rows // _ROWS_A_BLOCK))):
            file.write(os.fsencode(path))  # as they are: OpenEXR takes a str for UTF-8, which not all names are
    except RuntimeError as error:
        # 'Cannot open image file "NAME". No space left on device': the name is one that nobody else has heard of.
        raise OSError(str(error).rpartition('". ')[2].lower()) from None


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Have OpenEXR compress on so many threads, which end with the context: a process that has none may be forked."""
    import OpenEXR

    set_count = getattr(OpenEXR, "set_global_thread_count", None)  # early versions have none
    with _pool:
        if count <= 1 or set_count is None:
            yield
            return
        set_count(count)
        try:
            yield
        finally:
            set_count(0)


def read_exr(path: Path) -> tuple[Layers, dict[str, Any]]:
    """Read the layers that wdpm knows, and its metadata; others are left alone. Half and 32-bit float.

    A file with one channel Y and no R, G, B is grey. Raises ImageError for a broken file or one without colour.
    """
    planes, header = _read_planes(path)
    layers: Layers = {}
    for layer in LAYER_CHANNELS:
        names = _channel_names(layer)
        if all(name in planes for name in names):
            stack = [planes[name] for name in names]
            layers[layer] = stack[0] if len(stack) == 1 else np.stack(stack, axis=-1)
    if "beauty" not in layers:
        if "Y" not in planes:
            raise ImageError(f"{path}: has no channels R, G, B (it has {', '.join(sorted(planes)) or 'none'})")
        layers["beauty"] = np.stack([planes["Y"]] * 3, axis=-1)
    return layers, _metadata(header)


def read_exr_metadata(path: Path) -> dict[str, Any]:
    """What wdpm put into the header of a file, without reading its pixels; nothing for a broken file."""
    try:
        return _metadata(read_exr_header(path))
    except (OSError, ValueError):
        return {}


def _channel_names(layer: str) -> list[str]:
    prefix = "" if layer == "beauty" else f"{layer}."
    return [prefix + channel for channel in LAYER_CHANNELS[layer]]


def _read_planes(path: Path) -> tuple[dict[str, NDArray[np.float32]], ExrHeader]:
    """The channels of full resolution of the first part, float32 [height, width], by name, and the header."""
    import OpenEXR

    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise ImageError(f"{path}: not an OpenEXR file")
    try:
        header = read_exr_header(path)
    except ValueError as error:
        raise ImageError(f"{path}: not a whole OpenEXR file: {error}") from None
    names = [name for name, apart in header.channels.items() if apart == (1, 1)]
    width, height = header.size
    # InputFile, not File: on broken pixels File prints to standard output and goes on without them.
    with _diverted_stderr() as first_line:
        try:
            planes = OpenEXR.InputFile(os.fsencode(path)).channels(names, Imath.PixelType(Imath.PixelType.FLOAT))
            arrays = [np.frombuffer(plane, dtype=np.float32).reshape(height, width) for plane in planes]
        except (OSError, RuntimeError, TypeError, ValueError) as error:
            raise ImageError(f"{path}: not a whole OpenEXR file: {first_line() or error}") from None
    return dict(zip(names, arrays, strict=True)), header


def _metadata(header: ExrHeader) -> dict[str, Any]:
    """What wdpm put into the header; another program's attribute of that name is none of ours."""
    try:
        metadata = json.loads(header.texts[_METADATA_ATTRIBUTE])
    except (KeyError, TypeError, ValueError):
        return {}
    return metadata if isinstance(metadata, dict) else {}


@contextmanager
def _diverted_stderr() -> Iterator[Any]:
    """Catch what the OpenEXR library prints about broken files, so that it becomes part of our one line.

    The library writes to file descriptor 2 itself and raises an exception that says less. Yields a function that
    returns the first line it printed, or nothing.
    """
    with _temporary_file() as caught:
        saved = os.dup(2)

        def first_line() -> str:
            caught.seek(0)
            line = caught.readline().decode(errors="replace").strip()
            return line.split(") ", 1)[-1]  # without "path: (EXR_ERR_..."

        os.dup2(caught.fileno(), 2)
        try:
            yield first_line
        finally:
            os.dup2(saved, 2)
            os.close(saved)


def _temporary_file() -> IO[bytes]:
    try:
        return tempfile.TemporaryFile()
    except OSError as error:
        raise ImageError(
            f"no temporary file can be written ({error.strerror}); set TMPDIR to a folder that you can write to"
        ) from None
