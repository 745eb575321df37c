"""Files of arrays with a header that is JSON: what wdpm keeps for renders to come.

Archives as numpy writes them; never unpickled, written whole or not at all.
"""

from __future__ import annotations

import json
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.images.files import write_whole
from wdpm.scenes.errors import ImageError

_HEADER = "header"

_OF_BROKEN_FILES = (
    OSError,
    EOFError,
    ValueError,
    OverflowError,
    RuntimeError,  # flags of zip files that are not supported
    SyntaxError,  # this and the next: numpy has Python's own parser read the headers of arrays
    tokenize.TokenError,
    struct.error,
    zlib.error,
    zipfile.BadZipFile,
)
"""What numpy, zipfile and json raise."""


class BrokenArraysError(ValueError):
    """A file is not as `write_arrays` left it; the message says how, without the file's name."""


def write_arrays(path: Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a file.

    Args:
        header: as JSON has it.
        arrays: by name; none is called "header".

    Raises:
        ImageError: it cannot be written; an older one is then as it was.
    """
    words = np.frombuffer(json.dumps(header).encode(), np.uint8)

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:  # a name without .npz would have it appended
            np.savez(file, allow_pickle=False, **{_HEADER: words}, **arrays)

    try:
        write_whole(path, write)
    except OSError as error:
        raise ImageError(f"{path}: cannot be written: {error.strerror or error}") from None


def read_arrays(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The header and the arrays of a file.

    Raises:
        FileNotFoundError: there is none.
        BrokenArraysError: it is another kind of file, cut off, changed, or cannot be read.
    """
    try:
        with path.open("rb") as stream:
            arrays = _arrays_of(stream)
        if _HEADER not in arrays:
            raise BrokenArraysError("it has no header")
        header = json.loads(arrays.pop(_HEADER).tobytes())
    except FileNotFoundError:
        raise
    except BrokenArraysError:
        raise
    except _OF_BROKEN_FILES as error:
        raise BrokenArraysError(str(error)) from None
    if not isinstance(header, dict):
        raise BrokenArraysError("its header is no object")
    return header, arrays


def _arrays_of(stream: Any) -> dict[str, NDArray[Any]]:
    if not zipfile.is_zipfile(stream):
        raise BrokenArraysError("it is no whole archive of arrays")
    with zipfile.ZipFile(stream) as archive:
        changed = archive.testzip()  # numpy would interpret an array's header before the sum over it is known
    if changed is not None:
        raise BrokenArraysError(f"{changed} has changed")
    stream.seek(0)
    arrays: dict[str, NDArray[Any]] = {}
    with np.load(stream, allow_pickle=False) as file:
        for name in file.files:
            try:
                array = file[name]
            except ValueError:  # numpy's own words advise to unpickle it
                array = None
            if not isinstance(array, np.ndarray):
                raise BrokenArraysError(f"{name} is no array of numbers")
            arrays[name] = array
    return arrays
