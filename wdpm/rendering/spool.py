"""A scene's triangles on disk, so that a master may send them again and again, and hold none of them in memory."""

from __future__ import annotations

import tempfile
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.arrays import ARRAYS, Triangles


def spooled(triangles: Triangles) -> Triangles:
    """The same triangles, mapped from a file without a name, which ends with them.

    Pages of the file are the system's to keep in memory or not. Where the disk has no room they stay as they are.
    """
    # The arrays hold the mapping, which needs no open file.
    try:
        with tempfile.TemporaryFile(prefix="wdpm") as file:
            return triangles.with_arrays({name: _spooled(getattr(triangles, name), file) for name in ARRAYS})
    except OSError:
        return triangles


def _spooled(array: NDArray[Any], file: IO[bytes]) -> NDArray[Any]:
    if not array.nbytes:
        return array
    offset = file.seek(0, 2)
    file.write(np.ascontiguousarray(array).data)
    file.flush()
    mapped = np.memmap(file, array.dtype, "r", offset, array.shape)
    return np.asarray(mapped)
